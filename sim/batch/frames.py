"""A step of a batch as launches: where it starts, the descents, what was found."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from sim.batch import step_kernels as kernels
from sim.device import Device, on_host
from sim.solve.descent_state import DONE
from sim.solve.descents import zeroed

if TYPE_CHECKING:
    from sim.batch.batch import Batch

# A test whether anybody is busy costs a GPU some microseconds.
_ITERATIONS_A_TEST, _FEW = 2, 8


class Frames:
    """The launches of a step, for courses of so many frames; on a GPU one graph.

    Attributes:
        course: Where the environments go, as ``step_kernels.Way`` has it, on the device.
        found: What every frame gives.
    """

    def __init__(self, batch: Batch, frame_count: int) -> None:
        self._batch, self._device = batch, Device(batch.device)
        self.course = self._device.zeros((frame_count, batch.count), wp.vec4d)
        self.found = zeroed(kernels.Found, (frame_count, batch.count), self._device)
        self._before, self._after = self._recorded()
        self._graph: Any = None
        self._launch()
        if self._device.is_gpu:
            with wp.ScopedCapture(device=batch.device) as capture:
                self._launch()
            self._graph = capture.graph

    def run(self) -> None:
        """Take the active environments a frame further."""
        if self._graph is not None:
            wp.capture_launch(self._graph)
        else:
            self._launch()

    def results(self) -> dict[str, Any]:
        """Return what was found, on the host, by the names of ``step_kernels.Found``."""
        return {
            name: np.array(on_host(getattr(self.found, name)))
            for name in vars(kernels.Found)["vars"]
        }

    def _launch(self) -> None:
        descents = self._batch.descents
        for launch in self._before:
            launch.launch()
        descents.busy.fill_(1)
        wp.capture_while(descents.busy, while_body=self._iterate)
        for launch in self._after:
            launch.launch()
        for watch in self._batch.watchers:
            watch()

    def _iterate(self) -> None:
        few = not self._device.is_gpu or self._batch.count <= _FEW
        for _ in range(1 if few else _ITERATIONS_A_TEST):
            self._batch.descents.step()

    def _recorded(self) -> tuple[list[Any], list[Any]]:
        """Record what comes before and after the descents."""
        batch, descents, record = self._batch, self._batch.descents, self._device.record
        trail, state, count = batch.trail, descents.state, (batch.count,)
        way = batch.way(self.course)
        total, counted = self._device.zeros(1, wp.vec4d), self._device.zeros(1, wp.int32)
        stands = np.stack([each.stand_m for each in batch.pilot.stiffnesses])
        which, push = batch.inverse.which, descents.contact_room[1]
        nodal = descents.gel_room[0], descents.contact_room[0]
        options, nodes = batch.model.contact_options, tuple(descents.positions.shape)
        before = [
            record(kernels.aim, count, [way, trail], [total, counted]),
            record(
                kernels.choose,
                (1,),
                [self._device.array(stands, wp.vec4d), total, counted],
                [which],
            ),
            record(
                kernels.begin,
                count,
                [options.friction > 0.0, which, way, batch.straight],
                [trail, descents.poses, state, descents.memory, push],
            ),
            record(kernels.predict, nodes, [trail], [descents.positions, *nodal]),
        ]
        after = []
        if options.is_tangential:
            grip, start = descents.grip, descents.grip_start
            before.append(self._copied(trail.active, 1, start, grip))
            after += [self._taken(), self._copied(state.status, int(DONE), grip, start)]
        after += [
            record(kernels.remember, nodes, [descents.positions, state], [trail]),
            record(
                kernels.end,
                count,
                [batch.floor_n, way, descents.poses, state, push],
                [trail, self.found],
            ),
            record(kernels.tick, (1,), [way.frame], []),
        ]
        return before, after

    def _taken(self) -> Any:
        """Let what touches hold on, where it is bonded, or anchors follow what slid."""
        batch, descents = self._batch, self._batch.descents
        made = batch.model.surface.kernels(batch.pilot.indenter)
        shape = tuple(descents.contact_room[2].shape)
        # What is done has the status 1, as what is wanted has.
        at = [descents.surface, descents.body, descents.state.status, descents.poses]
        at.append(descents.positions)
        if batch.model.contact_options.bonded:
            held = [descents.grip_start, descents.grip, *descents.hold_room]
            return self._device.record(made.hold, shape, [*at, *held], [])
        return self._device.record(made.drag, shape, [*at, descents.grip], [])

    def _copied(self, wanted: Any, goal: int, given: Any, out: Any) -> Any:
        arrays = [given.held, given.anchors, given.loads]
        found = [out.held, out.anchors, out.loads]
        shape = tuple(given.held.shape)
        return self._device.record(kernels.copy_grip, shape, [wanted, goal, *arrays], found)
