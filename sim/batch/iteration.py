"""One tick of a batch: every environment is evaluated once and acts on what was found."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import warp as wp

from sim.batch.environment import BatchOptions, Environment
from sim.batch.kernels.contact_forces import batch_contact, batch_surface, contact_points, touchable
from sim.batch.kernels.element_forces import batch_gel, new_tangents
from sim.batch.kernels.evaluate import evaluate_kernel
from sim.batch.kernels.search import search_kernel
from sim.batch.kernels.surface_stress import StressExtraction
from sim.batch.kernels.turn import Found, begin, turn
from sim.batch.layout import evaluating, searching
from sim.batch.load_histories import extrapolation, touch_point
from sim.batch.numbering import numbering
from sim.batch.phases import EVALUATE, FAILED
from sim.batch.pilot import Pilot
from sim.batch.preconditioner import preconditioner
from sim.batch.progress import iteration_limits, new_progress
from sim.batch.vectors import clear, new_vectors
from sim.device import Device

_FLOOR_SHARE = 1e-9


class Tick:
    """All that a batch keeps on its device, and the launches that advance it.

    Args:
        environments: One for every column; those from ``count`` on only fill it up and never run.

    Attributes:
        busy: 1 while an environment has not passed the end of the stretch, shape [1].
        stretch_end: Frame at which the stretch ends, shape [1].
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
        self._upload_courses()
        self._allocate()

    @property
    def launches(self) -> dict[str, Callable[[], None]]:
        """The launches of a tick in their order, by what they do."""
        return {
            "forces": self._evaluate,
            "search": self._search,
            "preconditioner": self._precondition,
            "turn": self._turn,
        }

    def run(self) -> None:
        """Launch a tick; on a GPU forces and searches, of unlike environments, side by side."""
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
        """Begin a stretch with one of the pilot's stiffnesses, up to a frame."""
        self._preconditioner.select(which)
        self.stretch_end.fill_(end)
        self._device.launch(begin, (self._columns,), [self.progress, self.stretch_end], [self.busy])

    def reset(self) -> None:
        """Put every environment back to the untouched gel."""
        progress, found = self.progress, self.found
        clear(self.vectors)
        for array in (
            *(self.sources, self.lifts, progress.gap),
            *(progress.frame, progress.newton, progress.trying, progress.spent),
            *(progress.halvings, progress.searches, progress.retries),
        ):
            array.zero_()
        for array in (found.residual, found.imbalance, found.gap):
            array.fill_(float("nan"))
        found.push.fill_(wp.vec3d(float("nan"), float("nan"), float("nan")))
        self._tips.assign(self._first_tips)
        phases = np.full(self._columns, EVALUATE, dtype=np.int32)
        phases[self._count :] = FAILED
        progress.phase.assign(phases)

    def _evaluate(self) -> None:
        self._device.launch_blocks(
            self._evaluate_kernel,
            self._columns,
            [
                *(self._limits, self._gel, self._surface, self._contact_settings),
                *(self._evaluate_gathering, self._shares, self._loads, self._tips),
                self.stretch_end,
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
                *(self._tangents, self.stretch_end),
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
                *(self.depths, self._touch, self.stretch_end),
            ],
            [
                *(self.progress, self.vectors, self._tips, self.found, self.busy),
            ],
            threads=self._searching.threads,
        )

    def _upload_pad(self) -> None:
        pilot, device = self._pilot, self._device
        model, filled = pilot.model, self._environments
        pad = model.discretisation
        centres = np.array([np.add(pilot.centre_m, e.offset_m) for e in filled])
        kept = touchable(pad, pilot.indenter, np.unique(centres, axis=0))
        numbered = self._numbered = numbering(pilot)
        self._row_count = numbered.row_count
        self._evaluating = evaluating(self._columns, self._row_count)
        self._searching = searching(self._columns, self._row_count)
        self._evaluate_gathering, self._search_gathering = (
            numbered.gathering(pad.elements, pad.faces[kept], chunk=layout.chunk, device=device)
            for layout in (self._evaluating, self._searching)
        )
        self._gel = batch_gel(pad, numbered, model.law, filled, device)
        self._tangents = new_tangents(self._columns, self._gel, device)
        self._surface = batch_surface(pad, numbered, pilot, filled, kept=kept, device=device)
        self._contact = contact_points(self._columns, self._surface, device)
        self._contact_settings = batch_contact(
            model.contact_options, extension=self._options.extension
        )
        order = pad.reference.order
        self._evaluate_kernel = evaluate_kernel(model.law, order, self._evaluating)
        self._search_kernel = search_kernel(order, self._searching)

    def _upload_courses(self) -> None:
        pilot, device = self._pilot, self._device
        courses = np.stack([e.course for e in self._environments], axis=1)
        if pilot.is_pushed:
            courses = courses / pilot.model.mesh.symmetry.copies
        self._shares = device.array(extrapolation(courses), wp.float64)
        depths = np.zeros_like(courses) if pilot.is_pushed else courses
        loads = courses if pilot.is_pushed else np.zeros_like(courses)
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
        self.vectors = new_vectors(columns, rows, device)
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
        self.progress = new_progress(columns, device)
        self._tips = device.zeros(columns, wp.vec3d)
        self.busy, self.stretch_end = (device.zeros(1, wp.int32) for _ in range(2))
        shape = (len(self._environments[0].course), columns)
        self.lifts = device.zeros(shape, wp.float64)
        self.found = Found()
        self.found.push = device.zeros(shape, wp.vec3d)
        for name in ("residual", "imbalance", "gap"):
            setattr(self.found, name, device.zeros(shape, wp.float64))
