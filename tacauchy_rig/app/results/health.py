"""A sensor's health by its runs: what ``check-press`` says of each beside another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tacauchy_rig.app.gel_health.comparison import GelState
from tacauchy_rig.app.gel_health.recorded import compare_runs
from tacauchy_rig.app.replay.opening import open_run
from tacauchy_rig.app.results.found_runs import FoundRun
from tacauchy_rig.core.errors import RigError

Judge = Callable[[Path, Path], GelState]


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """A run beside the one of before.

    Attributes:
        state: None where they cannot be compared; ``fault`` says why.
    """

    run: FoundRun
    state: GelState | None
    fault: str = ""


def judge_folders(before: Path, now: Path) -> GelState:
    """Judge one run's press beside another's, as ``check-press`` does.

    Raises:
        RigError: One of them has no press to compare.
    """
    return compare_runs(open_run(before), open_run(now))


@dataclass(slots=True)
class Health:
    """Judges runs beside each other, each pair once: reading the recordings takes a second."""

    judge: Judge = judge_folders
    _known: dict[tuple[object, ...], Judged] = field(default_factory=dict)

    def of(self, before: FoundRun, now: FoundRun) -> Judged:
        """Return a run beside an earlier one."""
        key = (before.name, _age(before), now.name, _age(now))
        if key not in self._known:
            self._known[key] = self._judged(before, now)
        return self._known[key]

    def trend(self, runs: Sequence[FoundRun], like: FoundRun) -> tuple[FoundRun, list[Judged]]:
        """Return the earliest run like one, and every later one beside that, in their order."""
        alike = sorted(
            (run for run in runs if run.passed_count and run.alike == like.alike),
            key=lambda run: (run.created, run.name),
        )
        first = alike[0] if alike else like
        return first, [self.of(first, run) for run in alike[1:]]

    def _judged(self, before: FoundRun, now: FoundRun) -> Judged:
        try:
            return Judged(run=now, state=self.judge(before.folder, now.folder))
        except RigError as error:
            return Judged(run=now, state=None, fault=error.message)


def _age(run: FoundRun) -> int:
    journal = run.folder / "journal.jsonl"
    return journal.stat().st_mtime_ns if journal.is_file() else 0
