"""One tick of a batch: every environment is evaluated once and acts on what was found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import warp as wp

from sim.batch.contact_kernel import batch_contact, batch_surface, touchable
from sim.batch.control_kernels import (
    PRECONDITIONED,
    SUM_COUNT,
    begin,
    change_vectors,
    commit,
    decide,
    sum_up,
    turn,
)
from sim.batch.courses import extrapolation, touch_point
from sim.batch.environment import BatchOptions, Environment
from sim.batch.force_kernel import batch_gel, force_kernel
from sim.batch.phases import EVALUATE, FAILED
from sim.batch.pilot import Pilot
from sim.batch.preconditioner import preconditioner
from sim.batch.progress import iteration_limits, new_progress
from sim.device import Device

# From so many environments on, an element is one thread's instead of its quadrature points.
_CROWDED = 32
_FLOOR_SHARE = 1e-9
_EXACT = ("forces", "trials", "accepted", "before", "long_before")
_ROUGH = ("steps", "residuals", "preconditioned", "directions")
_CHANGED = (*_EXACT, "steps", "residuals")


class Tick:
    """All that a batch keeps on its device, and the launches that advance it.

    Args:
        environments: One for every column; those from ``count`` on only fill it up and never run.

    Attributes:
        busy: 1 while an environment has not passed the end of the stretch, shape [1].
        stretch_end: Frame at which the stretch ends, shape [1].
        progress: Where every environment is.
        depths: Depth of every frame where it is given [m], shape [frame_count, column_count].
        vectors: Over the unknowns, each of shape [row_count, column_count].
        push: Force on the indenter, modelled part [N], shape [frame_count, column_count].
        lifts: Of the indenter where it is pushed [m], the same shape.
        found: Residual, imbalance and smallest gap [m], each of that shape.
    """

    def __init__(
        self,
        pilot: Pilot,
        environments: Sequence[Environment],
        *,
        count: int,
        options: BatchOptions,
        device: Device,
    ) -> None:
        self._pilot, self._environments, self._count = pilot, environments, count
        self._options, self._device = options, device
        self._columns = len(environments)
        self._row_count = pilot.model.pattern.dof_count + pilot.is_pushed
        self._preconditioner = preconditioner(pilot, device)
        self._upload_pad()
        self._upload_courses()
        self._allocate()

    @property
    def launches(self) -> dict[str, Callable[[], None]]:
        """The launches of a tick in their order, by what they do."""
        return {
            "forces": self._add_forces,
            "sums": self._sum_up,
            "decision": self._decide,
            "vectors": self._change_vectors,
            "preconditioner": self._precondition,
            "record": self._commit,
            "direction": self._turn,
        }

    def run(self) -> None:
        """Launch a tick."""
        for launch in self.launches.values():
            launch()

    def begin(self, which: int, end: int) -> None:
        """Begin a stretch with one of the pilot's stiffnesses, up to a frame."""
        self._preconditioner.select(which)
        self.stretch_end.fill_(end)
        self._launch(begin, [self.progress, self.stretch_end], [self.busy])

    def reset(self) -> None:
        """Put every environment back to the untouched gel."""
        progress = self.progress
        for array in (
            *self.vectors.values(),
            *(self._sums, self._push, self.lifts),
            *(progress.frame, progress.newton, progress.trying, progress.spent),
            *(progress.halvings, progress.searches),
        ):
            array.zero_()
        for array in self.found:
            array.fill_(float("nan"))
        self.push.fill_(wp.vec3d(float("nan"), float("nan"), float("nan")))
        self._gaps.fill_(1.0)
        self._tips.assign(self._first_tips)
        phases = np.full(self._columns, EVALUATE, dtype=np.int32)
        phases[self._count :] = FAILED
        progress.phase.assign(phases)

    def _launch(self, kernel: Any, inputs: list[Any], outputs: list[Any]) -> None:
        self._device.launch(kernel, (self._columns,), inputs, outputs)

    def _add_forces(self) -> None:
        vectors, progress = self.vectors, self.progress
        self._device.launch(
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

    def _sum_up(self) -> None:
        vectors = self.vectors
        self._device.launch(
            sum_up,
            (self._parts, self._columns),
            [
                self._row_count,
                self._parts,
                self._vertical,
                self.progress,
                vectors["forces"],
                vectors["steps"],
                vectors["directions"],
            ],
            [self._sums, self.busy],
        )

    def _decide(self) -> None:
        self._launch(decide, [self._limits, self._sums, self._push], [self.progress])

    def _change_vectors(self) -> None:
        self._device.launch(
            change_vectors,
            (self._row_count, self._columns),
            [self.progress, self._shares, self._tip_row, self.vectors["directions"]],
            [*(self.vectors[name] for name in _CHANGED), self.lifts],
        )

    def _precondition(self) -> None:
        vectors = self.vectors
        self._preconditioner.apply(
            vectors["residuals"], vectors["preconditioned"], self._sums[PRECONDITIONED]
        )

    def _commit(self) -> None:
        inputs = [self._limits, self.depths, self._touch, self.stretch_end, self.progress]
        inputs += [self._sums, self._push, self._gaps]
        self._launch(commit, inputs, [self._tips, self.busy, self.push, *self.found])

    def _turn(self) -> None:
        vectors = self.vectors
        self._device.launch(
            turn,
            (self._row_count, self._columns),
            [self.progress, vectors["preconditioned"], vectors["accepted"], vectors["steps"]],
            [vectors["directions"], vectors["trials"]],
        )

    def _upload_pad(self) -> None:
        model, device = self._pilot.model, self._device
        pad = model.discretisation
        rows = np.full(3 * len(model.nodes), -1, dtype=np.int32)
        rows[model.pattern.free_dofs] = np.arange(model.pattern.dof_count, dtype=np.int32)
        device_rows = device.array(rows.reshape(-1, 3), wp.int32)
        vertical = np.append(model.pattern.free_dofs % 3 == 2, [False] * self._pilot.is_pushed)
        self._vertical = device.array(vertical, wp.int32)
        self._tip_row = model.pattern.dof_count if self._pilot.is_pushed else -1
        filled = self._environments
        constants = np.array([model.law.parameters(e.young_pa, e.poisson) for e in filled])
        alone = not device.is_gpu or self._columns >= _CROWDED
        shares = 1 if alone else len(pad.reference.weights)
        self._force_kernel = force_kernel(model.law, pad.reference.node_count)
        centres = np.array([np.add(self._pilot.centre_m, e.offset_m) for e in filled])
        kept = touchable(pad, self._pilot.indenter, np.unique(centres, axis=0))
        contact_points = int(kept.sum()) * len(pad.reference.face_weights)
        self._touching = device.zeros((contact_points, self._columns), wp.int32)
        self._force_threads = contact_points + len(pad.elements) * shares
        self._force_inputs = [
            batch_gel(pad, device_rows, constants, shares=shares, device=device),
            batch_surface(
                pad,
                device_rows,
                self._pilot.indenter,
                kept=kept,
                tip_row=self._tip_row,
                device=device,
            ),
            batch_contact(model.contact_options, extension=self._options.extension),
            device.array([e.young_pa for e in filled], wp.float64),
            device.array(np.stack([e.rotation for e in filled]), wp.mat33d),
        ]

    def _upload_courses(self) -> None:
        pilot, device = self._pilot, self._device
        courses = np.stack([e.course for e in self._environments], axis=1)
        if pilot.is_pushed:
            courses = courses / pilot.model.mesh.fold.copies
        self._shares = device.array(extrapolation(courses), wp.float64)
        depths = np.zeros_like(courses) if pilot.is_pushed else courses
        loads = courses if pilot.is_pushed else np.zeros_like(courses)
        self.depths = device.array(depths, wp.float64)
        self._force_inputs.append(device.array(loads, wp.float64))
        self._first_tips = np.array([touch_point(pilot, e) for e in self._environments])
        self._touch = device.array(self._first_tips, wp.vec3d)
        self._first_tips[:, 2] -= depths[0]

    def _allocate(self) -> None:
        device, columns, model = self._device, self._columns, self._pilot.model
        floor_n = _FLOOR_SHARE * model.young_pa * model.height_m**2
        self._limits = iteration_limits(self._options, floor_n=floor_n)
        self._parts = 256 if columns <= 64 else (64 if columns <= 256 else 32)
        size = (self._preconditioner.row_count, columns)
        self.vectors = {name: device.zeros(size, wp.float64) for name in _EXACT}
        self.vectors |= {name: device.zeros(size, wp.float32) for name in _ROUGH}
        self._sums = device.zeros((SUM_COUNT, columns), wp.float64)
        self.progress = new_progress(columns, device)
        self._tips, self._push = (device.zeros(columns, wp.vec3d) for _ in range(2))
        self._gaps = device.zeros(columns, wp.float64)
        self.busy, self.stretch_end = (device.zeros(1, wp.int32) for _ in range(2))
        shape = (len(self._environments[0].course), columns)
        self.push = device.zeros(shape, wp.vec3d)
        self.lifts = device.zeros(shape, wp.float64)
        # Residual, imbalance and gap, as ``commit`` takes them.
        self.found = [device.zeros(shape, wp.float64) for _ in range(3)]
