"""Which wrong models the verdict catches, by which criterion, and from which size on."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from reports.comparison.compare import compare
from reports.comparison.results import ValidationReport
from reports.evidence.attempt import RunReading
from reports.evidence.evidence import RunEvidence
from tacauchy_rig.app.replay.report import evidence_of
from tacauchy_rig.core.errors import ConvergenceError
from tests.studies.verdict.bench import Bench
from tests.studies.verdict.wrong_models import WrongModel

CANNOT = "cannot be replayed"
MEASURED_UNCERTAINTY = 0.02
"""Of the modulus of a gel that was measured; about what an indentation test of a sample gives."""

Missed = tuple[str, ...]
Task = tuple[WrongModel, float]
"""A wrong model and one of its sizes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """What the verdict says of a wrong model at one size.

    Attributes:
        missed: Criteria that it missed.
        missed_measured: The same, had the gel's modulus been measured.
        seconds: What that took [s].
    """

    missed: Missed
    missed_measured: Missed
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """What the verdict says of one wrong model, by its sizes, the smallest first."""

    model: WrongModel
    looks: dict[float, Look]

    @property
    def own(self) -> Look:
        """At the wrong model's own size."""
        return self.looks[self.model.size]

    @property
    def caught(self) -> bool:
        """At its own size, or from a size on that can be named."""
        return bool(self.own.missed) or self.caught_from() is not None

    @property
    def passes_at(self) -> float | None:
        """Largest size that passes; None where each is caught."""
        return max((size for size, look in self.looks.items() if not look.missed), default=None)

    def caught_from(self, *, measured: bool = False) -> float | None:
        """Return the smallest size from which on each is caught; None where the largest passes."""
        smallest = None
        for size, look in reversed(self.looks.items()):
            if not (look.missed_measured if measured else look.missed):
                break
            smallest = size
        return smallest


def tasks_of(models: Iterable[WrongModel]) -> list[Task]:
    """Return every size of every model."""
    return [(model, size) for model in models for size in model.sizes]


def findings_of(looks: Iterable[tuple[Task, Look]]) -> list[Finding]:
    """Put together what was found of each model, in the order in which it was looked at."""
    found: dict[WrongModel, dict[float, Look]] = {}
    for (model, size), look in looks:
        found.setdefault(model, {})[size] = look
    return [Finding(model=model, looks=by_size) for model, by_size in found.items()]


def look_at(task: Task, *, bench: Bench) -> Look:
    """Judge a wrong model at one size; one that finds no equilibrium announces itself."""
    started_s = time.monotonic()
    model, size = task
    try:
        evidence = model.evidence(bench, size)
        measured = missed_of(compare(with_measured_gel(evidence, bench)))
        missed = missed_of(compare(evidence))
    except ConvergenceError:
        missed = measured = (CANNOT,)
    return Look(missed=missed, missed_measured=measured, seconds=time.monotonic() - started_s)


def with_measured_gel(evidence: RunEvidence, bench: Bench) -> RunEvidence:
    """Return the evidence had the sensor's file stated what the true replay found of the modulus.

    The press itself is with the modulus that its depths tell, whatever is stated; a force scales
    with the modulus.
    """
    stated, model = bench.modulus_factor, evidence.model
    if model is None or model.modulus_factor is None:
        return evidence
    model = replace(
        model,
        modulus_factor=model.modulus_factor / stated,
        young_uncertainty_relative=MEASURED_UNCERTAINTY,
    )
    curves = [trial.force_depth_simulated for trial in evidence.trials]
    trials = tuple(
        replace(trial, force_depth_simulated=None if curve is None else curve.scaled(stated))
        for trial, curve in zip(evidence.trials, curves, strict=True)
    )
    return replace(evidence, trials=trials, model=model)


def true_reports(runs: Sequence[RunReading], bench: Bench) -> list[tuple[str, ValidationReport]]:
    """Judge each run's own replay, and the bench's of the first run, as stated and as measured."""
    names = [f"seed {run.store.description.get('seed')}" for run in runs]
    label, true = f"{names[0]}, preset {bench.inputs.preset.value}", bench.evidence()
    own = zip(names, map(evidence_of, runs), strict=True)
    seen = [(f"{name}, own replay", evidence) for name, evidence in own]
    seen += [(label, true), (f"{label}, modulus measured", with_measured_gel(true, bench))]
    return [(name, compare(evidence)) for name, evidence in seen]


def missed_of(report: ValidationReport) -> Missed:
    """Return the names of all criteria that a run or any of its trials missed."""
    criteria = [*report.criteria, *(c for t in report.trials for c in t.criteria)]
    return tuple(dict.fromkeys(c.name for c in criteria if not c.passed))
