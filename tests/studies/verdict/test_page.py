"""The page of a verdict check."""

from __future__ import annotations

from dataclasses import replace

from reports.comparison.compare import compare
from reports.evidence.evidence import RunEvidence
from tests.reports.conftest import run_evidence
from tests.studies.verdict.command import Finding, Look, check_page, true_table, wrong_table
from tests.studies.verdict.wrong_models import WRONG_MODELS


def two_trials() -> RunEvidence:
    """Return the evidence of a made-up run's two largest forces."""
    evidence = run_evidence()
    return replace(evidence, trials=evidence.trials[-2:])


def test_the_page_says_what_is_caught_and_what_slips_through() -> None:
    """Sizes, criteria and reasons stand in their rows; a model without a catch misses the table."""
    gel = next(model for model in WRONG_MODELS if model.name.startswith("gel stiffer"))
    last = WRONG_MODELS[-1]
    passed, missed = Look(missed=(), missed_measured=(), seconds=2.0), ("modulus_factor",)
    looks = {size: replace(passed, missed=missed if size > 25.0 else ()) for size in gel.sizes}
    caught = Finding(model=gel, looks=looks)
    slipped = Finding(model=last, looks={0.0: passed})
    wrong = wrong_table([caught, slipped], uncertainty="11 %")
    assert not wrong.passed
    assert wrong_table([caught], uncertainty="11 %").passed
    true = true_table([("seed 7", compare(two_trials()))])
    assert true.passed
    page = check_page(
        true, wrong, command="python -m tests.studies verdict RUN", preset="fast", version="1"
    )
    row = next(line for line in page.splitlines() if line.startswith(f"| {gel.name}"))
    assert "| 10 % | not caught | 28.3 % | modulus factor | 20 % | none |" in row
    assert "states the modulus to 11 %" in row
    assert "| seed 7 |" in page
