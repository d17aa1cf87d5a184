"""Is what was recorded possible on this gel? Signs, units, axis and place, before any simulation.

Forces are compared with Hertz's on a half-space at the stated depth: the base below a thin gel
makes it several times stiffer, a wrong unit a hundred or a thousand times.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.sensor.sensor import Sensor
from tacauchy_rig.app.importing.press_detection import Press
from tacauchy_rig.app.importing.source_files import Problems, shown
from tacauchy_rig.core.arrays import BoolArray, FloatArray
from tacauchy_rig.core.quantities import UNITS, Dimension
from tacauchy_rig.core.run import FZ

UNLIKE = 30.0
"""Times Hertz's force, or a part of it: no gel, base or poor contact does that."""
LIKE = 8.0
"""Times or part that are left with the unit that is meant: thin gels and soft ones."""
LEAST_N = 0.005
"""A force whose sign means something; less is noise about zero."""
LEAST_DEPTH_M = 1e-6
BESIDE_M = 2e-3
"""That a place may be beside the gel's edge."""
_COMMON = ("N", "mN", "gf")
"""Units of force whose confusion is told."""
SHALLOW_M = 2e-6
"""A deepest press that is shallower leaves no image: its unit is larger than is stated."""


def check_presses(
    presses: Sequence[Press],
    indenters: Sequence[Indenter | None],
    sensor: Sensor,
    keys: Mapping[str, str],
    *,
    sign: int,
    problems: Problems,
) -> None:
    """Note what no press of this gel has: conventions that are wrong throughout by their key.

    Args:
        indenters: Of each press; None is not known.
        keys: What declares conventions, for messages: of ``force`` and ``depth`` their unit, of
            ``force_sign`` and ``depth_sign`` what turns them, of ``place`` its columns.
        sign: Of forces in compression.
    """
    where = [press.where or press.name for press in presses]
    nothing = np.full((1, 6), np.nan)
    held = [nothing if press.held is None else press.held for press in presses]
    wrenches = np.array([wrench.mean(axis=0) for wrench in held]).reshape(-1, 6)
    forces = sign * wrenches[:, FZ]
    depths = np.array([press.measured_depth_m for press in presses], dtype=np.float64)
    turned = f"{keys['force_sign']} = {-sign}"
    is_pulled = _check_sign(where, "force", "N", forces, LEAST_N, turned, problems)
    is_raised = _check_sign(
        where, "depth", "mm", 1e3 * depths, 1e3 * LEAST_DEPTH_M, keys["depth_sign"], problems
    )
    is_odd = _check_depths(where, np.abs(depths), sensor.pad.height_m, keys["depth"], problems)
    if not (is_pulled or is_raised or is_odd):
        _check_forces(where, indenters, forces, depths, sensor, keys["force"], problems)
    _check_axis(wrenches[np.isfinite(forces), :3], problems)
    _check_places(where, presses, sensor, keys["place"], problems)


def _check_sign(
    where: Sequence[str],
    what: str,
    unit: str,
    values: FloatArray,
    least: float,
    key: str,
    problems: Problems,
) -> bool:
    """Note values below zero; return whether there are any."""
    known, below = int(np.isfinite(values).sum()), np.flatnonzero(values < -least)
    told = [f"{where[k]}: {what} {values[k]:.4g} {unit}" for k in below.tolist()]
    if told and len(told) == known:
        problems.add(
            f"all {known} {what}s are negative, the first {told[0]}: pressing counts positive",
            remedy=f"state {key}",
        )
    elif told:
        problems.add(
            shown([f"{each}: pressing counts positive, as in the other presses" for each in told]),
            remedy="correct these presses, or leave them out",
        )
    return bool(told)


def _check_depths(
    where: Sequence[str], depths: FloatArray, height_m: float, key: str, problems: Problems
) -> bool:
    """Note depths beyond the gel's height, and depths that leave no trace."""
    deepest = float(np.nanmax(depths)) if np.isfinite(depths).any() else math.nan
    beyond = np.flatnonzero(depths > height_m)
    if len(beyond):
        told = [
            f"{where[k]}: depth {1e3 * depths[k]:.4g} mm; the gel is {1e3 * height_m:.3g} mm high"
            for k in beyond.tolist()
        ]
        unit = length_unit_meant(deepest, 0.02 * height_m, 0.9 * height_m)
        problems.add(shown(told), remedy=f"correct {key}{unit}")
    elif deepest < SHALLOW_M:
        unit = length_unit_meant(deepest, 0.01 * height_m, 0.9 * height_m)
        problems.add(
            f"the deepest press is {1e6 * deepest:.3g} um deep: no image shows that",
            remedy=f"correct {key}{unit}",
        )
    return bool(len(beyond)) or deepest < SHALLOW_M


def length_unit_meant(value: float, low: float, high: float) -> str:
    """Return what is told of the unit that brings a length [m] into a range."""
    units = {name: UNITS[Dimension.LENGTH][name] for name in ("m", "mm", "um")}
    return _looks_like(
        [
            (small, large)
            for small in units
            for large in units
            if small != large and low <= value * units[small] / units[large] <= high
        ]
    )


