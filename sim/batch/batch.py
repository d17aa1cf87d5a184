"""A batch of presses: many environments over one rest mesh advance together.

Each environment has a material, a pose of the indenter and a course of depths or loads of its own.
Newton's equations are solved by conjugate gradients, preconditioned with the dense inverses of the
stiffness at a few depths of one pilot press, contact included. All environments share these, so
that applying them is one product of two matrices. Environments go through frames, Newton's and
conjugate gradients' iterations each at its own pace; the next inverse takes over when the last of
them has passed the depth up to which the old one is the nearest. On a GPU such a stretch is one
CUDA graph: the host waits for its end and does nothing else. On the CPU the same kernels run.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from sim.arrays import FloatArray
from sim.batch.contact_kernel import batch_contact, batch_surface, touchable
from sim.batch.control_kernels import (
    PRECONDITIONED,
    SUM_COUNT,
    begin,
    change_vectors,
    commit,
    decide,
    iteration_limits,
    new_progress,
    sum_up,
    turn,
)
from sim.batch.dense import DenseProduct, padded_columns
from sim.batch.environment import BatchOptions, BatchResult, Environment
from sim.batch.force_kernel import batch_gel, force_kernel
from sim.batch.phases import EVALUATE, FAILED
from sim.batch.pilot import Pilot
from sim.device import Device, on_host
from sim.touch import touch_height
from tacauchy_rig.errors import ConfigError

# The body of a graph's loop: a few ticks to one test whether anybody is still busy.
_TICKS = 4
# From so many environments on, an element is one thread's instead of its quadrature points.
_CROWDED = 32
_FLOOR_SHARE = 1e-9
_EXACT = ("forces", "trials", "accepted", "before", "long_before")
_ROUGH = ("steps", "residuals", "preconditioned", "directions")
_CHANGED = (*_EXACT, "steps", "residuals")


class Batch:
    """Environments over one pad, ready to be pressed again and again.

    Args:
        pilot: Pad, indenter and preconditioners.
        environments: What differs.
        device: Warp device, ``cpu`` or ``cuda:0``.

    Raises:
        ConfigError: The environments do not fit together or to the pilot.
    """

    def __init__(
        self,
        pilot: Pilot,
        environments: Sequence[Environment],
        *,
        options: BatchOptions | None = None,
        device: str = "cpu",
    ) -> None:
        self.pilot, self.options = pilot, options or BatchOptions()
        self.environments = list(environments)
        self._check()
        self._device = Device(device)
        count = len(self.environments)
        self._columns = padded_columns(count) if self._device.is_gpu else count
        self._row_count = pilot.model.pattern.dof_count + pilot.is_pushed
        self._product = DenseProduct(pilot.inverses, device=self._device)
        self._upload_pad()
        self._upload_courses()
        self._allocate()
        self._graphs: list[Any] = []

    @property
    def frame_count(self) -> int:
        """Frames of every environment."""
        return len(self.environments[0].course)

    def prepare(self) -> None:
        """Compile the kernels and, on a GPU, record the graphs, so that ``press`` need not."""
        if self._graphs:
            return
        self._reset()
        self._tick()
        if self._device.is_gpu:
            for stretch in range(len(self._stretches)):
                with wp.ScopedCapture(device=self._device.name) as capture:
                    self._go(stretch)
                self._graphs.append(capture.graph)

    def press(self) -> BatchResult:
        """Press every environment along its course from the untouched gel."""
        self.prepare()
        self._reset()
        self._device.synchronise()
        started = time.perf_counter()
        for stretch in range(len(self._stretches)):
            if self._graphs:
                wp.capture_launch(self._graphs[stretch])
            else:
                self._go(stretch)
        self._device.synchronise()
        return self._result(time.perf_counter() - started)

    def displacements(self) -> FloatArray:
        """Return the last frames' nodal displacements [m], [environment_count, node_count, 3]."""
        pattern, count = self.pilot.model.pattern, len(self.environments)
        found = on_host(self._vectors["before"])[: pattern.dof_count, :count]
        return np.stack([pattern.nodal(column) for column in found.T])

    def _go(self, stretch: int) -> None:
        """Go on to the end of a stretch."""
        which, end = self._stretches[stretch]
        self._product.which.fill_(which)
        self._stretch_end.fill_(end)
        inputs = [self._progress, self._stretch_end]
        self._device.launch(begin, (self._columns,), inputs, [self._busy])
        wp.capture_while(self._busy, while_body=self._ticks)

    def _ticks(self) -> None:
        for _ in range(_TICKS if self._device.is_gpu else 1):
            self._tick()

    def _tick(self) -> None:
        """Evaluate once for every environment, and let each act on it."""
        progress, vectors, launch = self._progress, self._vectors, self._device.launch
        rows = (self._row_count, self._columns)
        launch(
            self._force_kernel,
            (self._force_threads, self._columns),
            [
                *self._force_inputs,
                progress.phase,
                progress.frame,
                self._tips,
                vectors["trials"],
                vectors["directions"],
            ],
            [self._touching, vectors["forces"], self._push, self._gaps],
        )
        launch(
            sum_up,
            (self._parts, self._columns),
            [
                self._row_count,
                self._parts,
                self._vertical,
                progress,
                vectors["forces"],
                vectors["steps"],
                vectors["directions"],
            ],
            [self._sums, self._busy],
        )
        launch(decide, (self._columns,), [self._limits, self._sums, self._push], [progress])
        launch(
            change_vectors,
            rows,
            [progress, self._shares, self._tip_row, vectors["directions"]],
            [*(vectors[name] for name in _CHANGED), self._lifts],
        )
        self._product.apply(
            vectors["residuals"], vectors["preconditioned"], self._sums[PRECONDITIONED]
        )
        launch(
            commit,
            (self._columns,),
            [
                self._limits,
                self._depths,
                self._touch,
                self._stretch_end,
                progress,
                self._sums,
                self._push,
                self._gaps,
            ],
            [self._tips, self._busy, self._found_push, *self._found],
        )
        launch(
            turn,
            rows,
            [progress, vectors["preconditioned"], vectors["accepted"], vectors["steps"]],
            [vectors["directions"], vectors["trials"]],
        )

    def _check(self) -> None:
        if not self.environments:
            raise ConfigError("a batch without environments", remedy="give at least one")
        lengths = {len(environment.course) for environment in self.environments}
        if len(lengths) > 1:
            raise ConfigError(
                "the environments of a batch have unlike numbers of frames: "
                + ", ".join(map(str, sorted(lengths))),
                remedy="give each the same number of depths or loads",
            )
        for number, environment in enumerate(self.environments):
            if environment.is_displaced == self.pilot.is_pushed:
                given, wanted = ("depths", "loads")[:: 1 if self.pilot.is_pushed else -1]
                raise ConfigError(
                    f"environment {number} has {given}, and the pilot is made for {wanted}",
                    remedy=f"give {wanted}, or make a pilot for {given}",
                )
            fold = self.pilot.model.mesh.fold
            turned = not np.array_equal(environment.rotation, np.eye(3))
            if fold.copies > 1 and (turned or environment.offset_m != (0.0, 0.0)):
                raise ConfigError(
                    f"environment {number} moves or turns the indenter, but symmetry lets only a "
                    f"{'quarter' if fold.copies == 4 else 'half'} of the pad be modelled",
                    remedy="mesh the whole pad: switch the effect symmetry off",
                )

    def _upload_pad(self) -> None:
        model, device = self.pilot.model, self._device
        pad = model.discretisation
        rows = np.full(3 * len(model.nodes), -1, dtype=np.int32)
        rows[model.pattern.free_dofs] = np.arange(model.pattern.dof_count, dtype=np.int32)
        device_rows = device.array(rows.reshape(-1, 3), wp.int32)
        vertical = np.append(model.pattern.free_dofs % 3 == 2, [False] * self.pilot.is_pushed)
        self._vertical = device.array(vertical, wp.int32)
        self._tip_row = model.pattern.dof_count if self.pilot.is_pushed else -1
        filled = self._filled()
        constants = np.array([model.law.parameters(e.young_pa, e.poisson) for e in filled])
        shares = 1 if self._columns >= _CROWDED else len(pad.reference.weights)
        self._force_kernel = force_kernel(model.law, pad.reference.node_count)
        centres = np.array([np.add(self.pilot.centre_m, e.offset_m) for e in filled])
        kept = touchable(pad, self.pilot.indenter, np.unique(centres, axis=0))
        contact_points = int(kept.sum()) * len(pad.reference.face_weights)
        self._touching = device.zeros((contact_points, self._columns), wp.int32)
        self._force_threads = contact_points + len(pad.elements) * shares
        self._force_inputs = [
            batch_gel(pad, device_rows, constants, shares=shares, device=device),
            batch_surface(
                pad,
                device_rows,
                self.pilot.indenter,
                kept=kept,
                tip_row=self._tip_row,
                device=device,
            ),
            batch_contact(model.contact_options, extension=self.options.extension),
            device.array([e.young_pa for e in filled], wp.float64),
            device.array(np.stack([e.rotation for e in filled]), wp.mat33d),
        ]

    def _upload_courses(self) -> None:
        pilot, device = self.pilot, self._device
        courses = np.stack([e.course for e in self._filled()], axis=1)
        if pilot.is_pushed:
            courses = courses / pilot.model.mesh.fold.copies
        known = courses[:, : len(self.environments)].mean(axis=1)
        nearest = pilot.nearest(known)
        self._stretches = [
            (int(which), int(np.flatnonzero(nearest == which)[-1]) + 1)
            for which in np.unique(nearest)
        ]
        self._shares = device.array(_extrapolation(courses), wp.float64)
        depths = np.zeros_like(courses) if pilot.is_pushed else courses
        loads = courses if pilot.is_pushed else np.zeros_like(courses)
        self._depths = device.array(depths, wp.float64)
        self._force_inputs.append(device.array(loads, wp.float64))
        self._first_tips = np.array([self._touch_point(e) for e in self._filled()])
        self._touch = device.array(self._first_tips, wp.vec3d)
        self._first_tips[:, 2] -= depths[0]

    def _touch_point(self, environment: Environment) -> FloatArray:
        x, y = np.add(self.pilot.centre_m, environment.offset_m)
        if environment.offset_m == (0.0, 0.0) and np.array_equal(environment.rotation, np.eye(3)):
            return np.array([x, y, self.pilot.touch_m])
        model = self.pilot.model
        height = touch_height(
            model,
            self.pilot.indenter,
            model.nodes,
            centre_m=(float(x), float(y)),
            rotation=environment.rotation,
        )
        return np.array([x, y, height])

    def _allocate(self) -> None:
        device, columns, model = self._device, self._columns, self.pilot.model
        floor_n = _FLOOR_SHARE * model.young_pa * model.height_m**2
        self._limits = iteration_limits(self.options, floor_n=floor_n)
        self._parts = 256 if columns <= 64 else (64 if columns <= 256 else 32)
        size = (self._product.row_count, columns)
        self._vectors = {name: device.zeros(size, wp.float64) for name in _EXACT}
        self._vectors |= {name: device.zeros(size, wp.float32) for name in _ROUGH}
        self._sums = device.zeros((SUM_COUNT, columns), wp.float64)
        self._progress = new_progress(columns, device)
        self._tips, self._push = (device.zeros(columns, wp.vec3d) for _ in range(2))
        self._gaps = device.zeros(columns, wp.float64)
        self._busy, self._stretch_end = (device.zeros(1, wp.int32) for _ in range(2))
        shape = (self.frame_count, columns)
        self._found_push = device.zeros(shape, wp.vec3d)
        self._lifts = device.zeros(shape, wp.float64)
        # Residual, imbalance and gap, as ``commit`` takes them.
        self._found = [device.zeros(shape, wp.float64) for _ in range(3)]

    def _reset(self) -> None:
        progress = self._progress
        for array in (
            *self._vectors.values(),
            *(self._sums, self._push, self._lifts),
            *(progress.frame, progress.newton, progress.trying, progress.spent),
            *(progress.halvings, progress.searches),
        ):
            array.zero_()
        for array in self._found:
            array.fill_(float("nan"))
        self._found_push.fill_(wp.vec3d(float("nan"), float("nan"), float("nan")))
        self._gaps.fill_(1.0)
        self._tips.assign(self._first_tips)
        phases = np.full(self._columns, EVALUATE, dtype=np.int32)
        phases[len(self.environments) :] = FAILED
        progress.phase.assign(phases)

    def _result(self, wall_s: float) -> BatchResult:
        count, fold = len(self.environments), self.pilot.model.mesh.fold
        part = on_host(self._found_push)[:, :count]
        residual, imbalance, gap = (on_host(array)[:, :count].copy() for array in self._found)
        depth = on_host(self._depths) if not self.pilot.is_pushed else -on_host(self._lifts)
        return BatchResult(
            force_n=np.sum([sign * part for sign in fold.signs()], axis=0),
            depth_m=np.where(np.isnan(residual), np.nan, depth[:, :count]),
            residual=residual,
            imbalance=imbalance,
            gap_m=gap,
            evaluations=self._progress.spent.numpy()[:count].copy(),
            wall_s=wall_s,
        )

    def _filled(self) -> list[Environment]:
        """The environments, the last repeated until the columns are full; those never run."""
        missing = self._columns - len(self.environments)
        return [*self.environments, *[self.environments[-1]] * missing]


def _extrapolation(courses: FloatArray) -> FloatArray:
    """Return the shares of the last three frames in the next one's start: Lagrange's polynomials.

    Args:
        courses: Shape [frame_count, environment_count].

    Returns:
        Shape [frame_count, environment_count, 3], newest first.
    """
    frames, count = courses.shape
    shares = np.zeros((frames, count, 3))
    shares[:, :, 0] = 1.0
    for frame in range(1, frames - 1):
        order = min(frame + 1, 3)
        known, ahead = courses[frame - order + 1 : frame + 1][::-1], courses[frame + 1]
        for k in range(order):
            others = [j for j in range(order) if j != k]
            factors = [(ahead - known[j]) / (known[k] - known[j]) for j in others]
            shares[frame, :, k] = np.prod(factors, axis=0)
    return shares
