"""Tamper with a copy of a run, and see which command names it."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Sequence, Set
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from reports.comparison.compare import compare
from tacauchy_rig.app.replay.opening import open_run
from tacauchy_rig.app.replay.report import evidence_of
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.run import Criterion
from tacauchy_rig.core.store.check.run import check_run
from tacauchy_rig.core.store.recovery import recover_run
from tacauchy_rig.core.store.run_store import RunStore
from tests.studies.tampering.case import TamperCase
from tests.studies.tampering.copy import Care, RunCopy


class Reader(StrEnum):
    """Commands that read a run. What ``recover`` says, ``resume`` says before anything moves."""

    REPORT = "report"
    REPLAY = "replay"
    RECOVER = "recover, resume"


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """What was noticed of one case.

    Attributes:
        named: Per command, the criteria that were missed, or the refusal in words.
    """

    case: str
    care: Care
    named: dict[str, tuple[str, ...]]

    @property
    def unseen_by(self) -> tuple[str, ...]:
        """The commands that did not notice it."""
        return tuple(reader for reader, names in self.named.items() if not names)

    @property
    def names(self) -> tuple[str, ...]:
        """What the checks of the files name; where they name nothing, what the verdict misses."""
        return self.named[Reader.REPLAY] or self.named[Reader.REPORT]

    @property
    def is_judged(self) -> bool:
        """True where no check of the files names it, and the verdict does."""
        return not self.named[Reader.REPLAY] and bool(self.named[Reader.REPORT])


def observe(case: TamperCase, care: Care, run: Path, *, missed: Set[str]) -> Observation:
    """Tamper with a copy of ``run`` and let every command read it.

    Args:
        case: What is done.
        care: How far it is followed up.
        run: The run; nothing of it is changed.
        missed: What its own report misses.
    """
    with tempfile.TemporaryDirectory() as folder:
        copy = RunCopy.of(run, Path(folder), care)
        case.change(copy)
        if care is Care.RESEALED:
            copy.reseal()
        named = {
            Reader.REPORT.value: _named(lambda: _reported(copy.root, missed)),
            Reader.REPLAY.value: _named(lambda: check_run(RunStore.open(copy.root)).missed_names()),
            Reader.RECOVER.value: _named(lambda: _recovered(copy.root)),
        }
    return Observation(case=case.name, care=care, named=named)


def verdict_of(root: Path) -> set[str]:
    """Return the criteria that the report of a run misses."""
    report = compare(evidence_of(open_run(root)))
    return set(_missed(report.criteria, *(trial.criteria for trial in report.trials)))


def _reported(root: Path, missed: Set[str]) -> Iterable[str]:
    """Return what the report lists of its checks; where they are met, what else it misses now."""
    evidence = evidence_of(open_run(root))
    checks = _missed(evidence.checks, *(trial.checks for trial in evidence.trials))
    return checks or sorted(verdict_of(root) - missed)


def _missed(*criteria: Sequence[Criterion]) -> Sequence[str]:
    return list(dict.fromkeys(c.name for each in criteria for c in each if not c.passed))


def _recovered(root: Path) -> Iterable[str]:
    recovery = recover_run(RunStore.open(root))
    yield from recovery.check.missed_names()
    if any(report.problems for report in recovery.recordings):
        yield "not recovered"
    if recovery.was_cut_off:
        yield "journal had no end"


def _named(read: Callable[[], Iterable[str]]) -> tuple[str, ...]:
    try:
        return tuple(read())
    except RigError as error:
        return (f"refused: {Path(error.message.split(':')[0].split(' line')[0]).name}",)
