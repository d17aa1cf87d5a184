"""The smallest wrong size that is caught, and the page of a verdict check."""

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest

from reports.comparison.report_criteria import judge_modulus
from reports.comparison.run_comparison import compare
from tests.reports.conftest import run_evidence
from tests.studies.verdict.command import (
    Finding,
    Look,
    check_page,
    findings_of,
    tasks_of,
    true_table,
    with_measured_gel,
    wrong_table,
)
from tests.studies.verdict.wrong_models import STEPS_TO_DOUBLE, WRONG_MODELS, WrongModel


def found(edge: float, *, measured_edge: float = math.inf) -> Finding:
    """Return what is found of a wrong model that is caught from an edge on."""
    model = WrongModel("made up", lambda *_: None, "", 1.0, "mm", 4, 6)  # type: ignore[arg-type,return-value]
    looks = [
        Look(
            missed=("rim",) if size >= edge else (),
            missed_measured=("rim",) if size >= measured_edge else (),
            seconds=1.0,
        )
        for _, size in tasks_of([model])
    ]
    (finding,) = findings_of(zip(tasks_of([model]), looks, strict=True))
    return finding


@pytest.mark.parametrize("edge", [0.3, 1.0, 3.1, 8.0])
def test_the_smallest_caught_size_lies_just_above_the_edge(edge: float) -> None:
    """What is caught from an edge on is found to a step."""
    finding = found(edge)
    smallest, passes_at = finding.caught_from(), finding.passes_at
    assert smallest is not None
    assert passes_at is not None
    assert passes_at < edge <= smallest
    assert smallest == pytest.approx(2.0 ** (1.0 / STEPS_TO_DOUBLE) * passes_at)
    assert finding.own.missed == (("rim",) if edge <= 1.0 else ())
    assert finding.caught


def test_a_modulus_that_was_measured_allows_less() -> None:
    """A factor of 1.06 passes as stated; of a gel measured to be 1.0 times that it does not."""
    evidence = run_evidence()
    assert evidence.model is not None
    evidence = replace(evidence, model=replace(evidence.model, modulus_factor=1.06))
    for factor, missed in ((1.0, True), (1.06, False)):
        measured = with_measured_gel(evidence, SimpleNamespace(modulus_factor=factor))  # type: ignore[arg-type]
        (criterion,) = (
            c
            for c in judge_modulus(measured.model, measured.thresholds)
            if c.name == "modulus_factor"
        )
        assert criterion.passed != missed
        assert criterion.measured == pytest.approx(1.06 / factor)


def test_the_page_says_what_is_caught_and_what_slips_through() -> None:
    """Sizes, criteria and reasons stand in their rows; a model without a catch misses the table."""
    evidence = run_evidence()
    two = replace(evidence, trials=evidence.trials[-2:])
    gel = next(model for model in WRONG_MODELS if model.name.startswith("gel stiffer"))
    last = WRONG_MODELS[-1]
    passed, missed = Look(missed=(), missed_measured=(), seconds=2.0), ("modulus_factor",)
    looks = {size: replace(passed, missed=missed if size > 25.0 else ()) for size in gel.sizes}
    caught = Finding(model=gel, looks=looks)
    slipped = Finding(model=last, looks={0.0: passed})
    wrong = wrong_table([caught, slipped], uncertainty="11 %")
    assert not wrong.passed
    assert wrong_table([caught], uncertainty="11 %").passed
    true = true_table([("seed 7", compare(two))])
    assert true.passed
    page = check_page(
        true, wrong, command="python -m tests.studies verdict RUN", preset="fast", version="1"
    )
    row = next(line for line in page.splitlines() if line.startswith(f"| {gel.name}"))
    assert "| 10 % | not caught | 28.3 % | modulus factor | 20 % | none |" in row
    assert "states the modulus to 11 %" in row
    assert "| seed 7 |" in page
