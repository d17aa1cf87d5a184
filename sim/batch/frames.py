"""The launches that take a batch through frames, and what they find; on a GPU one graph."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim.batch import frame_kernels as kernels
from sim.batch.sensor_model import ForceBias
from sim.device import Device, on_host
from sim.solve.descents import Descents
from tacauchy_rig.core.arrays import FloatArray

# Steps of a descent between two looks at who has arrived: a look is nine launches.
_STEPS_ON_GPU = 2


class Frames:
    """Takes environments from pose to pose, each at its own pace.

    Args:
        bias: Of the mesh, by which loads are corrected.
        accepts_residual: A descent that ran out of steps counts as arrived.

    Attributes:
        motions: Where they go, a ``frame_kernels.Motions``.
        found: What they found, a ``frame_kernels.Found``; NaN where they did not arrive.
    """

    def __init__(
        self,
        descents: Descents,
        history: Any,
        frame_count: int,
        *,
        bias: ForceBias,
        floor_n: float,
        accepts_residual: bool,
    ) -> None:
        self._descents, self._history, count = descents, history, descents.count
        self._device = device = Device(descents.model.device)
        shape, own = (frame_count, count), (count,)
        self.motions = device.zeroed(kernels.Motions, shape, frame=own, done=own, enough=(2,))
        self.found = device.zeroed(kernels.Found, shape, touched=(*shape, 7))
        self._graph: Any = None
        constant = device.array(bias.constant, wp.float64)
        self._begin, self._end = self._recorded([floor_n, constant, bias.slope], accepts_residual)

    def go(
        self,
        begun: FloatArray,
        goals: FloatArray,
        going: NDArray[np.bool_],
        *,
        parts: NDArray[np.int32],
        loads_n: FloatArray | None,
        enough: tuple[float, float],
        halvings_max: int,
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Go to goals, in more and more parts where the descents do not arrive.

        Args:
            begun: Poses where they are, shape [count, 7].
            goals: Of the frames, shape [frame_count, count, 7].
            parts: In how many parts each frame is gone, shape [frame_count, count].
            enough: Residual over the contact force at a frame's end, and before.
            halvings_max: Of a frame's parts.

        Returns:
            Quaternions where they end, shape [count, 4], and who arrived.
        """
        frame_count, count = parts.shape
        starts = np.concatenate([begun[None], goals[:-1]])
        before = Rotation.from_quat(starts[..., 3:].reshape(-1, 4))
        turned = Rotation.from_quat(goals[..., 3:].reshape(-1, 4)) * before.inv()
        ways = {
            "tips": starts[..., :3].copy(),
            "travels": goals[..., :3] - starts[..., :3],
            "rotations": before.as_matrix().reshape(frame_count, count, 3, 3),
            "turns": turned.as_rotvec().reshape(frame_count, count, 3),
            "parts": parts.copy(),
        }
        motions, found = self.motions, self.found
        if loads_n is not None:
            motions.loads.assign(loads_n)
        motions.enough.assign(np.array(enough))
        motions.frame.zero_()
        for array in (found.touched, found.residual, found.imbalance):
            array.fill_(np.nan)
        found.evaluations.zero_()
        missing, halved, at = going.copy(), np.zeros(count, np.int32), np.zeros(count, np.int32)
        while missing.any():
            for name, values in ways.items():
                getattr(motions, name).assign(values)
            motions.done.zero_()
            self._history.moves.assign(missing.astype(np.int32))
            self._run()
            frame, done = on_host(motions.frame).copy(), on_host(motions.done).copy()
            halved = np.where(frame > at, 0, halved)
            at, went = frame, missing.copy()
            missing &= (at < frame_count) & (halved < halvings_max)
            halved += 1
            which = np.flatnonzero(went & (at < frame_count))
            _go_on_from(ways, at[which], which, done[which])
        quaternions = goals[-1, :, 3:].copy()
        short = np.flatnonzero(at < frame_count)
        if len(short):
            stays = Rotation.from_matrix(ways["rotations"][at[short], short])
            quaternions[short] = stays.as_quat()
        return quaternions, going & (at == frame_count)

    def _run(self) -> None:
        if self._graph is not None:
            wp.capture_launch(self._graph)
            return
        self._launch()
        if self._device.is_gpu:  # its kernels are compiled now, which a graph cannot
            with wp.ScopedCapture(device=self._device.name) as capture:
                self._launch()
            self._graph = capture.graph

    def _launch(self) -> None:
        busy = self._descents.busy
        busy.zero_()
        for each in self._begin:
            each.launch()
        wp.capture_while(busy, while_body=self._iterate)

    def _iterate(self) -> None:
        for _ in range(_STEPS_ON_GPU if self._device.is_gpu else 1):
            self._descents.step()
        for each in (*self._end, *self._begin):
            each.launch()

    def _recorded(self, biased: list[Any], accepts_residual: bool) -> tuple[list[Any], list[Any]]:
        """Record what begins a part, and what ends one."""
        descents, history, record = self._descents, self._history, self._device.record
        model, state, poses = descents.model, descents.state, descents.poses
        own, nodes = (descents.count,), tuple(descents.positions.shape)
        points = tuple(descents.contact_buffers[1].shape)
        made = model.surface.kernels(descents.indenter)
        options, grip, kept = model.contact_options, descents.grip, descents.grip_start
        begun = [options.friction > 0.0, self.motions, history, poses, state, descents.memory]
        put = [history, descents.positions, descents.gel_buffers[0], descents.contact_buffers[0]]
        begin = [record(kernels.begin, own, [*begun, descents.busy])]
        at = [descents.surface, descents.body, history.arrives, poses]
        now = [state, poses, self.motions, history, self.found]
        end = [
            record(kernels.arrive, own, [accepts_residual, state, poses, history]),
            record(made.wrench, points, [*at, grip, descents.positions, history.touched]),
            record(kernels.note, own, [*biased, *now]),
        ]
        if options.is_tangential:
            # One that did not arrive may have left other grips than it began with.
            begin.append(record(kernels.copy_grip, points, [history.starts, kept, grip]))
            moved = [*at, descents.positions]
            if options.bonded:
                held = [kept, grip, *descents.contact_buffers[:2], *descents.grip_buffers]
                end.append(record(made.hold, points, [*moved, *held]))
            else:
                end.append(record(made.drag, points, [*moved, grip]))
            end.append(record(kernels.copy_grip, points, [history.arrives, grip, kept]))
        begin.append(record(kernels.predict, nodes, put))
        end.append(record(kernels.remember, nodes, [descents.positions, history]))
        return begin, end


def _go_on_from(
    ways: dict[str, Any], at: NDArray[np.int32], which: NDArray[np.intp], done: NDArray[np.int32]
) -> None:
    """Let environments' next frames begin where they are, in twice as many parts."""
    here = at, which
    share = (done / ways["parts"][here])[:, None]
    begun = Rotation.from_rotvec(share * ways["turns"][here])
    turned = begun * Rotation.from_matrix(ways["rotations"][here])
    ways["tips"][here] += share * ways["travels"][here]
    ways["rotations"][here] = turned.as_matrix()
    for name in ("travels", "turns"):
        ways[name][here] *= 1.0 - share
    ways["parts"][here] = 2 * np.maximum(ways["parts"][here] - done, 1)
