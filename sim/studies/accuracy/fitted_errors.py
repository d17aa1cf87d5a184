"""The fit of ``sim.error.fit`` laid through measured errors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.error.fit import QUANTILE, Circumstances, ForceErrorFit, modelled_errors, scatter
from sim.error.measured_rows import ForceErrorRow

# Keeps an exponent of few presses from running off.
_RIDGE = 2.0
# ln A, ln C and B of an error that is the section's and a little more.
_START = (0.0, 0.0, -6.0)
_DRAWN = (0, 1)


def fits_through(rows: Sequence[ForceErrorRow]) -> dict[str, ForceErrorFit]:
    """Fit rows, each kind of indenter by itself."""
    revolved = [row for row in rows if row.section_error is not None]
    kinds = dict.fromkeys(row.kind for row in revolved)
    return {kind: fitted([row for row in revolved if row.kind == kind]) for kind in kinds}


def fitted(known: Sequence[ForceErrorRow]) -> ForceErrorFit:
    """Fit rows of one kind of indenter, on revolved meshes."""
    rows = _Rows(
        errors=np.array([row.error for row in known]),
        sections=np.array([abs(row.section_error or 0.0) for row in known]),
        sectors=np.array([float(row.sector_count) for row in known]),
        logarithms=np.array([_circumstances(row).logarithms for row in known]),
    )
    presses = np.array([row.press for row in known])
    pressed = np.array(
        [(row.poisson, row.radius_share, row.fillet_share, row.depth_share) for row in known]
    )
    beyond = [
        rows.of(presses == press).beyond(rows.of(presses != press).solved())
        for press in sorted(set(presses.tolist()))
    ]
    return ForceErrorFit(
        coefficients=tuple(rows.solved().tolist()),
        margin=float(np.quantile(np.concatenate(beyond), QUANTILE)),
        lowest=_bound(pressed.min(axis=0)),
        highest=_bound(pressed.max(axis=0)),
        depth_share_least=float(pressed[:, 3].min()),
        press_count=len(set(presses.tolist())),
    )


def _circumstances(row: ForceErrorRow) -> Circumstances:
    """Return what a row's error is in proportion to."""
    return Circumstances(
        poisson=row.poisson, radius_share=row.radius_share, fillet_share=row.fillet_share
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rows:
    """What a fit is laid through; every array has a value or a line for each row."""

    errors: FloatArray
    sections: FloatArray
    sectors: FloatArray
    logarithms: FloatArray

    def of(self, chosen: NDArray[np.bool_]) -> _Rows:
        """Return some of the rows."""
        return _Rows(
            errors=self.errors[chosen],
            sections=self.sections[chosen],
            sectors=self.sectors[chosen],
            logarithms=self.logarithms[chosen],
        )

    def modelled(self, coefficients: FloatArray) -> FloatArray:
        """Return what a fit gives for the rows."""
        return modelled_errors(coefficients, self.sections, self.sectors, self.logarithms)

    def solved(self) -> FloatArray:
        """Return the coefficients of the fit; far outliers count less than their squares."""
        usual = scatter(self.errors)
        start = np.array([*_START, *np.zeros(self.logarithms.shape[1])])
        drawn = [*_DRAWN, *range(len(_START), len(start))]

        def off(coefficients: FloatArray) -> FloatArray:
            apart = (self.errors - self.modelled(coefficients)) / usual
            return np.concatenate([apart, _RIDGE * (coefficients - start)[drawn]])

        solve: Callable[..., scipy.optimize.OptimizeResult] = scipy.optimize.least_squares
        return np.asarray(solve(off, start, loss="soft_l1").x)

    def beyond(self, coefficients: FloatArray) -> FloatArray:
        """Return how many scatters the rows lie above a fit."""
        middle = self.modelled(coefficients)
        return (self.errors - middle) / scatter(middle)


def _bound(values: FloatArray) -> Circumstances:
    poisson, radius_share, fillet_share = values[:3].tolist()
    return Circumstances(poisson=poisson, radius_share=radius_share, fillet_share=fillet_share)
