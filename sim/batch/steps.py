"""A step of a batch as launches: where it starts, the descents, what was found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import warp as wp

from sim.batch import step_kernels as kernels
from sim.batch.environment import Environment
from sim.batch.inverses import DenseProduct, FactoredInverses
from sim.batch.pilot import Pilot
from sim.batch.pilot_path import PathPosition, PilotPath
from sim.device import Device, filled, on_host
from sim.solve.descent_state import Status
from sim.solve.descents import Descents
from tacauchy_rig.core.arrays import FloatArray

# How far apart the inverses may be that serve at once: reading them takes a GPU most of a step.
_AHEAD = 1
# Steps between two looks at who has arrived: they cost a GPU ten microseconds, which a step of many
# environments hides.
_FEW, _STEPS_OF_SOME, _SOME = 8, 2, 256


class StepArrays:
    """What all steps of a batch have in common, on its device.

    Args:
        inverse: The pilot's inverses; their ``which`` becomes that of ``sharing``.
        young_shares: E of the pilot's gel over the environments' own, shape [environment_count].

    Attributes:
        history: The last states of every environment.
        straight: 1 where a step starts from the last state as it is, shape [1].
        watchers: Launches at the end of every step.
    """

    def __init__(
        self,
        pilot: Pilot,
        environments: Sequence[Environment],
        descents: Descents,
        inverse: FactoredInverses | DenseProduct,
        young_shares: FloatArray,
        *,
        floor_n: float,
    ) -> None:
        self.pilot, self.descents, self.floor_n = pilot, descents, floor_n
        self.watchers: list[Callable[[], object]] = []
        self.tips_m, self.rotations = pilot.starts(environments)
        device, count = Device(descents.model.device), len(environments)
        self._device, nodes = device, descents.model.nodes
        shape = dict.fromkeys(("coordinates", "heights"), (count, 2))
        shape |= dict.fromkeys(("last", "older"), (count, len(nodes)))
        self.history = device.zeroed(kernels.History, (count,), **shape)
        self.straight = device.zeros(1, wp.int32)
        self.sharing = device.zeroed(
            kernels.InverseSharing,
            (count,),
            counts=(len(pilot.states),),
            first=(len(pilot.states),),
            blocks=inverse.blocks.shape,
        )
        self.sharing.blocks, self.sharing.width = inverse.blocks, inverse.width
        self.sharing.ahead = _AHEAD
        inverse.which = self.sharing.which
        points = pilot.points
        states = [nodes, *(each.point.state.positions for each in points)]
        self.path = device.tables(
            PilotPath,
            {
                "coordinates": np.concatenate([np.zeros((1, 4)), pilot.coordinates_m]),
                "motions": np.stack(states) - nodes,
                "depths": np.array([0.0, *(each.point.depth_m for each in points)]),
                "states": np.array([-1, *(each.state for each in points)]),
                "before": np.array([0, *(each.before for each in points)]),
                "frames": np.array([each.frame for each in pilot.states]),
            },
        )
        self._given = {
            "tips": device.array(self.tips_m, wp.vec3d),
            "rotations": device.array(self.rotations, wp.mat33d),
            "metres": wp.vec2d(*pilot.metres),
            "copies": float(descents.model.mesh.symmetry.copies),
            "pushed": pilot.is_pushed,
            "shares": device.array(young_shares, wp.float64),
            "guided": device.array([int(each.is_guided) for each in environments], wp.int32),
        }

    def trajectories(self, goals: Any, until: Any) -> Any:
        """Return where the environments begin, and where goals lead them."""
        return filled(
            kernels.Trajectories,
            **self._given,
            goals=goals,
            until=until,
            starts=self._device.zeros(goals.shape, PathPosition),
            ends=self._device.zeros(goals.shape, PathPosition),
            nearest=self._device.zeros(goals.shape, wp.int32),
        )


class Steps:
    """The launches of a step, for trajectories of so many frames; on a GPU one graph.

    Attributes:
        goals: Where the environments go, as ``step_kernels.Trajectories`` has it, on the device.
    """

    def __init__(self, arrays: StepArrays, frame_count: int) -> None:
        self._arrays, self._count = arrays, arrays.descents.count
        self._device = Device(arrays.descents.model.device)
        self.goals = self._device.zeros((frame_count, self._count), wp.vec4d)
        self.found = self._device.zeroed(kernels.StepResults, (frame_count, self._count))
        self._until = self._device.zeros(1, wp.int32)
        self._locate, self._before, self._starts, self._ends = self._recorded()
        self._graph: Any = None
        self._launch()
        if self._device.is_gpu:
            with wp.ScopedCapture(device=self._device.name) as capture:
                self._launch()
            self._graph = capture.graph

    def launch_singly(self) -> None:
        """Launch one by one from now on, so that each can be timed."""
        self._graph = None

    def begin(self) -> None:
        """Put all environments before the first frame."""
        self._arrays.history.frame.zero_()
        self.found.status.fill_(int(Status.IDLE))
        self._locate.launch()

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
        return self._device.is_gpu and self._count > _FEW and not self._arrays.watchers

    def results(self) -> dict[str, Any]:
        """Return what was found, on the host, by the names of ``step_kernels.StepResults``."""
        return {
            name: np.array(on_host(getattr(self.found, name)))
            for name in vars(kernels.StepResults)["vars"]
        }

    def _launch(self) -> None:
        busy = self._arrays.descents.busy
        busy.zero_()
        _launched(self._before)
        _launched(self._starts)
        wp.capture_while(busy, while_body=self._iterate)
        if not self.paced:
            _launched(self._ends)
        for watch in self._arrays.watchers:
            watch()

    def _iterate(self) -> None:
        if not self.paced:
            self._arrays.descents.step()
            return
        for _ in range(_STEPS_OF_SOME if self._count <= _SOME else 1):
            self._arrays.descents.step()
        _launched(self._ends)
        _launched(self._starts)

    def _recorded(self) -> tuple[Any, list[Any], list[Any], list[Any]]:
        """Record what comes before all, before a step, and before and after a descent."""
        arrays, descents, record = self._arrays, self._arrays.descents, self._device.record
        history, state, threads = arrays.history, descents.state, descents.threads
        trajectories = arrays.trajectories(self.goals, self._until)
        options, nodes = descents.model.contact_options, tuple(descents.positions.shape)
        shared = [arrays.path, trajectories, arrays.sharing]
        begun = [options.friction > 0.0, *shared, arrays.straight, history, descents.poses]
        begun += [state, descents.memory, descents.busy]
        put = [history, state.slot, descents.positions]
        put += [descents.gel_buffers[0], descents.contact_buffers[0]]
        starts = [
            record(kernels.begin, (1, threads), begun, threads),
            record(kernels.predict, nodes, [*shared, *put]),
        ]
        noted = [arrays.floor_n, trajectories, descents.poses, state, history, self.found]
        ends = [record(kernels.end, (self._count,), noted)]
        locate = record(kernels.locate, self.goals.shape, [arrays.path, history, trajectories])
        before = []
        if options.is_tangential:
            grip, start = descents.grip, descents.grip_start
            # One that did not arrive may have left other grips than it began with.
            before.append(self._copied(history.active, 1, start, grip))
            ends += [self._taken(), self._copied(history.stage, kernels.ARRIVED, grip, start)]
        ends.append(record(kernels.remember, nodes, [descents.positions, history]))
        return locate, before, starts, ends

    def _taken(self) -> Any:
        """Let what touches hold on, where it is bonded, or anchors follow what slid."""
        descents = self._arrays.descents
        made = descents.model.surface.kernels(self._arrays.pilot.indenter)
        shape = tuple(descents.contact_buffers[1].shape)
        # The stage of one that has arrived is 1, as what is wanted has.
        at = [descents.surface, descents.body, self._arrays.history.stage, descents.poses]
        at.append(descents.positions)
        if descents.model.contact_options.bonded:
            held = [descents.grip_start, descents.grip]
            held += [*descents.contact_buffers[:2], *descents.grip_buffers]
            return self._device.record(made.hold, shape, [*at, *held])
        return self._device.record(made.drag, shape, [*at, descents.grip])

    def _copied(self, wanted: Any, goal: int, given: Any, out: Any) -> Any:
        inputs = [wanted, goal, given, out]
        return self._device.record(kernels.copy_grip, tuple(given.held.shape), inputs)


def _launched(recorded: list[Any]) -> None:
    for launch in recorded:
        launch.launch()