def _looks_like(fitting: Sequence[tuple[str, str]]) -> str:
    """Return what is told of pairs of a unit that fits and the one that is stated."""
    told = " or ".join(f"{small} where {large} is stated" for small, large in fitting)
    return f": the numbers look like {told}" if fitting else ""


def _check_forces(
    where: Sequence[str],
    indenters: Sequence[Indenter | None],
    forces: FloatArray,
    depths: FloatArray,
    sensor: Sensor,
    key: str,
    problems: Problems,
) -> None:
    """Note forces that no depth explains, by their own depth or at most by the gel's height."""
    pairs = zip(indenters, depths.tolist(), strict=True)
    at_depth = np.array([_hertz_n(indenter, depth_m, sensor) for indenter, depth_m in pairs])
    ratios = forces / np.where(at_depth > 0.0, at_depth, np.nan)
    known = np.flatnonzero(np.isfinite(ratios))
    middle = float(np.median(ratios[known])) if len(known) else 1.0
    if not 1.0 / UNLIKE < middle < UNLIKE:
        k = int(known[0])
        problems.add(
            f"forces are {middle:.3g} times what this gel gives at their depths (median of "
            f"{len(known)} presses; the first: {where[k]}: {forces[k]:.4g} N at "
            f"{1e3 * depths[k]:.4g} mm)",
            remedy=f"correct {key}{force_unit_meant(middle)}; if it is right, state the gel's "
            "modulus as rig.replay.young",
        )
        return
    most = np.array([_hertz_n(each, sensor.pad.height_m, sensor) for each in indenters])
    too_much = np.flatnonzero(forces > LIKE * most)
    told = [
        f"{where[k]}: force {forces[k]:.4g} N; the gel pressed to its base gives about "
        f"{most[k]:.3g} N"
        for k in too_much.tolist()
    ]
    if told:
        factor = float(np.median(forces[too_much] / most[too_much]))
        problems.add(shown(told), remedy=f"correct {key}{force_unit_meant(4.0 * factor)}")


def force_unit_meant(times: float) -> str:
    """Return what is told of units with which forces would fit that are so many times too large.

    Of all that bring them near one, the nearest first.
    """
    units = UNITS[Dimension.FORCE]
    pairs = [(small, large) for small in units for large in ("N", "mN") if small != large]
    times = max(times, 1e-300)
    left = {pair: abs(math.log(times * units[pair[0]] / units[pair[1]])) for pair in pairs}
    found = [pair for pair in sorted(pairs, key=left.__getitem__) if left[pair] < math.log(LIKE)]
    fitting = [small for small, large in found if large == found[0][1] and small in _COMMON]
    return _looks_like([(" or ".join(fitting), found[0][1])]) if fitting else ""


def _hertz_n(indenter: Indenter | None, depth_m: float, sensor: Sensor) -> float:
    """Return the force of an indenter on a half-space of the gel's material [N].

    A ball's by Hertz, a flat punch's by Sneddon; of others the gel's whole area at that strain,
    which is more than any gives.
    """
    material, pad = sensor.material, sensor.pad
    modulus_pa = material.young_pa / (1.0 - material.poisson**2)
    if isinstance(indenter, Sphere):
        root = math.sqrt(indenter.diameter_m / 2.0 * abs(depth_m) ** 3)
        return 4.0 / 3.0 * modulus_pa * root
    if isinstance(indenter, Cylinder):
        return modulus_pa * indenter.diameter_m * abs(depth_m)
    if not depth_m >= pad.height_m:  # or it is not known
        return math.nan
    return modulus_pa * 4.0 * math.prod(pad.half_extents()) / LIKE


def _check_axis(forces: FloatArray, problems: Problems) -> None:
    """Note forces that are throughout along another axis than that of the press."""
    if not len(forces) or not np.isfinite(forces).all():
        return
    means = np.abs(forces)
    across = means[:, :2].max(axis=1)
    if (across > 3.0 * means[:, FZ]).all() and across.max() > 10.0 * LEAST_N:
        axis = "xy"[int(np.argmax(means[:, :2].sum(axis=0)))]
        problems.add(
            f"all {len(means)} presses are along the force sensor's {axis} "
            f"({across.max():.3g} N, along z {means[:, FZ].max():.3g} N)",
            remedy=f"name what is along the press as `force` (data.columns.force = the column of "
            f"force {axis}; in a bag turn the wrench)",
        )


def _check_places(
    where: Sequence[str], presses: Sequence[Press], sensor: Sensor, key: str, problems: Problems
) -> None:
    """Note places beside the gel."""
    half = np.array(sensor.pad.half_extents())
    places = np.array([press.place_m or (np.nan, np.nan) for press in presses]).reshape(-1, 2)
    beside: BoolArray = np.asarray((np.abs(places) > half + BESIDE_M).any(axis=1))
    told = [
        f"{where[k]}: pressed at {1e3 * places[k, 0]:.4g}, {1e3 * places[k, 1]:.4g} mm; the gel "
        f"ends at {1e3 * half[0]:.3g}, {1e3 * half[1]:.3g} mm from its centre"
        for k in np.flatnonzero(beside).tolist()
    ]
    if told:
        problems.add(
            shown(told), remedy=f"correct {key}: places are of the tip from the pad's centre"
        )
