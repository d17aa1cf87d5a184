"""What uncertain inputs of a press change: its force at a measured depth, and the image's residual.

Coarse presses with the input one standard uncertainty up and down (GUM 5.1.3, note 2) give the
change. Its size is averaged, so that an input at an extremum of the force, such as no tilt, counts.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import partial

import numpy as np

from reports.evidence.evidence_types import TrialImages
from reports.evidence.frames_and_curves import AttemptReading
from reports.figures.trial_axis import spread
from reports.scores.residual_causes import Cause, Mode, split_residual
from sim.effects.planned_effects import full_plan
from sim.effects.press_with_effects import path_for
from sim.fields.saved_press import SurfaceState, surface_state
from sim.optics.markers.marker_tracking import find_markers
from sim.scene.indenter import Cylinder, Indenter, MeshIndenter, Sphere
from sim.scene.pad import BoxPad, SurfacePad
from sim.scene.scene import Preset
from sim.tilt_sensitivity import COARSE, FINER, can_tilt, kept_forces
from tacauchy_rig.app.replay.chosen_optics import OpticalCalibration
from tacauchy_rig.app.replay.rendering import image_of
from tacauchy_rig.app.replay.simulator_inputs import ReplayInputs
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.config.settings import RigConfig, Stated, stated_uncertainty
from tacauchy_rig.core.errors import ConfigError, RigError
from tacauchy_rig.core.simulated import ForceInput, FoundValue, ResidualSplit
from tacauchy_rig.core.time_limit_and_progress import say

_DEPTHS = 4
"""At which an input is tried; between them its change is interpolated."""
NEARLY_UPRIGHT = 1e-9
"""A tilt [rad] or shift [m] that is negligible, but gives the press an unmirrored mesh."""
_ROUNDED_M = 0.1e-3
"""A sharp rim takes eight times as long and fails on long edges. Rounding it alters the changes by
nu, height, diameter and tilt by less than a tenth."""
_FOOTPRINT_POINTS = 64
"""Along either side of the box around a footprint."""
_DIMENSIONS = {
    "gel height": "height",
    "dome along x": "dome_radius_x",
    "dome along y": "dome_radius_y",
}


@dataclass(frozen=True, slots=True)
class Variation:
    """An uncertain input, and the press with it changed."""

    name: str
    value: float  # SI, as ``unit`` has it
    unit: str
    stated: Stated  # its standard uncertainty
    # From a difference to the inputs of a replay; raises ConfigError if that is impossible
    changed: Callable[[float], ReplayInputs]
    _: KW_ONLY
    aside: bool = False  # both signs are equivalent, and no press is mirrored
    # A coarse mesh exaggerates the change, so a finer one is tried first
    stiff_if_coarse: bool = False


def force_inputs(
    inputs: ReplayInputs,
    config: RigConfig,
    depths_m: Sequence[float],
    found: Sequence[FoundValue] = (),
) -> tuple[ForceInput, ...]:
    """Return how much every uncertain input changes the force at measured depths.

    Args:
        inputs: Of the replay, with the stated modulus.
        depths_m: Measured depths [m], counted from the contact force; without any nothing is
            tried.
    """
    if not depths_m:
        return ()
    most_m, least_m = max(depths_m), min(depths_m)
    tried_m = np.unique(np.linspace(least_m, most_m, _DEPTHS))
    stiffest_n = [max(config.protocol.force_targets)]
    contact_n = config.protocol.contact_force
    inputs = replace(inputs, tolerance=None)  # that would choose a preset, of which none is asked
    inputs, how = _quick(inputs, most_m)

    def pressed(changed: ReplayInputs, refinement: float) -> FloatArray:
        scene = replace(changed, sensor=changed.sensor.with_gel(relaxation=())).scene(stiffest_n)
        scene = replace(scene, indenter=rounded_rim(scene.indenter))
        return kept_forces(
            scene, tried_m.tolist(), refinement=refinement, contact_force_n=contact_n
        )

    tried = [_tried(each, pressed, tried_m) for each in variations(inputs, config, found=found)]
    return tuple(replace(each, basis=f"{each.basis}{how}") for each in tried)


def _quick(inputs: ReplayInputs, depth_m: float) -> tuple[ReplayInputs, str]:
    """Return a press that takes a second in place of triangles that take minutes, and a note of it.

    A round punch of the same footprint in a flat pad depends alike on height and Poisson's ratio.
    """
    indenter, pad, how = inputs.indenter, inputs.sensor.pad, ""
    if isinstance(indenter, MeshIndenter):
        half_m = 0.5 * indenter.size_m[:2].max()
        side = np.linspace(-half_m, half_m, _FOOTPRINT_POINTS)
        touched = indenter.lower_surface(*np.meshgrid(side, side)) <= depth_m
        area_m2 = (2.0 * half_m) ** 2 * float(touched.mean())
        diameter_m = 2.0 * math.sqrt(max(area_m2, (2.0 * _ROUNDED_M) ** 2) / math.pi)
        indenter, how = Cylinder(diameter_m=diameter_m, fillet_m=0.0), "; tried on a round punch"
    if isinstance(pad, SurfacePad):
        half_x, half_y = pad.half_extents()
        pad = BoxPad(size_x_m=2.0 * half_x, size_y_m=2.0 * half_y, height_m=pad.height_m)
        how += "; tried on a flat pad"
    return replace(inputs, indenter=indenter, sensor=replace(inputs.sensor, pad=pad)), how


def _tried(
    each: Variation, pressed: Callable[[ReplayInputs, float], FloatArray], depths_m: FloatArray
) -> ForceInput:
    by = each.stated.value
    known = partial(
        ForceInput,
        name=each.name,
        basis=f"{_shown(each)}: {each.stated.source}",
        depths_m=tuple(depths_m.tolist()),
    )
    if by == 0.0:
        return known(changes=(0.0,) * len(depths_m))
    # Under a ball edges follow its contact: by a ring more or less they change its force by 12 % on
    # long edges, by 1 % on these.
    fine = each.stiff_if_coarse or isinstance(each.changed(0.0).indenter, Sphere)
    for refinement in (FINER, COARSE) if fine else (COARSE, FINER):
        try:
            base = pressed(each.changed(NEARLY_UPRIGHT if each.aside else 0.0), refinement)
            steps = [by] if each.aside else [by, -by]
            sides = [pressed(inputs, refinement) for inputs in _possible(each, steps)]
        except RigError as error:
            failure = error.message
            continue
        changes = np.mean([np.abs(side / base - 1.0) for side in sides], axis=0)
        return known(changes=tuple(changes.tolist()))
    return ForceInput(name=each.name, basis=f"unknown: no coarse press: {failure}")


def rounded_rim(indenter: Indenter) -> Indenter:
    """Return a punch with its sharp rim rounded, for what else changes its force."""
    if not isinstance(indenter, Cylinder):
        return indenter
    return replace(indenter, fillet_m=indenter.fillet_m or min(_ROUNDED_M, 0.5 * indenter.radius_m))


def _possible(each: Variation, steps: Sequence[float]) -> list[ReplayInputs]:
    """Return the inputs of steps that can be; a fillet below zero cannot."""
    found = []
    for step in steps:
        try:
            found.append(each.changed(step))
        except ConfigError as error:
            refused = error
    if not found:
        raise refused
    return found


def variations(
    inputs: ReplayInputs, config: RigConfig, *, found: Sequence[FoundValue] = ()
) -> Iterator[Variation]:
    """Yield what is uncertain of a press besides its modulus."""
    yield from _of_gel(inputs)
    yield from _of_indenter(inputs, config)
    yield from _of_mounting(inputs, config, {value.name: value for value in found})


def _of_gel(inputs: ReplayInputs) -> Iterator[Variation]:
    sensor, pad = inputs.sensor, inputs.sensor.pad
    number = sensor.least_certain_poisson
    yield Variation(
        "Poisson's ratio",
        number.value,
        "",
        Stated(value=number.uncertainty, source=number.source),
        lambda by: replace(inputs, sensor=sensor.with_poisson(by)),
        stiff_if_coarse=True,
    )
    for name, key in _DIMENSIONS.items():
        size = sensor.numbers.get(f"pad.{key}")
        if size is None or not isinstance(pad, BoxPad):
            continue

        def other_size(by: float, field: str = f"{key}_m") -> ReplayInputs:
            other = replace(pad, **{field: getattr(pad, field) + by})
            return replace(inputs, sensor=replace(sensor, pad=other))

        stated = Stated(value=size.uncertainty, source=size.source)
        yield Variation(name, size.value, "m", stated, other_size)


def _of_indenter(inputs: ReplayInputs, config: RigConfig) -> Iterator[Variation]:
    body = inputs.indenter

    def other_body(by: float, *, field: str, of: Indenter) -> ReplayInputs:
        return replace(inputs, indenter=replace(of, **{field: getattr(of, field) + by}))

    def rougher(by: float) -> ReplayInputs:
        if inputs.friction + by < 0.0:
            raise ConfigError("friction below 0", remedy="give 0 or more")
        return replace(inputs, friction=inputs.friction + by)

    if isinstance(body, Cylinder | Sphere):
        stated = stated_uncertainty(config, "diameter")
        wider = partial(other_body, field="diameter_m", of=body)
        yield Variation("indenter's diameter", body.diameter_m, "m", stated, wider)
    if isinstance(body, Cylinder):
        yield Variation(
            "indenter's fillet",
            body.fillet_m,
            "m",
            stated_uncertainty(config, "fillet"),
            partial(other_body, field="fillet_m", of=rounded_rim(body)),
            stiff_if_coarse=True,
        )
    yield Variation(
        "friction", inputs.friction, "", stated_uncertainty(config, "friction"), rougher
    )


def _of_mounting(
    inputs: ReplayInputs, config: RigConfig, found: dict[str, FoundValue]
) -> Iterator[Variation]:
    if can_tilt(inputs.indenter):
        stated = _of_found(found, "lean towards", stated_uncertainty(config, "tilt"))
        size = math.hypot(*inputs.tilt_rad)
        tilted = partial(inputs.tilted, y_rad=0.0)
        yield Variation("tilt of the indenter", size, "rad", stated, tilted, aside=True)
    stated = _of_found(found, "offset along", stated_uncertainty(config, "offset"))
    size = math.hypot(*inputs.offset_m)
    yield Variation(
        "place of the indenter", size, "m", stated, lambda by: inputs.moved((by, 0.0)), aside=True
    )


def _of_found(found: dict[str, FoundValue], name: str, default: Stated) -> Stated:
    """Return how uncertain both components of what was found are together."""
    parts, basis = [], default.source
    for axis in "xy":
        each = found.get(f"{name} {axis}")
        if each is None or each.uncertainty is None or each.value is None:
            return Stated(value=math.sqrt(2.0) * default.value, source=default.source)
        parts += [each.uncertainty, 0.0 if each.taken else each.value]
        basis = each.basis
    return Stated(value=math.hypot(*parts), source=basis)


def _shown(each: Variation) -> str:
    factor, unit = {"m": (1e3, " mm"), "rad": (180.0 / math.pi, " deg"), "": (1.0, "")}[each.unit]
    return f"{factor * each.value:.4g} +- {factor * each.stated.value:.2g}{unit}"


MOST_TRIALS, _MOST_PARTS = 12, 6
"""Trials that are pressed again, spread evenly over the forces: each takes two seconds."""
# Steps: large against the scatter of a coarse mesh, small against the curvature of the response
# (steps half as large find half of a planted tilt or modulus).
_MORE = 1.15
_TILT_RAD = math.radians(1.0)
_POISSON = -0.02
# Assumed standard uncertainties: of a lamp's brightness by ageing or another exposure, of light
# drifting within a press, of the lens's blur and of the scale since the calibration.
_LAMP, _DRIFT, _BLUR_PX, _SCALE = 0.1, 0.02, 0.3, 0.01
_UNIFORM = 1.0 / math.sqrt(3.0)
_COLOURS = ("red", "green", "blue")
Images = dict[int, FloatArray]


def split_images(
    parts: Sequence[tuple[ReplayInputs, Sequence[AttemptReading]]],
    images: Mapping[int, ImageArray],
    forces_n: Mapping[int, float],
    optics: OpticalCalibration,
    config: RigConfig,
) -> ResidualSplit | None:
    """Split the residual of a replay's images by its causes; None where that is not possible.

    Args:
        parts: Trials of one indenter at one place, with the modulus that they were pressed with.
            Each has its own coarse presses; the unknowns are common to all.
        forces_n: Simulated, for trials without a measured one [N].
    """
    pressable = [part for part in parts if not isinstance(part[0].indenter, MeshIndenter)]
    if len(pressable) < len(parts):
        say("  the residual is not split for mesh indenters: their presses take minutes")
    found = [(inputs, _presses(attempts, images, forces_n)) for inputs, attempts in pressable]
    chosen = spread([part for part in found if part[1]], _MOST_PARTS)
    again = [
        _Again(spread(presses, MOST_TRIALS // len(chosen)), inputs, optics, config)
        for inputs, presses in chosen
    ]
    seen = {press.index: press.images for part in again for press in part.presses}
    view, offset_m = optics.geometry, stated_uncertainty(config, "offset").value
    try:
        return split_residual(
            seen,
            {index: image for index, image in images.items() if index in seen},
            (mode for part in again for mode in part.modes()),
            pose_px=(offset_m / view.scale_x_m, offset_m / view.scale_y_m),
        )
    except RigError as error:
        say(f"  the residual is not split because a coarse press failed: {error.message}")
        return None


@dataclass(frozen=True, slots=True)
class _Press:
    """A trial's force [N] and images; ``bare`` is its no-contact frame without markers."""

    index: int
    force_n: float
    images: TrialImages
    bare: ImageArray


