"""The search for the smallest wrong size that is caught."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest

from reports.comparison.compare import compare
from tacauchy_rig.errors import ConvergenceError
from tacauchy_rig.verdict_check.bench import Bench
from tacauchy_rig.verdict_check.check import CANNOT, check_model, missed_of, search
from tacauchy_rig.verdict_check.wrong_models import WRONG_MODELS, WrongModel
from tests.reports.conftest import run_evidence


def graded(**changes: object) -> WrongModel:
    """Return a wrong model that nobody presses."""
    facts = {"name": "made up", "evidence": lambda *_: None, "hides": "", "unit": "mm"}
    return WrongModel(**{**facts, "size": 1.0, "largest": 8.0, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize("edge", [0.3, 1.0, 3.1, 8.0])
def test_the_smallest_caught_size_lies_just_above_the_edge(edge: float) -> None:
    """What is caught from an edge on is found to an eighth of the last interval."""
    found = search(graded(), lambda size: ("rim",) if size >= edge else ())
    assert found.smallest is not None
    assert found.passes_at is not None
    assert found.passes_at < edge <= found.smallest
    assert found.smallest - found.passes_at <= max(1.0, edge) / 8.0
    assert found.caught_by == (("rim",) if edge <= 1.0 else ())
    assert found.smallest_by == ("rim",)
    assert found.caught


def test_what_is_never_caught_says_how_far_was_looked() -> None:
    """No size up to the largest is caught."""
    found = search(graded(), lambda _: ())
    assert (found.smallest, found.passes_at, found.caught) == (None, 8.0, False)


def test_a_model_that_finds_no_equilibrium_announces_itself() -> None:
    """It is named as one that cannot be replayed, and nothing else is looked for."""

    def fail(*_: object) -> None:
        raise ConvergenceError("no equilibrium", remedy="none")

    model = graded(evidence=fail, size=None, largest=math.nan)
    assert check_model(Bench.__new__(Bench), model).caught_by == (CANNOT,)


def test_images_of_other_forces_are_caught() -> None:
    """Shuffled, exchanged, or of no contact: each misses the margin by name."""
    true = run_evidence()
    by_index = {t.index: t for t in true.trials}

    def evidence_with(images: dict[int, object]) -> object:
        trials = [replace(t, simulated_image=images[t.index]) for t in true.trials]
        return replace(true, trials=tuple(trials))

    bench = SimpleNamespace(
        trials=sorted(by_index),
        images={i: t.simulated_image for i, t in by_index.items()},
        evidence_with=evidence_with,
        run=SimpleNamespace(
            attempt=lambda index: SimpleNamespace(reference=by_index[index].images.reference)
        ),
    )
    assert missed_of(compare(true)) == ()
    for name in ("no contact", "images of the trials", "images of the two"):
        (model,) = (m for m in WRONG_MODELS if m.name.startswith(name))
        assert "force_margin" in check_model(bench, model).caught_by


def test_names_are_the_models_own() -> None:
    """Each row of the page can be asked for by its name."""
    assert len({model.name for model in WRONG_MODELS}) == len(WRONG_MODELS)
    assert all(model.hides for model in WRONG_MODELS if model.size is not None)
