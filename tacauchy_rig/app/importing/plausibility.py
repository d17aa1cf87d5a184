"""Is what was recorded possible on this gel? Signs, units, axis and place, before any simulation.

Forces are compared with a bonded layer's at the stated depth: beyond what any gel gives they are
refused, beyond what the sensor's file and its estimate leave open the run says so.
"""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from sim.effects.depth_and_inertia_scales import expected_force
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.scene import Target
from sim.sensor.sensor import Sensor
from tacauchy_rig.app.importing.press_detection import Press
from tacauchy_rig.app.importing.source_files import shown
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.quantities import UNITS, Dimension
from tacauchy_rig.core.run import FZ

UNLIKE = 30.0
"""Times the force expected, or a part of it: no gel, base or poor contact does that."""
LIKE = 8.0
"""Times or part that are left with the unit that is meant: thin gels and soft ones."""
ODD = 3.0
"""Times or part that is told if a unit explains it, as kgf read as N; gels are known to 2."""
MOST = 2.0
"""Times the force expected at the gel's base: more is no press."""
LEAST_N = 0.005
"""A force whose sign means something; less is noise about zero."""
LEAST_DEPTH_M = 1e-6
BESIDE_M = 2e-3
"""That a place may be beside the gel's edge."""
_CONFUSED = {
    Dimension.FORCE: (("N", "mN", "gf", "kgf", "lbf"), ("N", "mN")),
    Dimension.LENGTH: (("m", "mm", "um"), ("m", "mm", "um")),
    Dimension.PRESSURE: (("Pa", "kPa", "MPa"), ("Pa", "kPa", "MPa")),
}
"""Units that are meant, and those that are stated in their place."""
SHALLOW_M = 2e-6
"""A deepest press that is shallower leaves no image: its unit is larger than is stated."""
USUAL_SHARE = 0.12
"""Of the gel's height that a deepest press has; its unit is one with which it has that or nearly.
"""
Findings = Iterator[RecordError]


def check_presses(
    presses: Sequence[Press],
    indenters: Sequence[Indenter | None],
    sensor: Sensor,
    keys: Mapping[str, str],
    *,
    sign: int,
    notes: list[str],
) -> Findings:
    """Yield what no press of this gel has: conventions that are wrong throughout by their key.

    Args:
        indenters: Of each press; None is not known.
        keys: What declares conventions, for messages: of ``force`` and ``depth`` their unit, of
            ``force_sign`` and ``depth_sign`` what turns them, of ``place`` its columns.
        sign: Of forces in compression.
        notes: Takes what is possible and yet unlikely, a sentence each.
    """
    where = [press.where or press.name for press in presses]
    nothing = np.full((1, 6), np.nan)
    held = [nothing if press.held is None else press.held for press in presses]
    wrenches = np.array([wrench.mean(axis=0) for wrench in held]).reshape(-1, 6)
    forces = sign * wrenches[:, FZ]
    depths = np.array([press.measured_depth_m for press in presses], dtype=np.float64)
    told = [f"{at}: force {each:.4g} N" for at, each in zip(where, forces, strict=True)]
    found = [*_negative("forces", told, forces, LEAST_N, f"{keys['force_sign']} = {-sign}")]
    told = [f"{at}: depth {1e3 * each:.4g} mm" for at, each in zip(where, depths, strict=True)]
    found += _negative("depths", told, depths, LEAST_DEPTH_M, keys["depth_sign"])
    found += _unlike_depths(told, np.abs(depths), sensor.pad.height_m, keys["depth"])
    yield from found or _unlike_forces(where, indenters, forces, depths, sensor, keys, notes)
    yield from _across(wrenches[np.isfinite(forces), :3])
    yield from _beside(where, presses, sensor, keys["place"])


def _negative(
    what: str, told: Sequence[str], values: FloatArray, least: float, key: str
) -> Findings:
    """Yield values below zero: by their key where all are, else one by one."""
    below = [told[k] for k in np.flatnonzero(values < -least).tolist()]
    if below and len(below) == np.isfinite(values).sum():
        message = f"all {len(below)} {what} are negative, the first {below[0]}"
        yield RecordError(f"{message}: pressing counts positive", remedy=f"state {key}")
    elif below:
        lines = [f"{each}: pressing counts positive, as in the other presses" for each in below]
        yield RecordError(shown(lines), remedy="correct these presses, or leave them out")


def _unlike_depths(told: Sequence[str], depths: FloatArray, height_m: float, key: str) -> Findings:
    """Yield depths beyond the gel's height, or that all leave no trace."""
    deepest = float(np.max(depths, initial=0.0, where=np.isfinite(depths)))
    remedy = f"correct {key}{unit_meant(Dimension.LENGTH, deepest / (USUAL_SHARE * height_m))}"
    if deepest > height_m:
        beyond = np.flatnonzero(depths > height_m).tolist()
        lines = [f"{told[k]}; the gel is {1e3 * height_m:.3g} mm high" for k in beyond]
        yield RecordError(shown(lines), remedy=remedy)
    elif deepest < SHALLOW_M and np.isfinite(depths).any():
        message = f"the deepest press is {1e6 * deepest:.3g} um deep: no image shows that"
        yield RecordError(message, remedy=remedy)


