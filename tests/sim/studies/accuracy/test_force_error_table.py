"""The fit through measured errors of F_z."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest

from sim.error.measured_errors import ROUNDED, ForceErrorRow, rows
from sim.error.prior_error import Circumstances, fits
from sim.scene.scene import Preset
from sim.studies.accuracy.force_error_table import fits_through, fitted

_FORCE_N = 1.0


def _row(press: int, section_error: float, *, scatter: float = 0.0) -> ForceErrorRow:
    """Return a row that errs by its section's error and 0.5 % for its sectors."""
    error = (1.0 + scatter) * (section_error + 0.5e-2)
    return ForceErrorRow(
        press=press,
        kind=ROUNDED,
        indenter="made up",
        poisson=0.4 + 0.01 * press,
        radius_share=0.5 + 0.1 * press,
        fillet_share=0.1,
        preset=Preset.FAST,
        refinement=1.0,
        sector_count=16,
        depth_m=1e-4,
        depth_share=1.0,
        pad_share=0.1,
        force_n=_FORCE_N * (1.0 + error),
        limit_n=_FORCE_N,
        doubt=0.0,
        section_error=section_error,
        cpu_s=1.0,
    )


def test_a_fit_finds_what_rows_were_made_of() -> None:
    """Section's error plus sectors' share, for presses that it has not seen; hardly a margin."""
    known = [_row(press, error) for press, error in product(range(1, 6), (0.5e-2, 2e-2, 8e-2))]
    found = fitted(known)
    unseen = Circumstances(poisson=0.435, radius_share=0.85, fillet_share=0.1)
    assert found.middle(3e-2, 16, unseen) == pytest.approx(3.5e-2, rel=0.1)
    assert found.press_count == 5
    assert abs(found.margin) < 1.0


def test_what_scatters_is_believed_to_err_more() -> None:
    """Rows that lie a fifth to either side of the rest have a larger margin, and middles alike."""
    errors = (0.5e-2, 2e-2, 8e-2)
    steady = fitted([_row(press, error) for press, error in product(range(1, 9), errors)])
    rough = fitted(
        [
            _row(press, error, scatter=0.2 * (-1) ** press)
            for press, error in product(range(1, 9), errors)
        ]
    )
    where = Circumstances(poisson=0.45, radius_share=1.0, fillet_share=0.1)
    assert rough.margin > steady.margin + 0.5
    assert rough.bound(2e-2, 16, where) > 1.05 * steady.bound(2e-2, 16, where)
    assert rough.middle(2e-2, 16, where) == pytest.approx(steady.middle(2e-2, 16, where), rel=0.15)


def test_the_fits_that_ship_are_those_through_the_rows_that_ship() -> None:
    """Kept beside the rows so that nobody waits for them."""
    again = fits_through(rows())
    assert set(again) == set(fits())
    for kind, fit in fits().items():
        assert again[kind].margin == pytest.approx(fit.margin, rel=1e-3)
        assert np.allclose(again[kind].coefficients, fit.coefficients, rtol=1e-2, atol=1e-2)
        assert all(math.isfinite(value) for value in fit.coefficients)


@pytest.mark.parametrize("kind", fits())
def test_nine_rows_of_ten_err_by_no_more_than_is_believed(kind: str) -> None:
    """Of the rows themselves, by the fit through all of them."""
    fit = fits()[kind]
    revolved = [row for row in rows() if row.kind == kind and row.section_error is not None]
    kept = [
        row.error
        <= fit.bound(
            row.section_error or 0.0,
            row.sector_count,
            Circumstances(
                poisson=row.poisson, radius_share=row.radius_share, fillet_share=row.fillet_share
            ),
        )
        for row in revolved
    ]
    assert np.mean(kept) >= 0.88
