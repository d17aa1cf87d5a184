"""Replays that are wrong on purpose, most of them by as much as one likes."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from reports.evidence.evidence_types import RunEvidence
from reports.evidence.frames_and_curves import RunReading
from sim.fields.saved_press import SurfaceState
from sim.optics.colour.photometric import PhotometricModel
from sim.scene.indenter import Cylinder
from sim.scene.pad import BoxPad
from sim.scene.scene import Preset
from tacauchy_rig.app.replay.chosen_optics import nominal_optics
from tacauchy_rig.core.errors import ConfigError
from tests.studies.verdict.bench import Bench

SEED = 20261122  # of which colour of the lamps aged how


STEPS_TO_DOUBLE = 2
"""Sizes until one is twice as large: as fine as the smallest that is caught is known."""


@dataclass(frozen=True, slots=True)
class WrongModel:
    """One way of being wrong."""

    name: str  # in a few words
    # What the report then sees; the size is in ``unit``.
    evidence: Callable[[Bench, float], RunEvidence]
    hides: str = ""  # why less is not caught, in a clause
    size: float = 0.0  # the wrong model's own; zero for one that is a matter of kind
    unit: str = ""  # of the size
    smaller: int = 0  # so many sizes are looked at below its own
    larger: int = 0  # so many above

    @property
    def sizes(self) -> tuple[float, ...]:
        """Sizes to look at, the smallest first."""
        return tuple(
            self.size * 2.0 ** (k / STEPS_TO_DOUBLE) for k in range(-self.smaller, self.larger + 1)
        )


def _stiffer_gel(bench: Bench, percent: float) -> RunEvidence:
    sensor = bench.inputs.sensor.stiffer(1.0 + 0.01 * percent)
    return bench.evidence(bench.press(replace(bench.inputs, sensor=sensor)))


def _weak_cell(bench: Bench, percent: float) -> RunEvidence:
    """Let the cell read less than is there."""
    share = 1.0 - 0.01 * percent
    run = RunReading(bench.run.store, bench.run.geometry)
    for index, record in run.records.items():
        if record is not None and record.force_measured_n is not None:
            less = replace(record, force_measured_n=share * record.force_measured_n)
            run.records[index] = less
    read = replace(bench, run=run)
    return read.evidence(read.press(bench.inputs))


def _rounder(bench: Bench, added_mm: float) -> RunEvidence:
    indenter = bench.inputs.indenter
    if not isinstance(indenter, Cylinder):
        raise ConfigError("a ball has no fillet", remedy="take a run with a cylinder")
    other = replace(indenter, fillet_m=indenter.fillet_m + 1e-3 * added_mm)
    return bench.evidence(bench.press(replace(bench.inputs, indenter=other)))


def _thicker(bench: Bench, percent: float) -> RunEvidence:
    sensor = bench.inputs.sensor
    pad = sensor.pad
    if not isinstance(pad, BoxPad):
        raise ConfigError("only a box has a height to change", remedy="take another sensor")
    pad = replace(pad, height_m=pad.height_m * (1.0 + 0.01 * percent))
    return bench.evidence(bench.press(replace(bench.inputs, sensor=replace(sensor, pad=pad))))


def _tilted(bench: Bench, degrees: float) -> RunEvidence:
    return bench.evidence(bench.press_first(bench.inputs.tilted(0.0, -math.radians(degrees))))


def _aside(bench: Bench, off_mm: float) -> RunEvidence:
    view = bench.optics.geometry
    moved = replace(view, centre_x_px=view.centre_x_px + 1e-3 * off_mm / view.scale_x_m)
    return bench.evidence(optics=replace(bench.optics, geometry=moved))


def _aged(bench: Bench, percent: float) -> RunEvidence:
    """Let each colour of the lamps have changed, by so much in the root mean square."""
    drawn = np.random.default_rng(SEED).standard_normal(3)
    gain = 1.0 + 0.01 * percent * drawn / math.sqrt(float(np.mean(drawn**2)))
    model = bench.optics.model
    if not isinstance(model, PhotometricModel):
        raise ConfigError("only coloured lamps age by colour", remedy="take another sensor")
    aged = replace(
        model,
        coefficients=model.coefficients * gain,
        term_coefficients=model.term_coefficients * gain,
    )
    return bench.evidence(optics=replace(bench.optics, model=aged))


def _uncalibrated(bench: Bench, _: float) -> RunEvidence:
    return bench.evidence(optics=nominal_optics(bench.inputs.sensor))


def _penetrated(bench: Bench, percent: float) -> RunEvidence:
    """Blend the gel's surface with that of a renderer that cuts the indenter out of it."""

    def cut(surface: SurfaceState) -> SurfaceState:
        rest = surface.positions_rest
        bottom = surface.indenter_height(rest[:, 0], rest[:, 1])
        rigid = rest.copy()
        rigid[:, 2] = np.fmin(rest[:, 2], bottom)
        share = 0.01 * percent
        return replace(surface, positions=(1.0 - share) * surface.positions + share * rigid)

    true = bench.pressed
    fields = {i: replace(f, surface=cut(f.surface)) for i, f in true.fields.items()}
    return bench.evidence(replace(true, fields=fields))