def unit_meant(dimension: Dimension, times: float, within: float = LIKE) -> str:
    """Return what is told of numbers that are so many times too large: units with which they fit.

    The nearest is first; ``within`` is how many times, or what part, a fitting number may be.
    """
    units, (meant, stated) = UNITS[dimension], _CONFUSED[dimension]
    pairs = [(small, large) for small in meant for large in stated if small != large]
    left = {pair: abs(math.log(times * units[pair[0]] / units[pair[1]])) for pair in pairs if times}
    fitting = [pair for pair in sorted(left, key=left.__getitem__) if left[pair] < math.log(within)]
    told = " or ".join(f"{small} where {large} is stated" for small, large in fitting)
    return f": the numbers look like {told}" if fitting else ""


def _unlike_forces(
    where: Sequence[str],
    indenters: Sequence[Indenter | None],
    forces: FloatArray,
    depths: FloatArray,
    sensor: Sensor,
    keys: Mapping[str, str],
    notes: list[str],
) -> Findings:
    """Yield forces that no depth explains: by their own depth, or at most by the gel's height."""
    pairs = zip(indenters, depths.tolist(), strict=True)
    ratios = forces / np.array([_expected_n(indenter, depth, sensor) for indenter, depth in pairs])
    known = np.flatnonzero(np.isfinite(ratios)).tolist()
    middle = float(np.median(ratios[known])) if known else 1.0
    told = {k: f"{where[k]}: {forces[k]:.4g} N at {1e3 * depths[k]:.4g} mm" for k in known}
    if not 1.0 / ODD < middle < ODD:
        median = f"median of {len(known)} presses; the first: {told[known[0]]}"
        message = f"forces are {middle:.2g} times what this gel gives at their depths ({median})"
        is_unlike = not 1.0 / UNLIKE < middle < UNLIKE
        meant = unit_meant(Dimension.FORCE, abs(middle), LIKE if is_unlike else ODD)
        remedy = f"correct {keys['force']}{meant}; if it is right, correct {keys['depth']} or "
        remedy += "state the gel's modulus as rig.replay.young"
        if is_unlike:
            yield RecordError(message, remedy=remedy)
            return
        notes += [f"{message}: {remedy}."] * bool(meant)  # else the gel may be another
    if odd := [told[k] for k in known if not middle / LIKE <= ratios[k] <= middle * LIKE]:
        notes.append(f"Forces and depths unlike those of other presses: {'; '.join(odd[:3])}.")
    most = np.array([_expected_n(each, sensor.pad.height_m, sensor) for each in indenters])
    too_much = np.flatnonzero(forces > MOST * most).tolist()
    beyond = "{}: force {:.4g} N; the gel pressed to its base gives about {:.3g} N"
    if lines := [beyond.format(where[k], forces[k], most[k]) for k in too_much]:
        times = 4.0 * float(np.median(forces[too_much] / most[too_much]))
        remedy = f"correct {keys['force']}{unit_meant(Dimension.FORCE, times)}"
        yield RecordError(shown(lines), remedy=remedy)


def _expected_n(indenter: Indenter | None, depth_m: float, sensor: Sensor) -> float:
    """Return about what force a depth takes [N]; NaN of no ball or punch above the gel's base."""
    least_m = 0.0 if isinstance(indenter, Sphere | Cylinder) else 0.99 * sensor.pad.height_m
    if indenter is None or not depth_m > least_m:
        return math.nan
    return expected_force(sensor.scene(indenter, Target(depth_m=depth_m)))


def _across(forces: FloatArray) -> Findings:
    """Yield that forces are throughout along another axis than that of the press."""
    means = np.abs(forces)
    across, along = means[:, :2].max(axis=1), means[:, FZ]
    if (across > 3.0 * along).all() and across.max(initial=0.0) > 10.0 * LEAST_N:
        axis = "xy"[int(np.argmax(means[:, :2].sum(axis=0)))]
        yield RecordError(
            f"all {len(means)} presses are along the force sensor's {axis} "
            f"({across.max():.3g} N, along z {along.max():.3g} N)",
            remedy="name what is along the press as `force` (data.columns.force = the column of "
            f"force {axis}; in a bag turn the wrench)",
        )


def _beside(where: Sequence[str], presses: Sequence[Press], sensor: Sensor, key: str) -> Findings:
    """Yield places beside the gel."""
    half = np.array(sensor.pad.half_extents())
    places = np.array([press.place_m or (np.nan, np.nan) for press in presses]).reshape(-1, 2)
    beside = np.flatnonzero((np.abs(places) > half + BESIDE_M).any(axis=1))
    told = [
        f"{where[k]}: pressed at {1e3 * places[k, 0]:.4g}, {1e3 * places[k, 1]:.4g} mm; the gel "
        f"ends at {1e3 * half[0]:.3g}, {1e3 * half[1]:.3g} mm from its centre"
        for k in beside.tolist()
    ]
    if told:
        remedy = f"correct {key}: places are of the tip from the pad's centre"
        yield RecordError(shown(told), remedy=remedy)
