"""How much each uncertain input of a press changes the force at a measured depth.

Coarse presses with the input one standard uncertainty up and down (GUM 5.1.3, note 2) give the
change. Its size is averaged, so that an input at an extremum of the force, such as no tilt, counts.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import partial

import numpy as np

from sim.scene.indenter import Cylinder, Indenter, MeshIndenter, Sphere
from sim.scene.pad import BoxPad, SurfacePad
from sim.tilt_sensitivity import COARSE, FINER, can_tilt, kept_forces
from tacauchy_rig.app.replay.simulator_inputs import ReplayInputs
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.config.stated_uncertainty import Stated, stated_uncertainty
from tacauchy_rig.core.errors import ConfigError, RigError
from tacauchy_rig.core.simulated import ForceInput, FoundValue

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
        scene = replace(changed, sensor=changed.sensor.relaxing(())).scene(stiffest_n)
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
