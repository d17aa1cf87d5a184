"""One iteration of a batch: every environment is evaluated once and acts on what was found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import warp as wp

from sim.batch.environment import BatchOptions, Environment, extrapolation, touch_point
from sim.batch.kernels.contact_forces import batch_surface, contact_points, touchable
from sim.batch.kernels.element_forces import TANGENT_SIZE, Tangents, batch_gel
from sim.batch.kernels.evaluate import evaluate_kernel
from sim.batch.kernels.gathering import evaluating, numbering, searching
from sim.batch.kernels.search import search_kernel
from sim.batch.kernels.state import (
    EVALUATE,
    FAILED,
    Found,
    Limits,
    Progress,
    Vectors,
    clear,
    zeroed,
)
from sim.batch.kernels.surface_stress import StressExtraction
from sim.batch.kernels.turn import begin, turn
from sim.batch.pilot import Pilot, preconditioner
from sim.device import Device, filled

# A residual that is always enough, over E H^2 with the pad's height H.
_FLOOR_SHARE = 1e-9


def iteration_limits(options: BatchOptions, *, floor_n: float) -> Any:
    """Return the limits as the kernels take them."""
    limits: Any = Limits
    shared = {name: getattr(options, name) for name in limits.vars if name != "floor"}
    return filled(limits, floor=floor_n, **shared)


class Iteration:
    """All that a batch keeps on its device, and the launches that advance it.

    Args:
        environments: One for every column; those from ``count`` on only fill it up and never run.

    Attributes:
        busy: 1 while an environment has not passed the end of the segment, shape [1].
        segment_end: Frame at which the segment ends, shape [1].
        progress: Where every environment is.
        depths: Depth of every frame where it is given [m], shape [frame_count, column_count].
        vectors: Over the unknowns.
        lifts: Of the indenter where it is pushed [m], shape [frame_count, column_count].
        found: What every frame gives.
        stress: The surface's stress at the last frame of each environment.
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
        self._aside = wp.Stream(device.name) if device.is_gpu else None
        self._preconditioner = preconditioner(pilot, device)
        self._upload_pad()
        self._upload_load_histories()
        self._allocate()

    @property
    def launches(self) -> dict[str, Callable[[], None]]:
        """The launches of an iteration in their order, by what they do."""
        return {
            "forces": self._evaluate,
            "search": self._search,
            "preconditioner": self._precondition,
            "turn": self._turn,
        }

    def run(self) -> None:
        """Launch one; on a GPU forces and searches, of unlike environments, side by side."""
        if self._aside is None:
            self._evaluate()
            self._search()
        else:
            main = wp.get_stream(self._device.name)
            self._aside.wait_stream(main)
            with wp.ScopedStream(self._aside, sync_enter=False):
                self._evaluate()
            self._search()
            main.wait_stream(self._aside)
        self._precondition()
        self._turn()

    def begin(self, which: int, end: int) -> None:
        """Begin a segment with one of the pilot's stiffnesses, up to a frame."""
        self._preconditioner.select(which)
        self.segment_end.fill_(end)
        self._device.launch(begin, (self._columns,), [self.progress, self.segment_end], [self.busy])

    def reset(self) -> None:
        """Put every environment back to the untouched gel."""
        found = self.found
        clear(Vectors, self.vectors)
        clear(Progress, self.progress)
        for array in (self.sources, self.lifts):
            array.zero_()
        for array in (found.residual, found.imbalance, found.gap):
            array.fill_(float("nan"))
        found.push.fill_(wp.vec3d(float("nan"), float("nan"), float("nan")))
        self._tips.assign(self._first_tips)
        statuses = np.full(self._columns, EVALUATE, dtype=np.int32)
        statuses[self._count :] = FAILED
        self.progress.status.assign(statuses)

    def _evaluate(self) -> None:
        self._device.launch_blocks(
            self._evaluate_kernel,
            self._columns,
            [
                *(self._limits, self._gel, self._surface),
                *(self._evaluate_gathering, self._shares, self._loads, self._tips),
                self.segment_end,
            ],
            [
                *(self.progress, self.vectors, self._contact, self._tangents),
                *(self.sources, self.lifts, self.busy),
            ],
            threads=self._evaluating.threads,
        )

    def _search(self) -> None:
        self._device.launch_blocks(
            self._search_kernel,
            self._columns,
            [
                *(self._limits, self._gel, self._surface, self._search_gathering),
                *(self._tangents, self.segment_end),
            ],
            [self.progress, self.vectors, self._contact, self.sources],
            threads=self._searching.threads,
        )

    def _precondition(self) -> None:
        self._preconditioner.apply(self.sources, self.vectors.preconditioned)

    def _turn(self) -> None:
        self._device.launch_blocks(
            turn,
            self._columns,
            [
                *(self._limits, self._row_count, self._preconditioner.unit),
                *(self.depths, self._touch, self.segment_end),
            ],
            [
                *(self.progress, self.vectors, self._tips, self.found, self.busy),
            ],
            threads=self._searching.threads,
        )

    def _upload_pad(self) -> None:
        pilot, device = self._pilot, self._device
        model, environments = pilot.model, self._environments
        pad = model.discretisation
        centres = np.array([np.add(pilot.centre_m, e.offset_m) for e in environments])
        kept = touchable(pad, pilot.indenter, np.unique(centres, axis=0))
        numbered = self._numbered = numbering(model.pattern, is_pushed=pilot.is_pushed)
        self._row_count = numbered.row_count
        self._evaluating = evaluating(self._columns, self._row_count)
        self._searching = searching(self._columns, self._row_count)
        self._evaluate_gathering, self._search_gathering = (
            numbered.gathering(pad.elements, pad.faces[kept], chunk=layout.chunk, device=device)
            for layout in (self._evaluating, self._searching)
        )
        materials = [(e.young_pa, e.poisson) for e in environments]
        self._gel = batch_gel(pad, numbered, model.law, materials, device)
        tangent_count = TANGENT_SIZE * self._gel.weights.size
        self._tangents = zeroed(Tangents, (self._columns, tangent_count), device)
        self._surface = batch_surface(
            pad,
            numbered,
            pilot.indenter,
            rotations=np.stack([e.rotation for e in environments]),
            young_pa=[e.young_pa for e in environments],
            kept=kept,
            contact=model.contact_options,
            extension=self._options.extension,
            device=device,
        )
        self._contact = contact_points(self._columns, self._surface, device)
        order = pad.reference.order
        self._evaluate_kernel = evaluate_kernel(model.law, order, self._evaluating)
        self._search_kernel = search_kernel(order, self._searching)

    def _upload_load_histories(self) -> None:
        pilot, device = self._pilot, self._device
        load_histories = np.stack([e.load_history for e in self._environments], axis=1)
        if pilot.is_pushed:
            load_histories = load_histories / pilot.model.mesh.symmetry.copies
        self._shares = device.array(extrapolation(load_histories), wp.float64)
        depths = np.zeros_like(load_histories) if pilot.is_pushed else load_histories
        loads = load_histories if pilot.is_pushed else np.zeros_like(load_histories)
        self.depths = device.array(depths, wp.float64)
        self._loads = device.array(loads, wp.float64)
        self._first_tips = np.array([touch_point(pilot, e) for e in self._environments])
        self._touch = device.array(self._first_tips, wp.vec3d)
        self._first_tips[:, 2] -= depths[0]

    def _allocate(self) -> None:
        device, columns, model = self._device, self._columns, self._pilot.model
        floor_n = _FLOOR_SHARE * model.young_pa * model.height_m**2
        self._limits = iteration_limits(self._options, floor_n=floor_n)
        # A row more than there are unknowns stays zero, for what is fixed.
        rows = max(self._preconditioner.row_count, self._row_count + 1)
        self.vectors = zeroed(Vectors, (columns, rows), device)
        self.stress = StressExtraction(
            model.discretisation,
            self._numbered,
            model.law,
            self._gel,
            self.vectors.before,
            environment_count=self._count,
            device=device,
        )
        self.sources = device.zeros((columns, rows), self._preconditioner.kind)
        self.progress = zeroed(Progress, columns, device)
        self._tips = device.zeros(columns, wp.vec3d)
        self.busy, self.segment_end = (device.zeros(1, wp.int32) for _ in range(2))
        shape = (len(self._environments[0].load_history), columns)
        self.lifts = device.zeros(shape, wp.float64)
        self.found = zeroed(Found, shape, device)
