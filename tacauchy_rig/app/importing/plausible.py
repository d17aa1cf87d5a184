"""Is what was recorded possible on this gel? Signs, units, axis and place, before any simulation.

Forces are compared with Hertz's on a half-space at the stated depth: the base below a thin gel
makes it several times stiffer, a wrong unit a hundred or a thousand times.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.sensor.sensor import Sensor
from tacauchy_rig.app.importing.presses import Press
from tacauchy_rig.app.importing.problems import Problems, shown
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.quantities import UNITS, Dimension
from tacauchy_rig.core.run import FZ

UNLIKE = 30.0
"""Times Hertz's force, or a part of it: no gel, base or poor contact does that."""
LIKE = 8.0
"""Times or part that are left with the unit that is meant: thin gels and soft ones."""
LEAST_N = 0.005
"""A force whose sign means something; less is noise about zero."""
DEEPEST = 1.0
"""Of the gel's height."""
BESIDE_M = 2e-3
"""That a place may be beside the gel's edge."""
_COMMON = ("N", "mN", "gf")
"""Units of force whose confusion is told."""
SHALLOW_M = 2e-6
"""A deepest press that is shallower leaves no image: its unit is larger than is stated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pressed:
    """What is known of a press; NaN is not known.

    Attributes:
        where: In the source, for messages.
        force_n: Along the axis, positive in compression [N].
    """

    where: str
    indenter: Indenter | None
    force_n: float = math.nan
    depth_m: float = math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class Keys:
    """What declares conventions, for messages.

    Attributes:
        force_sign: Key and value that turn the sign of forces; likewise of depths.
        force: Key of their unit; likewise of depths and places.
    """

    force_sign: str
    force: str
    depth_sign: str
    depth: str
    place: str = ""


def check_presses(
    presses: Sequence[Press],
    indenters: Sequence[Indenter | None],
    sensor: Sensor,
    keys: Keys,
    *,
    sign: int,
    problems: Problems,
) -> None:
    """Note what no press of this gel has: conventions that are wrong throughout by their key.

    Args:
        indenters: Of each press; None is not known.
        sign: Of forces in compression.
    """
    held = [press.held for press in presses]
    pressed = [
        Pressed(
            where=press.where or f"press {press.name}",
            indenter=indenter,
            force_n=math.nan if wrench is None else sign * float(wrench[:, FZ].mean()),
            depth_m=math.nan if press.measured_depth_m is None else press.measured_depth_m,
        )
        for press, indenter, wrench in zip(presses, indenters, held, strict=True)
    ]
    check_forces_and_depths(pressed, sensor, keys, problems)
    _check_axis([wrench for wrench in held if wrench is not None], problems)
    _check_places(presses, sensor, keys, problems)


def check_forces_and_depths(
    pressed: Sequence[Pressed], sensor: Sensor, keys: Keys, problems: Problems
) -> None:
    """Note signs and sizes of forces and depths that no press of this gel has."""
    forces = np.array([each.force_n for each in pressed])
    depths = np.array([each.depth_m for each in pressed])
    wrong_sign = [
        _check_sign(pressed, forces, "force", "N", keys.force_sign, LEAST_N, problems),
        _check_sign(pressed, 1e3 * depths, "depth", "mm", keys.depth_sign, 1e-3, problems),
    ]
    height = sensor.pad.height_m
    by_depth = _check_depths(pressed, np.abs(depths), height, keys.depth, problems)
    if not any(wrong_sign) and not by_depth:
        _check_forces(pressed, forces, depths, sensor, keys.force, problems)


def _check_sign(
    pressed: Sequence[Pressed],
    values: FloatArray,
    what: str,
    unit: str,
    key: str,
    least: float,
    problems: Problems,
) -> bool:
    """Note values below zero; return whether there are any."""
    known, below = int(np.isfinite(values).sum()), np.flatnonzero(values < -least)
    if not len(below):
        return False
    told = [f"{pressed[k].where}: {what} {values[k]:.4g} {unit}" for k in below.tolist()]
    if len(below) == known:
        problems.add(
            f"all {known} {what}s are negative, the first {told[0]}: pressing counts positive",
            remedy=f"state {key}",
        )
    else:
        problems.add(
            shown([f"{each}: pressing counts positive, as in the other presses" for each in told]),
            remedy="correct these presses, or leave them out",
        )
    return True


def _check_depths(
    pressed: Sequence[Pressed], depths: FloatArray, height_m: float, key: str, problems: Problems
) -> bool:
    """Note depths beyond the gel's height, and depths that leave no trace."""
    beyond = np.flatnonzero(depths > DEEPEST * height_m)
    if len(beyond):
        known = depths[np.isfinite(depths)]
        unit = _meant(known, 0.02 * height_m, 0.9 * height_m, Dimension.LENGTH)
        told = [
            f"{pressed[k].where}: depth {1e3 * depths[k]:.4g} mm; the gel is "
            f"{1e3 * height_m:.3g} mm high"
            for k in beyond.tolist()
        ]
        problems.add(shown(told), remedy=f"correct {key}" + unit)
    elif np.isfinite(depths).any() and np.nanmax(depths) < SHALLOW_M:
        deepest = float(np.nanmax(depths))
        unit = _meant(np.array([deepest]), 0.01 * height_m, 0.9 * height_m, Dimension.LENGTH)
        problems.add(
            f"the deepest press is {1e6 * deepest:.3g} um deep: no image shows that",
            remedy=f"correct {key}" + unit,
        )
    else:
        return False
    return True


