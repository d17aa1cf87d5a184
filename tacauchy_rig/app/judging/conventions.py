"""Signs and units of a simulator's outputs against what was measured: a convention is no defeat.

No simulator is wrong by a factor of a thousand in each press, or pulls where all others press: such
outputs are refused by the key that declares them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from tacauchy_rig.app.importing.plausible import UNLIKE, unit_meant
from tacauchy_rig.app.importing.problems import Problems
from tacauchy_rig.app.judging.layout import DESCRIPTION, FORCES
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.simulated import PressOutput

HEIGHT_UNLIKE = 100.0
"""Times the measured depth, or a part of it, that no surface is pressed in."""


def check_conventions(
    presses: Mapping[int, PressOutput],
    measured: Mapping[int, tuple[float | None, float | None]],
    pixel_m2: float,
    problems: Problems,
) -> None:
    """Note outputs whose sign or unit is wrong in all presses.

    Args:
        measured: Force [N] and depth [m] by press.
        pixel_m2: Area of the gel that a pixel of the scored image sees [m^2]; 0 is not known.
    """
    forces = [measured.get(trial, (None, None))[0] for trial in presses]
    depths = [measured.get(trial, (None, None))[1] for trial in presses]
    _check_numbers("force", [each.force_n for each in presses.values()], forces, "N", problems)
    _check_numbers("depth", [each.depth_m for each in presses.values()], depths, "m", problems)
    _check_heights([each.height_m for each in presses.values()], depths, problems)
    if pixel_m2 > 0.0:
        sums = [None if p.pressure_pa is None else p.pressure_pa.sum() for p in presses.values()]
        sums = [None if each is None else float(each) * pixel_m2 for each in sums]
        _check_pressures(sums, forces, problems)


def _ratios(ours: Sequence[float | None], theirs: Sequence[float | None]) -> FloatArray:
    """Return what is simulated over what was measured, where both are known and not zero."""
    pairs = zip(ours, theirs, strict=True)
    return np.array([a / b for a, b in pairs if a is not None and b is not None and b != 0.0])


def _check_numbers(
    what: str,
    simulated: Sequence[float | None],
    measured: Sequence[float | None],
    unit: str,
    problems: Problems,
) -> None:
    """Note forces or depths that are all negative, or all a hundred times too large or small."""
    ratios = _ratios(simulated, measured)
    if not len(ratios):
        return
    if (ratios < 0.0).all():
        known = [each for each in simulated if each is not None]
        problems.add(
            f"{FORCES}: all {len(ratios)} {what}s are negative, such as {known[0]:.4g} {unit}, "
            "where the measured are positive",
            remedy=f"{what}s are positive in compression: write signs.{what} = -1 into "
            f"{DESCRIPTION}",
        )
    middle = float(np.median(np.abs(ratios)))
    if not 1.0 / UNLIKE < middle < UNLIKE:
        meant = unit_meant(middle) if what == "force" else _length_meant(middle)
        problems.add(
            f"{FORCES}: {what}s are {middle:.3g} times the measured ones (median of "
            f"{len(ratios)} presses)",
            remedy=f"correct units.{what} of {DESCRIPTION}{meant}",
        )


def _length_meant(times: float) -> str:
    """Return what is told of the unit with which lengths would fit."""
    steps = round(math.log10(times) / 3.0) if times > 0.0 else 0
    names = {3: "um where m", 2: "um where m", 1: "um where mm, or mm where m"}
    names |= {-1: "m where mm, or mm where um", -2: "m where um"}
    return f": the numbers look like {names[steps]} is stated" if steps in names else ""


def _check_heights(
    heights: Sequence[FloatArray | None], depths: Sequence[float | None], problems: Problems
) -> None:
    """Note surfaces that rise where they are pressed, and that are as deep as no press is."""
    known = [each for each in heights if each is not None]
    if not known:
        return
    deepest = [None if each is None else -float(each.min()) for each in heights]
    highest = [None if each is None else float(each.max()) for each in heights]
    rises = [
        (low, high)
        for low, high in zip(deepest, highest, strict=True)
        if low is not None and high is not None and high > 3.0 * max(low, 0.0)
    ]
    if len(rises) == len(known):
        problems.add(
            f"heights rise by up to {1e3 * max(high for _, high in rises):.4g} mm, and fall by "
            "less than a third of that, in all presses",
            remedy="heights are negative where the gel is pressed in: write signs.height = -1 into "
            f"{DESCRIPTION}",
        )
        deepest = highest
    ratios = _ratios(deepest, depths)
    ratios = ratios[ratios > 0.0]
    if len(ratios) and not 1.0 / HEIGHT_UNLIKE < (middle := float(np.median(ratios))) < 10.0:
        problems.add(
            f"surfaces are pressed in {middle:.3g} times as deep as was measured (median of "
            f"{len(ratios)} presses)",
            remedy=f"correct units.height of {DESCRIPTION}{_length_meant(middle)}",
        )


def _check_pressures(
    sums_n: Sequence[float | None], forces: Sequence[float | None], problems: Problems
) -> None:
    """Note pressures whose sum is of another sign or size than the force."""
    ratios = _ratios(sums_n, forces)
    ratios = ratios[ratios != 0.0]
    if not len(ratios):
        return
    if (ratios < 0.0).all():
        problems.add(
            "pressures add up to a negative force in all presses",
            remedy=f"pressure is positive in compression: write signs.pressure = -1 into "
            f"{DESCRIPTION}",
        )
    middle = float(np.median(np.abs(ratios)))
    if not 1.0 / UNLIKE < middle < UNLIKE:
        problems.add(
            f"pressures add up to {middle:.3g} times the measured forces (median of {len(ratios)} "
            "presses)",
            remedy=f"correct units.pressure of {DESCRIPTION}: Pa, kPa or MPa",
        )
