"""Study "tampering": tamper with copies of a run and record which checks notice."""

import tempfile
from collections.abc import Callable, Iterable, Sequence, Set
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from reports.comparison.run_comparison import compare
from tacauchy_rig import __version__
from tacauchy_rig.app.cli.output import Found, RunFolder, complain, say, write_text
from tacauchy_rig.app.replay.open_run import open_run
from tacauchy_rig.app.replay.report_run import evidence_of
from tacauchy_rig.core.errors import RecordError, RigError
from tacauchy_rig.core.markdown_page import page
from tacauchy_rig.core.run import Criterion
from tacauchy_rig.core.store.check.run_and_press_check import RunCheck, check_run
from tacauchy_rig.core.store.recovery import recover_run
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.tables import Table
from tests.studies.tampering.cases import TamperCase
from tests.studies.tampering.copy import Care, RunCopy


class Reader(StrEnum):
    """Commands that read a run. What ``recover`` says, ``resume`` says before anything moves."""

    REPORT = "report"
    REPLAY = "replay"
    RECOVER = "recover, resume"


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """What was noticed of one case."""

    case: str
    care: Care
    # Per command, the criteria that were missed, or the refusal in words.
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
    """Tamper with a copy of ``run`` and let every command read it."""
    with tempfile.TemporaryDirectory() as folder:
        copy = RunCopy.of(run, Path(folder), care)
        case.change(copy)
        if care is Care.RESEALED:
            copy.reseal()
        named = {
            Reader.REPORT.value: _named(lambda: _reported(copy.root, missed)),
            Reader.REPLAY.value: _named(lambda: missed_names(check_run(RunStore.open(copy.root)))),
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


def missed_names(check: RunCheck) -> Sequence[str]:
    """Return the criteria that a check of a run's files misses."""
    return _missed(check.run, *check.attempts.values())


def _recovered(root: Path) -> Iterable[str]:
    recovery = recover_run(RunStore.open(root))
    yield from missed_names(recovery.check)
    if any(report.problems for report in recovery.recordings):
        yield "not recovered"
    if recovery.was_cut_off:
        yield "journal had no end"


def _named(read: Callable[[], Iterable[str]]) -> tuple[str, ...]:
    try:
        return tuple(read())
    except RigError as error:
        return (f"refused: {Path(error.message.split(':')[0].split(' line')[0]).name}",)


_SHOWN = 3  # criteria that a cell names; one edit often breaks many
_FOLLOWS = "replay_files"  # missed whenever anything is that a replay was made from; named last


def summary_line(seen: Sequence[Observation]) -> str:
    """Return the whole table in one paragraph."""
    parts = [f"{len({s.case for s in seen})} kinds of tampering"]
    for care in Care:
        own = [s for s in seen if s.care is care]
        unseen = sum(bool(s.unseen_by) for s in own)
        parts.append(f"{care.value}: {len(own) - unseen} of {len(own)} named by every command")
    return "; ".join(parts) + "."


def misses(seen: Sequence[Observation]) -> list[Observation]:
    """Return what was not named by every command though its hashes were wrong."""
    return [s for s in seen if s.unseen_by and s.care is not Care.RESEALED]


def tamper_page(seen: Sequence[Observation], *, command: str, press_count: int) -> str:
    """Return the document."""
    groups: dict[str, list[str]] = {}
    for case in dict.fromkeys(s.case for s in seen):
        groups.setdefault(case.partition(":")[0], []).append(case)
    unseen = [s for s in seen if s.care is Care.RESEALED and s.unseen_by]
    return page(
        "tests.studies.tampering",
        "tamper_table.md.jinja",
        {
            "summary": summary_line(seen),
            "command": command,
            "version": __version__,
            "press_count": press_count,
            "tables": {name: _table(cases, seen) for name, cases in groups.items()},
            "unseen": [s for s in unseen if not s.is_judged],
            "judged": [s for s in unseen if s.is_judged],
        },
    )


def _table(cases: Sequence[str], seen: Sequence[Observation]) -> Table:
    found = {(s.case, s.care): _cell(s) for s in seen}
    return Table(
        columns=("what is done", *(care.value for care in Care)),
        rows=tuple(
            (case.partition(": ")[2], *(found.get((case, care), "–") for care in Care))
            for case in cases
        ),
    )


def _cell(seen: Observation) -> str:
    if seen.is_judged or not seen.names:
        return f"verdict: {', '.join(seen.names)}" if seen.names else "nothing"
    names = sorted(seen.names, key=lambda name: name == _FOLLOWS)
    shown = ", ".join(names[:_SHOWN])
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    unseen = f"; not by {', '.join(seen.unseen_by)}" if seen.unseen_by else ""
    return f"{shown}{more}{unseen}"


def tamper_table(
    folder: RunFolder,
    out: Annotated[Path, typer.Option("--out", help="The table.")] = Path(
        "docs/results/tamper_table.md"
    ),
) -> Found:
    """Tamper with copies of a finished, replayed run in every way; write what is noticed."""
    from tests.studies.tampering.cases import all_cases

    store = RunStore.open(folder)
    _require_whole(store)
    missed = verdict_of(folder)
    seen: list[Observation] = []
    for case in all_cases():
        for care in case.cares:
            found = observe(case, care, folder, missed=missed)
            seen.append(found)
            say(f"{case.name} ({care.value}): {', '.join(found.names) or 'nothing'}")
    count = len(store.config.protocol.force_targets)
    write_text(
        out, tamper_page(seen, command="python -m tests.studies tampering RUN", press_count=count)
    )
    say(summary_line(seen))
    say(f"table {out}")
    for miss in misses(seen):
        complain(f"{miss.case} ({miss.care.value}) is not named by {', '.join(miss.unseen_by)}")
    return Found({"cases": seen}, passed=not misses(seen))


def _require_whole(store: RunStore) -> None:
    """Refuse a run that has nothing to tamper with, or was tampered with."""
    from tests.studies.tampering.cases import OTHER

    root = store.paths.root
    wrong = list(check_run(store).missed())
    if wrong:
        raise RecordError(f"{root}: is not whole: {wrong[0]}", remedy="give another run")
    if not store.replays() or store.accepted(OTHER) is None or not store.paths.truth.exists():
        raise RecordError(
            f"{root}: needs {OTHER} passed presses, a replay and the truth of what was emulated",
            remedy="`tacauchy-rig dry-run` makes such a run",
        )