def _meant(values: FloatArray, low: float, high: float, dimension: Dimension) -> str:
    """Return what is told of the unit that brings the largest value into a range."""
    fitting = [
        f"{small} where {large} is stated"
        for small, of_small in UNITS[dimension].items()
        for large, of_large in UNITS[dimension].items()
        if small != large
        and low <= float(values.max()) * of_small / of_large <= high
        and {small, large} <= {"m", "mm", "um"}
    ]
    return f": the numbers look like {' or '.join(fitting)}" if fitting else ""


def _check_forces(
    pressed: Sequence[Pressed],
    forces: FloatArray,
    depths: FloatArray,
    sensor: Sensor,
    key: str,
    problems: Problems,
) -> None:
    """Note forces that no depth explains, by their own depth or at most by the gel's height."""
    at_depth = np.array(
        [hertz_n(each.indenter, d, sensor) for each, d in zip(pressed, depths, strict=True)]
    )
    ratios = forces / np.where(at_depth > 0.0, at_depth, np.nan)
    known = ratios[np.isfinite(ratios)]
    most = np.array([hertz_n(each.indenter, sensor.pad.height_m, sensor) for each in pressed])
    if len(known) and not 1.0 / UNLIKE < (middle := float(np.median(known))) < UNLIKE:
        problems.add(
            f"forces are {middle:.3g} times what this gel gives at their depths (median of "
            f"{len(known)} presses; the first: {_first(pressed, ratios)})",
            remedy=f"correct {key}{unit_meant(middle)}; if it is right, state the gel's modulus as "
            "rig.replay.young",
        )
        return
    too_much = np.flatnonzero(forces > LIKE * most)
    told = [
        f"{pressed[k].where}: force {forces[k]:.4g} N; the gel pressed to its base gives about "
        f"{most[k]:.3g} N"
        for k in too_much.tolist()
    ]
    if told:
        factor = float(np.median(forces[too_much] / most[too_much]))
        problems.add(shown(told), remedy=f"correct {key}{unit_meant(4.0 * factor)}")


def unit_meant(times: float) -> str:
    """Return what is told of units with which forces would fit that are so many times too large.

    Of all that bring them near one, the nearest first.
    """
    units = UNITS[Dimension.FORCE]
    pairs = [(small, large) for small in units for large in ("N", "mN") if small != large]
    left = {pair: abs(math.log(times * units[pair[0]] / units[pair[1]])) for pair in pairs}
    found = [pair for pair in sorted(pairs, key=left.__getitem__) if left[pair] < math.log(LIKE)]
    large = found[0][1] if found else ""
    fitting = [small for small, stated in found if stated == large and small in _COMMON]
    return f": the numbers look like {' or '.join(fitting)} where {large} is stated" * bool(fitting)


def _first(pressed: Sequence[Pressed], ratios: FloatArray) -> str:
    k = int(np.flatnonzero(np.isfinite(ratios))[0])
    return f"{pressed[k].where}: {pressed[k].force_n:.4g} N at {1e3 * pressed[k].depth_m:.4g} mm"


def hertz_n(indenter: Indenter | None, depth_m: float, sensor: Sensor) -> float:
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


def _check_axis(held: Sequence[FloatArray], problems: Problems) -> None:
    """Note forces that are throughout along another axis than that of the press."""
    means = np.array([np.abs(wrench[:, :3].mean(axis=0)) for wrench in held]).reshape(-1, 3)
    if not len(means) or not np.isfinite(means).all():
        return
    across = means[:, :2].max(axis=1)
    if (across > 3.0 * means[:, FZ]).all() and across.max() > 10.0 * LEAST_N:
        axis = "xy"[int(np.argmax(means[:, :2].sum(axis=0)))]
        problems.add(
            f"all {len(means)} presses are along the force sensor's {axis} "
            f"({across.max():.3g} N, along z {means[:, FZ].max():.3g} N)",
            remedy=f"name what is along the press as `force` (data.columns.force = the column of "
            f"force {axis}; in a bag turn the wrench)",
        )


def _check_places(presses: Sequence[Press], sensor: Sensor, keys: Keys, problems: Problems) -> None:
    """Note places beside the gel."""
    half = np.array(sensor.pad.half_extents())
    told = [
        f"{press.where or press.name}: pressed at {1e3 * press.place_m[0]:.4g}, "
        f"{1e3 * press.place_m[1]:.4g} mm; the gel ends at {1e3 * half[0]:.3g}, "
        f"{1e3 * half[1]:.3g} mm from its centre"
        for press in presses
        if press.place_m is not None and (np.abs(press.place_m) > half + BESIDE_M).any()
    ]
    if told:
        problems.add(
            shown(told),
            remedy=f"correct {keys.place}: places are of the tip from the pad's centre",
        )
