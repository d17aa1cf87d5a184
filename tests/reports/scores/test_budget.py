"""Terms add in squares; what rests on few presses widens the interval."""

from __future__ import annotations

import math

import pytest

from reports.scores.force_agreement import TermGroup, UncertaintyTerm, combine


def _term(name: str, value_n: float | None, freedom: float | None = None) -> UncertaintyTerm:
    return UncertaintyTerm(
        name=name,
        group=TermGroup.INPUTS,
        value_n=value_n,
        basis="made up",
        degrees_of_freedom=freedom,
    )


def test_the_gums_end_gauge() -> None:
    """GUM H.1: 25, 9.7, 2.9 and 16.6 nm come to 32 nm with 16.7 degrees of freedom."""
    values = {"standard": (25.0, 18), "d": (9.7, 25.6), "alpha": (2.9, 50), "theta": (16.6, 2)}
    found = combine([_term(name, value, freedom) for name, (value, freedom) in values.items()])
    assert found is not None
    assert found.value_n == pytest.approx(32.0, abs=0.5)
    assert found.degrees_of_freedom == pytest.approx(16.7, abs=0.1)
    assert found.largest == "standard"


def test_terms_whose_uncertainty_is_known_have_a_normal_interval() -> None:
    """3 and 4 come to 5; 1.96 times that holds 95 %. Without the larger, 3 is left."""
    found = combine([_term("a", 3.0), _term("b", 4.0), _term("c", None)])
    assert found is not None
    assert found.value_n == 5.0
    assert found.degrees_of_freedom is None
    assert found.expanded_n == pytest.approx(5.0 * 1.95996, rel=1e-5)
    assert (found.largest, found.without_largest_n) == ("b", 3.0)


def test_one_term_of_few_presses_is_students() -> None:
    """Four degrees of freedom: 2.776 times."""
    found = combine([_term("a", 1.0, 4.0)])
    assert found is not None
    assert found.expanded_n == pytest.approx(2.7764, rel=1e-4)


def test_nothing_known_is_no_interval() -> None:
    """Neither of unknown terms nor of terms of zero."""
    assert combine([_term("a", None)]) is None
    assert combine([_term("a", 0.0)]) is None
    assert not math.isnan(combine([_term("a", 1.0)]).value_n)  # type: ignore[union-attr]