def _presses(
    attempts: Sequence[AttemptReading],
    images: Mapping[int, ImageArray],
    forces_n: Mapping[int, float],
) -> list[_Press]:
    """Return those that can be pressed again, the smallest force first."""
    found = []
    for attempt in attempts:
        record = attempt.record
        force_n = record.force_measured_n or forces_n.get(record.index, 0.0)
        if force_n <= 0.0 or record.index not in images or attempt.images is None:
            continue
        reference = attempt.images.reference
        markers = find_markers(reference)
        bare = reference if markers is None else markers.bare
        found.append(_Press(record.index, force_n, attempt.images, bare))
    return sorted(found, key=lambda press: press.force_n)


@dataclass(frozen=True, slots=True)
class _Again:
    """The presses of a run again, coarsely, the smallest force first."""

    presses: Sequence[_Press]
    inputs: ReplayInputs
    optics: OpticalCalibration
    config: RigConfig

    def modes(self) -> Iterator[Mode]:
        """Yield every mode."""
        say(f"  {len(self.presses)} images: coarse presses with other forces")
        forces_n = [press.force_n for press in self.presses]
        tried = sorted({f * by for f in forces_n for by in (1.0 / _MORE, 1.0, _MORE)})
        upright = self._pressed(self.inputs.tilted(NEARLY_UPRIGHT, 0.0), tried)
        pressed = dict(zip(tried, upright, strict=True))
        less, even, more = ([pressed[f * by] for f in forces_n] for by in (1.0 / _MORE, 1.0, _MORE))
        base = self._seen(even)
        by_force = _apart(self._seen(more), self._seen(less), 1.0 / (_MORE - 1.0 / _MORE))
        yield from self._of_force(by_force)
        say("  coarse presses with another Poisson's ratio and other tilts")
        yield from self._of_material(by_force, base)
        if can_tilt(self.inputs.indenter):
            yield from self._of_tilt()
        change = {press.index: base[press.index] - press.bare for press in self.presses}
        say("  images with other lamps, blur and scale")
        yield from self._of_light(change)
        yield from self._of_optics(change, even, base)

    def _of_force(self, by_force: Images) -> Iterator[Mode]:
        """Yield errors of the force: in proportion, the same in all trials, of one trial."""
        scale = stated_uncertainty(self.config, "force_scale").value
        yield Mode("force, in proportion", Cause.FORCE, scale, "1", _times(by_force, scale))
        zero_n = _UNIFORM * self.config.protocol.drift
        of_zero = {p.index: zero_n / p.force_n * by_force[p.index] for p in self.presses}
        yield Mode("force, all trials alike", Cause.FORCE, zero_n, "N", of_zero)
        for index, changed in of_zero.items():
            yield Mode(f"force of trial {index}", Cause.FORCE, zero_n, "N", {index: changed})

    def _of_material(self, by_force: Images, base: Images) -> Iterator[Mode]:
        """Yield modulus and Poisson's ratio; a stiffer gel answers like a smaller force."""
        sensor = self.inputs.sensor
        young = sensor.young_uncertainty()[0]
        yield Mode("modulus", Cause.MATERIAL, young, "1", _times(by_force, -young))
        ratio = sensor.least_certain_poisson.uncertainty
        other = replace(
            self.inputs.tilted(NEARLY_UPRIGHT, 0.0), sensor=sensor.with_poisson(_POISSON)
        )
        changed = _apart(self._seen(self._pressed(other)), base, ratio / _POISSON)
        yield Mode("Poisson's ratio", Cause.MATERIAL, ratio, "1", changed)

    def _of_tilt(self) -> Iterator[Mode]:
        size = stated_uncertainty(self.config, "tilt").value
        for name, (x, y) in (("x", (_TILT_RAD, 0.0)), ("y", (0.0, _TILT_RAD))):
            there, back = (
                self._seen(self._pressed(self.inputs.tilted(sign * x, sign * y)))
                for sign in (1, -1)
            )
            changed = _apart(there, back, 0.5 * size / _TILT_RAD)
            yield Mode(f"lean towards {name}", Cause.TILT, size, "rad", changed)

    def _of_light(self, change: Images) -> Iterator[Mode]:
        """Yield lamps of another brightness, and light that drifts from frame to frame."""
        for k, colour in enumerate(_COLOURS):
            only = np.eye(3)[k]
            lamp = {i: _LAMP * only * each for i, each in change.items()}
            yield Mode(f"{colour} lamp", Cause.LIGHT, _LAMP, "1", lamp)
            drift = {press.index: _DRIFT * only * press.bare for press in self.presses}
            since = f"{colour} light since the no-contact frame"
            yield Mode(since, Cause.LIGHT, _DRIFT, "1", drift)

    def _of_optics(
        self, change: Images, surfaces: Sequence[SurfaceState], base: Images
    ) -> Iterator[Mode]:
        """Yield gradients of brightness over the image, the lens's blur, and the scale."""
        view = self.optics.geometry
        for name, count, axis in (("x", view.width, 1), ("y", view.height, 0)):
            along = np.expand_dims(np.linspace(-1.0, 1.0, count), (2, 1 - axis))
            for k, colour in enumerate(_COLOURS):
                bent = {i: _LAMP * np.eye(3)[k] * along * each for i, each in change.items()}
                yield Mode(f"{colour} lamp along {name}", Cause.OPTICS, _LAMP, "1", bent)
        blurred = replace(self.optics, blur_px=self.optics.blur_px + _BLUR_PX)
        changed = _apart(self._seen(surfaces, blurred), base, 1.0)
        yield Mode("blur", Cause.OPTICS, _BLUR_PX, "px", changed)
        for name in "xy":
            wide = {f"scale_{name}_m": getattr(view, f"scale_{name}_m") * (1.0 + _SCALE)}
            scaled = replace(self.optics, geometry=replace(view, **wide))
            changed = _apart(self._seen(surfaces, scaled), base, 1.0)
            yield Mode(f"scale along {name}", Cause.OPTICS, _SCALE, "1", changed)

    def _pressed(
        self, inputs: ReplayInputs, forces_n: Sequence[float] | None = None
    ) -> list[SurfaceState]:
        """Press to rising forces [N]; None is those that were measured."""
        measured = [press.force_n for press in self.presses]
        plain = replace(inputs, sensor=inputs.sensor.with_gel(relaxation=()), tolerance=None)
        # One mesh for all: under a ball it follows the largest force.
        scene = plain.scene([_MORE * measured[-1]])
        coarse = replace(
            scene,
            indenter=rounded_rim(scene.indenter),
            preset=Preset.FAST,
            refinement=COARSE,
            outputs=frozenset(),
        )
        path = path_for(coarse, full_plan(coarse))
        return [surface_state(path, path.push(force_n)) for force_n in forces_n or measured]

    def _seen(
        self, surfaces: Sequence[SurfaceState], optics: OpticalCalibration | None = None
    ) -> Images:
        sensor, seen = self.inputs.sensor, optics or self.optics
        return {
            press.index: image_of(surface, sensor, seen, unloaded=press.bare).astype(np.float64)
            for press, surface in zip(self.presses, surfaces, strict=True)
        }


def _times(images: Images, factor: float) -> Images:
    return {index: factor * image for index, image in images.items()}


def _apart(images: Images, others: Images, factor: float) -> Images:
    return {index: factor * (image - others[index]) for index, image in images.items()}
