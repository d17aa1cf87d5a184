"""A step of a batch as launches: where it starts, the descents, what was found."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from sim.batch import step_kernels as kernels
from sim.device import Device, on_host
from sim.solve.descent_state import Status

if TYPE_CHECKING:
    from sim.batch.batch import Batch

# Steps between two looks at who has arrived: they cost a GPU ten microseconds, which a step of many
# environments hides.
_FEW, _STEPS_OF_SOME, _SOME = 8, 2, 256


class Frames:
    """The launches of a step, for courses of so many frames; on a GPU one graph.

    Attributes:
        course: Where the environments go, as ``step_kernels.Way`` has it, on the device.
    """

    def __init__(self, batch: Batch, frame_count: int) -> None:
        self._batch, self._device = batch, Device(batch.device)
        self.course = self._device.zeros((frame_count, batch.count), wp.vec4d)
        self.found = self._device.zeroed(kernels.Found, (frame_count, batch.count))
        self._until = self._device.zeros(1, wp.int32)
        self._lay, self._before, self._starts, self._lands = self._recorded()
        self._graph: Any = None
        self._launch()
        if self._device.is_gpu:
            with wp.ScopedCapture(device=batch.device) as capture:
                self._launch()
            self._graph = capture.graph

    def launch_singly(self) -> None:
        """Launch one by one from now on, so that each can be timed."""
        self._graph = None

    def begin(self) -> None:
        """Put all environments before the first frame of the course."""
        self._batch.trail.frame.zero_()
        self.found.status.fill_(int(Status.IDLE))
        self._lay.launch()

    def run(self, until: int) -> None:
        """Take the active environments to a frame, each at its own pace."""
        self._until.fill_(until)
        if self._graph is not None:
            wp.capture_launch(self._graph)
        else:
            self._launch()

    @property
    def paced(self) -> bool:
        """An environment does not wait for the others; it has to where frames are watched.

        On a processor there is nothing to gain: who waits costs nothing there.
        """
        many = self._device.is_gpu and self._batch.count > _FEW
        return many and not self._batch.watchers

    def results(self) -> dict[str, Any]:
        """Return what was found, on the host, by the names of ``step_kernels.Found``."""
        return {
            name: np.array(on_host(getattr(self.found, name)))
            for name in vars(kernels.Found)["vars"]
        }

    def _launch(self) -> None:
        busy = self._batch.descents.busy
        busy.zero_()
        _launched(self._before)
        _launched(self._starts)
        wp.capture_while(busy, while_body=self._iterate)
        if not self.paced:
            _launched(self._lands)
        for watch in self._batch.watchers:
            watch()

    def _iterate(self) -> None:
        if not self.paced:
            self._batch.descents.step()
            return
        for _ in range(_STEPS_OF_SOME if self._batch.count <= _SOME else 1):
            self._batch.descents.step()
        _launched(self._lands)
        _launched(self._starts)

    def _recorded(self) -> tuple[Any, list[Any], list[Any], list[Any]]:
        """Record what comes before all, before a step, and before and after a descent."""
        batch, descents, record = self._batch, self._batch.descents, self._device.record
        trail, state, count = batch.trail, descents.state, (batch.count,)
        way, threads = batch.way(self.course, self._until), descents.threads
        options, nodes = batch.model.contact_options, tuple(descents.positions.shape)
        shared = [batch.guide, way, batch.together]
        begun = [options.friction > 0.0, *shared, batch.straight, trail, descents.poses]
        begun += [state, descents.memory, descents.busy]
        put = [trail, state.slot, descents.positions]
        put += [descents.gel_room[0], descents.contact_room[0]]
        starts = [
            record(kernels.begin, (1, threads), begun, threads),
            record(kernels.predict, nodes, [*shared, *put]),
        ]
        noted = [batch.floor_n, way, descents.poses, state, trail, self.found]
        lands = [record(kernels.land, count, noted)]
        lay = record(kernels.lay, self.course.shape, [batch.guide, trail, way])
        before = []
        if options.is_tangential:
            grip, start = descents.grip, descents.grip_start
            # One that did not arrive may have left other grips than it began with.
            before.append(self._copied(trail.active, 1, start, grip))
            lands += [self._taken(), self._copied(trail.stage, kernels.LANDS, grip, start)]
        lands.append(record(kernels.remember, nodes, [descents.positions, trail]))
        return lay, before, starts, lands

    def _taken(self) -> Any:
        """Let what touches hold on, where it is bonded, or anchors follow what slid."""
        batch, descents = self._batch, self._batch.descents
        made = batch.model.surface.kernels(batch.pilot.indenter)
        shape = tuple(descents.contact_room[1].shape)
        # The stage of one that has arrived is 1, as what is wanted has.
        at = [descents.surface, descents.body, batch.trail.stage, descents.poses]
        at.append(descents.positions)
        if batch.model.contact_options.bonded:
            held = [descents.grip_start, descents.grip]
            held += [*descents.contact_room[:2], *descents.hold_room]
            return self._device.record(made.hold, shape, [*at, *held])
        return self._device.record(made.drag, shape, [*at, descents.grip])

    def _copied(self, wanted: Any, goal: int, given: Any, out: Any) -> Any:
        inputs = [wanted, goal, given, out]
        return self._device.record(kernels.copy_grip, tuple(given.held.shape), inputs)


def _launched(recorded: list[Any]) -> None:
    for launch in recorded:
        launch.launch()
