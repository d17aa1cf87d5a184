"""A fit through measured errors of F_z, and how far a press that it has not seen lies from it.

What the edges in a mesh's section through its axis do to F_z at small strains, e_s
(``sim.error.section_error``), they do to the real press nearly alike. On top comes what a section
does not have: its sectors are plane, n of them in a turn, and the limit that an error is held
against may itself be a little off. How much, is a matter of the press: it grows towards nu = 1/2
and with the indenter's width over the pad's height. So, for a kind of indenter,

    |error| = A |e_s| + (C + (16 / n)^4) exp(B + b1 ln(1 / (1 - 2 nu)) + b2 ln(R / H)
              + b3 ln(fillet / R)),

and errors scatter about it by a tenth of it and 0.15 %, times a margin that comes out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from sim.arrays import FloatArray
from sim.error.measured_rows import stored

# So many presses that a fit has not seen err by no more than it says: what a tolerance promises is
# to be kept nine times of ten.
QUANTILE = 0.9
_SCATTER_SHARE, _SCATTER_LEAST = 0.1, 1.5e-3
_SECTORS, _SECTOR_ORDER = 16.0, 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Circumstances:
    """What of a press its error is in proportion to, besides its mesh; shares as in the rows."""

    poisson: float
    radius_share: float
    fillet_share: float

    @property
    def logarithms(self) -> tuple[float, ...]:
        """What the exponents are of."""
        rim = (math.log(self.fillet_share),) if self.fillet_share > 0.0 else ()
        return (-math.log(1.0 - 2.0 * self.poisson), math.log(self.radius_share), *rim)


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceErrorFit:
    """The fit of one kind of indenter.

    Attributes:
        coefficients: ln A, ln C, B, b1, b2 and, under a punch, b3.
        margin: 90 % of the errors of presses that were left out of the fit, each in its turn, lie
            at most so many scatters above it.
        lowest: The least of every circumstance that was measured.
        highest: The largest of them.
        depth_share_least: The least depth over the depth that its mesh was made for.
        press_count: Presses that it rests on.
    """

    coefficients: tuple[float, ...]
    margin: float
    lowest: Circumstances
    highest: Circumstances
    depth_share_least: float
    press_count: int

    def middle(self, section_error: float, sector_count: int, press: Circumstances) -> float:
        """Return the relative error that is as likely too small as too large."""
        logarithms = np.array([press.logarithms])
        found = modelled_errors(
            np.array(self.coefficients),
            np.array([abs(section_error)]),
            np.array([float(sector_count)]),
            logarithms,
        )
        return float(found[0])

    def believed(self, section_error: float, sector_count: int, press: Circumstances) -> float:
        """Return the relative error that 90 % of presses stay within."""
        middle = self.middle(section_error, sector_count, press)
        return middle + self.margin * float(scatter(np.array(middle)))


@cache
def fits() -> dict[str, ForceErrorFit]:
    """Return the fit of every kind that was measured."""
    return {kind: _read(fit) for kind, fit in stored()["fits"].items()}


def modelled_errors(
    coefficients: FloatArray, sections: FloatArray, sectors: FloatArray, logarithms: FloatArray
) -> FloatArray:
    """Return what a fit gives for every row.

    Args:
        coefficients: As in ``ForceErrorFit``.
        sections: Absolute error of every row's section at small strains.
        sectors: Of a full turn.
        logarithms: What the exponents are of, a line for each row.
    """
    slope, common, level = coefficients[:3]
    rest = np.exp(common) + (_SECTORS / sectors) ** _SECTOR_ORDER
    power = level + logarithms @ coefficients[3:]
    return np.asarray(np.exp(slope) * sections + rest * np.exp(power))


def scatter(errors: FloatArray) -> FloatArray:
    """Return how far errors usually lie from what a fit gives."""
    return _SCATTER_SHARE * errors + _SCATTER_LEAST


def _read(fit: dict[str, Any]) -> ForceErrorFit:
    bounds = {name: Circumstances(**fit[name]) for name in ("lowest", "highest")}
    return ForceErrorFit(**{**fit, **bounds, "coefficients": tuple(fit["coefficients"])})
