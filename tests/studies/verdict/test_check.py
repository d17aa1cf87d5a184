"""The smallest wrong size that is caught."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest

from reports.comparison.compare import compare
from reports.comparison.results import judge_modulus
from tests.reports.conftest import run_evidence
from tests.studies.verdict.command import (
    Finding,
    Look,
    findings_of,
    look_at,
    missed_of,
    tasks_of,
    with_measured_gel,
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


@pytest.mark.parametrize(
    "name",
    [
        "no contact in any image",
        pytest.param("images of the trials shuffled", marks=pytest.mark.slow),
        pytest.param("images of the two largest forces exchanged", marks=pytest.mark.slow),
    ],
)
def test_images_of_other_forces_are_caught(name: str) -> None:
    """Shuffled, exchanged, or of no contact: each misses the margin by name."""
    trials = {t.index: t for t in run_evidence().trials[-2:]}
    true = replace(run_evidence(), trials=tuple(trials.values()))

    def evidence_with(images: dict[int, object]) -> object:
        shown = [replace(t, simulated_image=images[t.index]) for t in trials.values()]
        return replace(true, trials=tuple(shown))

    bench = SimpleNamespace(
        modulus_factor=1.0,
        trials=sorted(trials),
        images={i: t.simulated_image for i, t in trials.items()},
        evidence_with=evidence_with,
        run=SimpleNamespace(
            attempt=lambda index: SimpleNamespace(reference=trials[index].images.reference)
        ),
    )
    assert missed_of(compare(true)) == ()
    assert "force_margin" in look_at((named(name), 0.0), bench=bench).missed  # type: ignore[arg-type]


def named(name: str) -> WrongModel:
    """Return a wrong model by its name."""
    return next(model for model in WRONG_MODELS if model.name == name)
