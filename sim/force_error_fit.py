"""A fit through measured errors of F_z, and how far a press that it has not seen lies from it.

The error of quadratic tetrahedra falls as h^2, or as the number of tetrahedra N to the power of
-2/3, and what it is in proportion to is a matter of the press: it grows towards nu = 1/2, with the
indenter's width over the pad's height and with the sharpness of its rim. So, with one A for every
setting and one set of exponents for a kind of indenter,

    ln |error| = A - (2/3) ln N + b1 ln(1 / (1 - 2 nu)) + b2 ln(R / H) + b3 ln(fillet / R).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.force_error_rows import ForceErrorRow, rows
from sim.pilot import ANCHOR
from sim.scene import Preset
from sim.settings import COARSEST_BALANCED, Setting

# So many presses that a fit has not seen err by no more than it says: what a tolerance promises is
# to be kept nine times of ten.
QUANTILE = 0.9
_ORDER = 2.0 / 3.0
# Below this an error is not told from its limit's own.
_LEAST_ERROR = 2e-3
# What the limit at small strains may be off by.
_PILOT_FLOOR = 1e-3
# Keeps a setting that few presses were made with, or an exponent of few presses, from running off.
_RIDGE = 0.05


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
        levels: A of every setting.
        exponents: b1, b2 and, under a punch, b3.
        safety: By this factor the error of 90 % of presses that were left out of the fit is at most
            above it.
        pilot_safety: Over the error at small strains the errors of 90 % are at most this.
        anchor_margin: Where that error is held against an anchor whose own is the middle of a fit
            without the press, 90 % lie this far above it, at most.
        lowest: The least of every circumstance that was measured.
        highest: The largest of them.
        depth_share_least: The least depth over the depth that its mesh was made for.
        press_count: Presses that it rests on.
    """

    levels: dict[Setting, float]
    exponents: tuple[float, ...]
    safety: float
    pilot_safety: float
    anchor_margin: float
    lowest: Circumstances
    highest: Circumstances
    depth_share_least: float
    press_count: int

    def middle(self, setting: Setting, tet_count: int, press: Circumstances) -> float:
        """Return the relative error that is as likely too small as too large."""
        power = sum(b * x for b, x in zip(self.exponents, press.logarithms, strict=True))
        return math.exp(self.levels[setting] + power) / float(tet_count**_ORDER)

    def believed(self, setting: Setting, tet_count: int, press: Circumstances) -> float:
        """Return the relative error that 90 % of presses stay within."""
        return self.safety * self.middle(setting, tet_count, press)

    def believed_after(self, small_strain_error: float) -> float:
        """Return the same from the error that the press's own mesh has at small strains."""
        return self.pilot_safety * (abs(small_strain_error) + _PILOT_FLOOR)

    def believed_over_anchor(self, over_anchor: float, anchor_error: float) -> float:
        """Return the same from F_z over the anchor's, less one, and the anchor's middle error."""
        error = (1.0 + over_anchor) * (1.0 + anchor_error) - 1.0
        return self.pilot_safety * max(error, 0.0) + self.anchor_margin


@cache
def fits() -> dict[str, ForceErrorFit]:
    """Return the fit of every kind that was measured."""
    quadratic = [row for row in rows() if row.preset is not Preset.PAPER]
    kinds = dict.fromkeys(row.kind for row in quadratic)
    return {kind: fitted([row for row in quadratic if row.kind == kind]) for kind in kinds}


def fitted(known: Sequence[ForceErrorRow]) -> ForceErrorFit:
    """Fit rows of one kind of indenter."""
    settings = tuple(dict.fromkeys(row.setting for row in known))
    matrix, values = _matrix(known, settings), _values(known)
    solution = _solved(matrix, values, len(settings))
    presses = np.array([row.press for row in known])
    pressed = np.array(
        [(row.poisson, row.radius_share, row.fillet_share, row.depth_share) for row in known]
    )
    beyond = np.concatenate(
        [_left_out(matrix, values, presses == press, len(settings)) for press in set(presses)]
    )
    return ForceErrorFit(
        levels=dict(zip(settings, solution.tolist(), strict=False)),
        exponents=tuple(solution[len(settings) :].tolist()),
        safety=math.exp(float(np.quantile(beyond, QUANTILE))),
        pilot_safety=_pilot_safety(known),
        anchor_margin=_anchor_margin(known, matrix, values, len(settings)),
        lowest=_bound(pressed.min(axis=0)),
        highest=_bound(pressed.max(axis=0)),
        depth_share_least=float(pressed[:, 3].min()),
        press_count=len(set(presses)),
    )