def _papers_mesh(bench: Bench, _: float) -> RunEvidence:
    return bench.evidence(bench.press(replace(bench.inputs, preset=Preset.PAPER, tolerance=None)))


def _no_contact(bench: Bench, _: float) -> RunEvidence:
    attempts = {index: bench.run.attempt(index) for index in bench.trials}
    seen = {i: attempt.reference for i, attempt in attempts.items() if attempt is not None}
    return bench.evidence_with({i: image for i, image in seen.items() if image is not None})


def _shuffled(bench: Bench, _: float) -> RunEvidence:
    """Show in each trial what belongs to the next larger force, which is hardest to tell apart."""
    trials = bench.trials
    return bench.evidence_with(
        {i: bench.images[k] for i, k in zip(trials, [*trials[1:], trials[0]], strict=True)}
    )


def _swapped(bench: Bench, _: float) -> RunEvidence:
    """Exchange the images of two trials only: those of the two largest forces."""
    second, last = bench.trials[-2:]
    swapped = {second: bench.images[last], last: bench.images[second]}
    return bench.evidence_with({**bench.images, **swapped})


_STATED = (
    "the sensor's file states the modulus to {uncertainty}; one flat punch tells modulus, height"
    " and the cell's scale only together, and images are the same after the fit"
)

_RIM = "the rim's rise is small beside the depth"
_FILLET = "the rim's image changes by less than what the renderer leaves unexplained"
_PLACE = "an arm repeats a pose to 0.03 mm, and the limit is twice that"
_COLOURS = "colours that change against one another are no force; only the residual sees them"
_SKIRT = "the skirt is a little too steep"

WRONG_MODELS = (
    WrongModel("indenter tilted (smallest force only)", _tilted, _RIM, 2.0, "deg", 4, 0),
    WrongModel("press beside its place", _aside, _PLACE, 0.1, "mm", 6, 1),
    WrongModel("fillet larger than it is", _rounder, _FILLET, 0.1, "mm", 4, 2),
    WrongModel("gel stiffer than it is", _stiffer_gel, _STATED, 10.0, "%", 4, 5),
    WrongModel("gel thicker than it is", _thicker, _STATED, 10.0, "%", 4, 5),
    WrongModel("force sensor reads too little", _weak_cell, _STATED, 50.0, "%", 9, 0),
    WrongModel("optics of last year: colours of the lamps", _aged, _COLOURS, 20.0, "%", 10, 0),
    WrongModel("renderer of rigid penetration, blended in", _penetrated, _SKIRT, 100.0, "%", 10, 0),
    WrongModel("optics never calibrated", _uncalibrated),
    WrongModel("the paper's mesh", _papers_mesh),
    WrongModel("no contact in any image", _no_contact),
    WrongModel("images of the trials shuffled", _shuffled),
    WrongModel("images of the two largest forces exchanged", _swapped),
)
