"""Check of the force sensor with a known weight.

Every force of a run comes from the cell. A wrong range, unit or sign does not show in it; a known
weight is the only independent check before the first press.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import Dimension, parse_quantity
from tacauchy_rig.core.run import FZ, Tare

GRAVITY_M_S2 = 9.81
"""Within 0.3 % of it everywhere on earth, at sea level."""
SCALE_SHARE = 0.05
"""How far the cell's scale may be off: its calibration 1 %, gravity 0.3 %, a weight that hangs a
little aslant or touches something 1 %, and as much again."""
SIDE_SHARE = 0.15
"""Of the weight, sideways: a tool 3 degrees off the vertical makes 5 %, cross-talk and a swinging
weight the rest."""
WEIGHT_SHARE = 0.01
"""Uncertainty of a weight whose own is not typed: kitchen scales say 1 g of 200 g."""
NOTHING_SHARE = 0.03
"""Of the weight; a change below it is none."""
UNCERTAIN_SHARE = 0.1
"""Of the weight; drift and noise above it leave nothing to judge."""
RATIO_SHARE = 0.08
"""How near a ratio has to be to one whose cause is known."""
EXPIRY_H = 24.0
"""A cell that was switched off overnight is another one: a zero, a gain, a cable may be."""

_RATIOS = (
    (0.1, "the range set in the box or on its sheet is a tenth of the cell's, or it reads in kgf"),
    (10.0, "the range set in the box is ten times the cell's, or newtons were taken for kgf"),
    (0.2248, "the box reads in pounds-force"),
    (4.448, "the box takes newtons for pounds-force"),
    (0.5, "gain or excitation of the box is half of what the sheet says (AT+CHNAPG, AT+EXMV)"),
    (2.0, "gain or excitation of the box is twice what the sheet says (AT+CHNAPG, AT+EXMV)"),
)
"""What makes a cell read this many times its load."""
_SET_UP = "compare range, gain and decoupling matrix in the box (AT+DCPM, AT+CHNAPG) with the sheet"


@dataclass(frozen=True, slots=True, kw_only=True)
class Weight:
    """A known mass, and how well it is known [kg]."""

    mass_kg: float
    uncertainty_kg: float

    @property
    def force_n(self) -> float:
        """What it pulls with [N]."""
        return self.mass_kg * GRAVITY_M_S2

    def __str__(self) -> str:
        return f"{self.mass_kg * 1e3:g} g"


def parse_weight(text: str) -> Weight:
    """Read ``200g`` or ``200 g +- 0.5 g``; what is left out is 1 % of the mass.

    Raises:
        ConfigError: No mass with its unit, or none that a cell on an arm could carry.
    """
    mass, *rest = re.split(r"\+-|\+/-|±", text, maxsplit=1)
    field = "--check-weight"
    mass_kg = parse_quantity(mass, dimension=Dimension.MASS, field=field)
    least_kg, most_kg = 0.01, 5.0
    if not least_kg <= mass_kg <= most_kg:
        raise ConfigError(
            f'{field}: "{text}" is not between {least_kg * 1e3:g} g and {most_kg:g} kg',
            remedy="hang what weighs about as much as a press: 100 g are 1 N",
        )
    uncertainty_kg = WEIGHT_SHARE * mass_kg
    if rest:
        uncertainty_kg = parse_quantity(rest[0], dimension=Dimension.MASS, field=field)
    return Weight(mass_kg=mass_kg, uncertainty_kg=abs(uncertainty_kg))


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceCheck:
    """A weight that hung on the cell, and what the cell made of it."""

    checked: str  # when, in UTC
    weight: Weight
    compression_sign: int
    before: Tare  # unloaded; ``loaded``: with the weight; ``after``: unloaded again
    loaded: Tare
    after: Tare
    # Change of the pressing force that the weight makes; it pulls, so it is negative
    expected_n: float
    measured_n: float  # the same as the cell has it
    sideways_n: float  # change across the cell's axis
    drift_n: float  # unloaded after minus before
    tolerance_n: float  # by how much ``measured_n`` may miss ``expected_n``
    finding: str  # what was found, in words
    remedy: str = ""  # the likely cause first; empty where the cell is right
    expired: str = ""  # when trials were added although the check had expired; empty if none were

    @property
    def passed(self) -> bool:
        """True where the cell read the weight, with its sign and along its axis."""
        return not self.remedy

    @property
    def ratio(self) -> float:
        """What the cell read of the weight; 1 is right."""
        return self.measured_n / self.expected_n


def judge_weight(
    weight: Weight, *, before: Tare, loaded: Tare, after: Tare, compression_sign: int, checked: str
) -> ForceCheck:
    """Judge size, sign and axis of what a hung weight changed.

    Args:
        before: Raw wrench of the unloaded cell.
        loaded: With the weight at rest.
        after: Unloaded again.
        compression_sign: Times raw Fz it is positive in compression.
    """
    x, y, z = (
        held - 0.5 * (first + last)
        for held, first, last in zip(loaded.mean[:3], before.mean[:3], after.mean[:3], strict=True)
    )
    drift_n = compression_sign * (after.mean[FZ] - before.mean[FZ])
    # A weight that swings shows as noise: its mean is known no better than that.
    noise_n = 2.0 * max(tare.deviation[FZ] for tare in (before, loaded, after))
    uncertainty_n = math.hypot(weight.uncertainty_kg * GRAVITY_M_S2, noise_n, 0.5 * drift_n)
    weight_n, measured_n = weight.force_n, compression_sign * z
    tolerance_n = SCALE_SHARE * weight_n + uncertainty_n
    check = ForceCheck(
        checked=checked,
        weight=weight,
        compression_sign=compression_sign,
        before=before,
        loaded=loaded,
        after=after,
        expected_n=-weight_n,
        measured_n=measured_n,
        sideways_n=math.hypot(x, y),
        drift_n=drift_n,
        tolerance_n=tolerance_n,
        finding=(
            f"{weight} pull with {weight_n:.3f} N, so the pressing force has to change by "
            f"{-weight_n:.3f} N (+- {tolerance_n:.3f} N); it changed by {measured_n:+.3f} N, "
            f"{-measured_n / weight_n:.3g} of that (raw Fx {x:+.3f}, Fy {y:+.3f}, Fz {z:+.3f} N)"
        ),
    )
    return replace(check, remedy="; ".join(_causes(check, uncertainty_n=uncertainty_n)))


def _causes(check: ForceCheck, *, uncertainty_n: float) -> Iterator[str]:
    """Yield what is wrong, the likely cause first; nothing where all is right."""
    weight_n = check.weight.force_n
    tares = check.before, check.loaded, check.after
    if all(tare.deviation[FZ] == 0.0 for tare in tares):
        yield "the cell has no noise, so it is stuck: switch the box off and on"
    elif math.hypot(check.measured_n, check.sideways_n) < NOTHING_SHARE * weight_n:
        yield "the cell measured almost nothing: did the weight hang freely on the tool"
        yield "is the cell plugged into the box; does the box read in kN"
    elif abs(check.drift_n) > 0.5 * weight_n:
        yield (
            f"unloaded again the cell is {check.drift_n:+.3f} N off its first zero: hang the "
            "weight after the second line and take it off before the third"
        )
    elif uncertainty_n > UNCERTAIN_SHARE * weight_n:
        yield (
            f"drift and noise leave {uncertainty_n:.3f} N open: let the cell warm up and the "
            "weight come to rest, or hang a heavier one"
        )
    elif abs(check.measured_n) < check.sideways_n:
        yield (
            "the weight acts across the cell's axis: the tool does not point straight down, "
            "the cell is mounted on its side, or its decoupling matrix (AT+DCPM) swaps axes"
        )
    else:
        yield from _causes_along_the_axis(check, uncertainty_n=uncertainty_n)


def _causes_along_the_axis(check: ForceCheck, *, uncertainty_n: float) -> Iterator[str]:
    weight_n = check.weight.force_n
    if check.measured_n > 0.0:
        yield (
            "a weight that hangs pulls, and the cell calls it pressing: "
            "force_sensor.compression_sign has to be the other one (or the weight stood on it)"
        )
    if abs(abs(check.measured_n) - weight_n) > check.tolerance_n:
        ratio = abs(check.measured_n) / weight_n
        near = [cause for known, cause in _RATIOS if abs(ratio / known - 1.0) <= RATIO_SHARE]
        yield f"{near[0]}; {_SET_UP}" if near else f"{_SET_UP}; weigh the weight again"
    if check.sideways_n > SIDE_SHARE * weight_n + uncertainty_n:
        yield (
            f"{check.sideways_n:.3f} N of it went sideways: point the tool straight down, and see "
            "how the cell is mounted and its decoupling matrix (AT+DCPM)"
        )
