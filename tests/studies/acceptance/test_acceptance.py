"""The acceptance flow's tables: what misses a criterion, and what does not."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from tests.studies.acceptance.command import truth_table


def _summary(margin, young_pa):
    trial = {"force_margin": {"value": margin, "spread": 0.01}}
    return {
        "model": {"young_pa": young_pa, "modulus_factor": 1.0, "modulus_factor_deviation": 0.03},
        "trials": [trial],
        "headline": [],
    }


@pytest.mark.parametrize(
    ("margin", "young_pa", "passes"),
    [(0.1, 3.0e5, True), (-0.02, 3.0e5, True), (-0.1, 3.0e5, False), (0.1, 2.5e5, False)],
)
def test_a_clear_defeat_or_a_wrong_modulus_misses(margin, young_pa, passes):
    """A defeat within three spreads is noise."""
    written = SimpleNamespace(truth=SimpleNamespace(young_pa=3.0e5))
    table = truth_table(written, _summary(margin, young_pa), command="")
    assert table.passed is passes
