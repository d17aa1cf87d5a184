"""Tamper with a copy of a run, and see which command names it."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from reports.comparison.compare import compare
from tacauchy_rig.errors import RigError
from tacauchy_rig.loop.opening import open_run
from tacauchy_rig.loop.report import evidence_of
from tacauchy_rig.run import Criterion
from tacauchy_rig.store.check.run import RunCheck, check_run
from tacauchy_rig.store.recovery import recover_run
from tacauchy_rig.store.run_store import RunStore
from tacauchy_rig.tampering.case import TamperCase
from tacauchy_rig.tampering.copy import Care, RunCopy


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
        judged: Where no check noticed it: criteria of the verdict that are missed now.
    """

    case: str
    care: Care
    named: dict[str, tuple[str, ...]]
    judged: tuple[str, ...] = ()

    @property
    def unseen_by(self) -> tuple[str, ...]:
        """The commands that did not notice it."""
        return tuple(reader for reader, names in self.named.items() if not names)


def observe(case: TamperCase, care: Care, run: Path) -> Observation:
    """Tamper with a copy of ``run`` and let every command read it."""
    with tempfile.TemporaryDirectory() as folder:
        copy = RunCopy.of(run, Path(folder), care)
        case.change(copy)
        if care is Care.RESEALED:
            copy.reseal()
        checked = _names(lambda: missed_of(check_run(RunStore.open(copy.root))))
        named = {
            Reader.REPORT.value: _names(lambda: _opened(copy.root)) or checked,
            Reader.REPLAY.value: checked,
        }
        judged = () if checked else tuple(sorted(verdict_of(copy.root) - verdict_of(run)))
        named[Reader.RECOVER.value] = _names(lambda: _recovered(copy.root))
    return Observation(case=case.name, care=care, named=named, judged=judged)


def missed_of(check: RunCheck) -> Iterator[str]:
    """Yield the names of the criteria that are missed, each once."""
    return _unmet([*check.run, *(c for criteria in check.attempts.values() for c in criteria)])


def verdict_of(root: Path) -> set[str]:
    """Return the criteria that the report of a run misses."""
    report = compare(evidence_of(open_run(root)))
    return set(_unmet([*report.criteria, *(c for trial in report.trials for c in trial.criteria)]))


def _unmet(criteria: Iterable[Criterion]) -> Iterator[str]:
    return iter(dict.fromkeys(c.name for c in criteria if not c.passed))


def _opened(root: Path) -> Iterator[str]:
    """Open a run as the report does, which refuses what it cannot read."""
    open_run(root)
    return iter(())


def _recovered(root: Path) -> Iterator[str]:
    recovery = recover_run(RunStore.open(root))
    yield from missed_of(recovery.check)
    if any(report.problems for report in recovery.recordings):
        yield "not recovered"
    if recovery.was_cut_off:
        yield "journal had no end"


def _names(read: Callable[[], Iterator[str]]) -> tuple[str, ...]:
    try:
        return tuple(read())
    except RigError as error:
        return (f"refused: {Path(error.message.split(':')[0].split(' line')[0]).name}",)
