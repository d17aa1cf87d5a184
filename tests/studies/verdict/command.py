"""Study "verdict": the report of a run against replays that are wrong on purpose."""

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from reports.comparison.result_types import ValidationReport, headline_of
from reports.comparison.run_comparison import compare
from reports.evidence.evidence_types import RunEvidence
from reports.evidence.frames_and_curves import RunReading
from sim.scene.scene import Preset
from tacauchy_rig import __version__
from tacauchy_rig.app.cli.output import Found, Jobs, say, show_table, write_text
from tacauchy_rig.app.replay.report_run import evidence_of
from tacauchy_rig.core.errors import ConvergenceError
from tacauchy_rig.core.markdown_page import page
from tacauchy_rig.core.study import selected
from tacauchy_rig.core.tables import Cell, Table, table_of
from tacauchy_rig.core.time_limit_and_progress import heard
from tests.studies.verdict.bench import Bench
from tests.studies.verdict.wrong_models import STEPS_TO_DOUBLE, WrongModel

CANNOT = "cannot be replayed"
MEASURED_UNCERTAINTY = 0.02
"""Of the modulus of a gel that was measured; about what an indentation test of a sample gives."""

Missed = tuple[str, ...]
Task = tuple[WrongModel, float]
"""A wrong model and one of its sizes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """What the verdict says of a wrong model at one size."""

    missed: Missed  # criteria that it missed
    missed_measured: Missed  # the same, had the gel's modulus been measured
    seconds: float  # what that took [s]


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


_MEASURED = f"{100.0 * MEASURED_UNCERTAINTY:g} %"


def true_table(reports: Sequence[tuple[str, ValidationReport]]) -> Table:
    """Return how the true model stands in each run: the worst trial of each criterion."""
    rows: list[tuple[Cell, ...]] = []
    names: dict[str, str] = {}
    for _, report in reports:
        names |= {r.name: r.unit for r in headline_of(report.trials, report.criteria)}
    for label, report in reports:
        worst = {r.name: r.worst for r in headline_of(report.trials, report.criteria)}
        missed = _words(missed_of(report)) or "none"
        rows.append((label, *(worst.get(name) for name in names), missed))
    headings = [f"{n.replace('_', ' ')}{f' [{u}]' if u else ''}" for n, u in names.items()]
    return Table(
        title="The true model",
        columns=("run", *headings, "missed"),
        rows=tuple(rows),
        criterion="nothing is missed",
        passed=all(report.passed for _, report in reports),
    )


def wrong_table(findings: Sequence[Finding], *, uncertainty: str) -> Table:
    """Return what was caught, by what, and from which size on."""
    return table_of(
        findings,
        {
            "wrong model": lambda f: f.model.name,
            "size": lambda f: _sized(f, f.model.size),
            "caught by": lambda f: _words(f.own.missed) or "not caught",
            "caught from": lambda f: _sized(f, f.caught_from()),
            "by": _by,
            "largest that passes": lambda f: _sized(f, f.passes_at),
            f"caught from, modulus known to {_MEASURED}": lambda f: _sized(
                f, f.caught_from(measured=True)
            ),
            "what hides less": lambda f: f.model.hides.format(uncertainty=uncertainty),
            "sizes looked at": lambda f: len(f.looks),
            "time [s]": lambda f: round(sum(look.seconds for look in f.looks.values())),
        },
        title="Wrong models",
        criterion="each is caught, or the smallest size that is caught is named",
        passed=all(found.caught for found in findings),
    )


def check_page(true: Table, wrong: Table, *, command: str, preset: str, version: str) -> str:
    """Return the page."""
    facts = {
        "true_model": true,
        "wrong_models": wrong,
        "command": command,
        "preset": preset,
        "measured": _MEASURED,
        "step": f"{2.0 ** (1.0 / STEPS_TO_DOUBLE):.3g}",
        "version": version,
    }
    return page("tests.studies.verdict", "verdict_check.md.jinja", facts)


def _by(found: Finding) -> str:
    """Return what catches the smallest size that is caught."""
    smallest = found.caught_from()
    return "" if not found.model.size or smallest is None else _words(found.looks[smallest].missed)


def _sized(found: Finding, size: float | None) -> str:
    """Return a size; nothing for a model that has none, for which it is caught or not."""
    if not found.model.size:
        return ""
    return "none" if size is None else f"{size:.3g} {found.model.unit}"


def _words(names: Sequence[str]) -> str:
    return ", ".join(name.replace("_", " ") for name in names)


def verdict_check(
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN...",
            help="Replayed runs: the first is replayed wrongly, of all the true.",
            exists=True,
            file_okay=False,
        ),
    ],
    preset: Annotated[
        Preset, typer.Option("--preset", help="Of the wrong replays; what is cheap will do.")
    ] = Preset.FAST,
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="PATTERN", help="Such as 'gel*'; may be repeated."),
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="The page.")] = Path(
        "docs/results/verdict_check.md"
    ),
    jobs: Jobs = 1,
) -> Found:
    """Say which wrong models the verdict catches, and the smallest change of each that it does."""
    from tacauchy_rig.app.cli.emulated_calibration import emulated_calibration
    from tacauchy_rig.app.replay.open_run import open_run
    from tacauchy_rig.core.parallel import parallel_map
    from tests.studies.verdict.bench import bench_of
    from tests.studies.verdict.wrong_models import WRONG_MODELS

    runs = [open_run(folder) for folder in folders]
    calibrate = emulated_calibration(runs[0].store)
    with heard(say):
        bench = bench_of(runs[0], preset=preset, calibrate=calibrate)
    tasks = tasks_of(selected(WRONG_MODELS, only or [], names=lambda m: (m.name,), kind="model"))
    say(f"{len(tasks)} sizes of wrong models, {jobs} at once")
    findings = findings_of(parallel_map(partial(_looked, bench=bench), tasks, jobs=jobs))
    uncertainty = f"{100.0 * bench.inputs.sensor.young_uncertainty()[0]:.0f} %"
    true = true_table(true_reports(runs, bench))
    wrong = wrong_table(findings, uncertainty=uncertainty)
    show_table(true)
    show_table(wrong)
    command = " ".join(["python -m tests.studies verdict", *["RUN"] * len(runs)])
    facts = {"command": command, "preset": preset.value, "version": __version__}
    write_text(out, check_page(true, wrong, **facts))
    say(f"page {out}")
    return Found({"true": true, "wrong": wrong}, passed=true.passed and wrong.passed)


def _looked(task: Task, *, bench: Bench) -> Look:
    """Look at one size of a wrong model, and say at once what was found."""
    model, size = task
    look = look_at(task, bench=bench)
    sized = f", {size:.3g} {model.unit}" if size else ""
    say(f"{model.name}{sized}: {', '.join(look.missed) or 'not caught'} [{look.seconds:.0f} s]")
    return look