def circumstances(row: ForceErrorRow) -> Circumstances:
    """Return what a row's error is in proportion to."""
    return Circumstances(
        poisson=row.poisson, radius_share=row.radius_share, fillet_share=row.fillet_share
    )


def _matrix(known: Sequence[ForceErrorRow], settings: Sequence[Setting]) -> FloatArray:
    own = [[float(row.setting == setting) for setting in settings] for row in known]
    return np.column_stack([np.array(own), [circumstances(row).logarithms for row in known]])


def _values(known: Iterable[ForceErrorRow]) -> FloatArray:
    return np.array(
        [math.log(max(row.error, _LEAST_ERROR) * row.tet_count**_ORDER) for row in known]
    )


def _solved(matrix: FloatArray, values: FloatArray, setting_count: int) -> FloatArray:
    """Return levels and exponents; a setting's level is drawn to the mean of all."""
    centre = float(values.mean())
    ridge = _RIDGE * np.eye(matrix.shape[1])
    found = np.linalg.solve(matrix.T @ matrix + ridge, matrix.T @ (values - centre))
    found[:setting_count] += centre
    return np.asarray(found)


def _left_out(
    matrix: FloatArray, values: FloatArray, out: NDArray[np.bool_], setting_count: int
) -> FloatArray:
    """Return how far the rows of a press lie above a fit through all others.

    What no other press was made with tells nothing and is left out.
    """
    solution = _solved(matrix[~out], values[~out], setting_count)
    seen = matrix[~out][:, :setting_count].any(axis=0)
    judged = matrix[out][:, :setting_count] @ seen > 0.0
    return np.asarray((values[out] - matrix[out] @ solution)[judged])


def _pilot_safety(known: Iterable[ForceErrorRow]) -> float:
    ratios = [
        max(row.error, _LEAST_ERROR) / (abs(row.small_strain_error) + _PILOT_FLOOR)
        for row in known
        if row.small_strain_error is not None
    ]
    return float(np.quantile(ratios, QUANTILE))


def _anchor_margin(
    known: Sequence[ForceErrorRow], matrix: FloatArray, values: FloatArray, setting_count: int
) -> float:
    """Return how far errors lie above what an anchor says, a fit without the press giving its own.

    Judged are the settings that are cheaper than the anchor.
    """
    safety = _pilot_safety(known)
    presses = np.array([row.press for row in known])
    anchors = {
        (row.press, row.depth_m): (number, row)
        for number, row in enumerate(known)
        if row.setting == ANCHOR
    }
    beyond = []
    for row in known:
        number, anchor = anchors[row.press, row.depth_m]
        coarse = row.preset is Preset.FAST or row.setting == COARSEST_BALANCED
        if not coarse or row.small_strain_error is None or anchor.small_strain_error is None:
            continue
        others = presses != row.press
        solution = _solved(matrix[others], values[others], setting_count)
        own = math.exp(float(matrix[number] @ solution)) / anchor.tet_count**_ORDER
        over = (1.0 + row.small_strain_error) / (1.0 + anchor.small_strain_error)
        beyond.append(max(row.error, _LEAST_ERROR) - safety * max(over * (1.0 + own) - 1.0, 0.0))
    return float(np.quantile(beyond, QUANTILE))


def _bound(values: FloatArray) -> Circumstances:
    poisson, radius_share, fillet_share = values[:3].tolist()
    return Circumstances(poisson=poisson, radius_share=radius_share, fillet_share=fillet_share)
