"""The page of a verdict check."""

from __future__ import annotations

from dataclasses import replace

from reports.comparison.compare import compare
from tacauchy_rig.verdict_check.check import Finding
from tacauchy_rig.verdict_check.page import check_page, true_table, wrong_table
from tacauchy_rig.verdict_check.wrong_models import WRONG_MODELS
from tests.reports.conftest import run_evidence


def test_the_page_says_what_is_caught_and_what_slips_through() -> None:
    """Sizes, criteria and reasons stand in their rows; a model without a catch misses the table."""
    gel, *_, last = WRONG_MODELS
    caught = Finding(
        model=gel,
        caught_by=(),
        smallest=26.0,
        smallest_by=("modulus_factor", "predicted_force"),
        passes_at=22.0,
    )
    slipped = Finding(model=last, caught_by=())
    wrong = wrong_table([caught, slipped], uncertainty="11 %")
    assert not wrong.passed
    assert wrong_table([caught], uncertainty="11 %").passed
    true = true_table([("seed 7", compare(run_evidence()))])
    assert true.passed
    page = check_page(
        true, wrong, command="tacauchy-rig verdict-check RUN", preset="fast", version="1"
    )
    row = next(line for line in page.splitlines() if line.startswith(f"| {gel.name}"))
    assert "| 10 % | not caught | 26 % | modulus factor, predicted force | 22 % |" in row
    assert "states the modulus to 11 %" in row
    assert "| seed 7 |" in page


def test_a_true_model_that_misses_is_named() -> None:
    """The criterion stands in the last column."""
    evidence = run_evidence()
    trials = tuple(
        replace(t, simulated_image=t.images.reference) for t in evidence.trials if t.images
    )
    table = true_table([("seed 7", compare(replace(evidence, trials=trials)))])
    assert not table.passed
    assert "contact residual" in str(table.rows[0][-1])
