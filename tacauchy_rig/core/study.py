"""A study: cases that are measured, their tables with criteria, and a page.

A study subclasses ``Study`` and says what its cases are and what tables their results make.
``tacauchy_rig.app.cli.studies`` turns it into a command that selects cases, measures them one
by one or in parallel, keeps what was found, and writes a page and JSON.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from fnmatch import fnmatch
from functools import partial
from itertools import groupby
from pathlib import Path
from queue import SimpleQueue
from threading import Event
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeVar

from tacauchy_rig.core.errors import ConfigError, RigError
from tacauchy_rig.core.markdown_page import criteria_page, page
from tacauchy_rig.core.parallel import IsolatedWorker
from tacauchy_rig.core.tables import Table, table_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DAY_S = 86_400.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One thing to measure."""

    name: str  # of the case; ``--only`` selects by it
    # Returns plain values (dictionaries, lists, text, numbers), so that they can be kept as JSON.
    # It and they can be pickled, unless the study runs in one process.
    measure: Callable[[], Any]
    # What sets the case apart, for ``--list``. A kept result must agree with it.
    shows: str = ""
    alias: str = ""  # another name that ``--only`` selects by, such as a number
    limit_s: float = DAY_S  # time after which the case has failed, if ``--limit`` is not given [s]
    # Neighbouring cases of one such name share a process, where the next one finds what the one
    # before has loaded; empty for a process of its own
    process: str = ""
    # It gets a process of its own in any case, so that a crash or a hang fails it alone
    is_isolated: bool = False
    on_request: bool = False  # measured only if ``--only`` names it


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What came out of a case."""

    name: str
    shows: str = ""
    found: Any = None  # what the case measured; None where ``failure`` says why there is nothing
    failure: str = ""
    wall_s: float = 0.0  # time that it took [s]


class About(NamedTuple):
    """What a page says of its making.

    Attributes:
        command: That made it.
        commit: Of the program; empty where it is not known.
        open_count: Cases that were selected and are not measured yet.
    """

    command: str
    commit: str = ""
    open_count: int = 0


class Study:
    """A study; subclasses say what is measured and shown.

    Attributes:
        name: Of page, JSON and figure.
        title: Of the page.
        kind: What a case is called in messages.
        page_file: Where the page goes if nothing is said and every case is measured.
        is_together: Cases go on from one another and stay in this process: no ``--jobs``, no
            ``--limit``.
        is_resumable: Results are plain values, so that ``--resume`` can take them from JSON.
        is_framed: The figures are maps and images, with a frame all around.
        template: Of the page, in the study's package; empty for that of all studies.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    kind: ClassVar[str] = "case"
    page_file: ClassVar[Path | None] = None
    is_together: ClassVar[bool] = False
    is_resumable: ClassVar[bool] = True
    is_framed: ClassVar[bool] = False
    template: ClassVar[str] = ""

    def cases(self) -> Sequence[Case]:
        """Return all cases, in the order of the page."""
        raise NotImplementedError

    def pattern(self, text: str) -> str:
        """Return the pattern of names that ``--only`` means by a text."""
        return text

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return what is shown of the results, each table with its criterion."""
        raise NotImplementedError

    def line(self, result: Result) -> str:
        """Return what is said of a result without a failure as soon as it is there."""
        return f"done after {result.wall_s:.1f} s"

    def facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return what the JSON holds beside the results themselves."""
        return {"tables": self.tables(results)}

    def figures(self, results: Sequence[Result]) -> Mapping[str, Figure]:
        """Return the figures by name; they are drawn, saved and shown on the page."""
        del results
        return {}

    def note(self, results: Sequence[Result]) -> str:
        """Return what a reader has to know before all tables."""
        del results
        return ""

    def page_facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return what the study's own template is told, beside tables and command."""
        del results
        return {}

    def page(self, results: Sequence[Result], about: About, images: Sequence[str]) -> str:
        """Return the page.

        Args:
            images: Files of the figures, beside the page.
        """
        if self.template:
            facts = {"command": about.command, "tables": self.tables(results)}
            package = type(self).__module__.rpartition(".")[0]
            return page(package, self.template, facts | dict(self.page_facts(results)))
        notes = [self.note(results)]
        if about.commit:
            notes.append(f"Commit {about.commit}.")
        if about.open_count:
            notes.append(f"Interrupted: {about.open_count} selected cases were not measured.")
        return criteria_page(
            self.tables(results),
            title=self.title,
            note=" ".join(filter(None, notes)),
            images=images,
            command=about.command,
        )

    def has_passed(self, results: Sequence[Result]) -> bool:
        """Return whether every case was measured and every criterion is met."""
        return all(table.passed for table in self.tables(results)) and not any(
            result.failure for result in results
        )


def failures_table(results: Sequence[Result], *, kind: str = "case") -> list[Table]:
    """Return a table of the cases without numbers, or nothing where there is none."""
    failed = [result for result in results if result.failure]
    table = table_of(
        failed,
        {kind: lambda result: result.name, "why": lambda result: result.failure},
        title=f"{kind.capitalize()}s without numbers",
        criterion=f"every {kind} comes to its end",
        passed=False,
        note=f"{len(failed)} of {len(results)}.",
    )
    return [table] if failed else []


def founds(results: Sequence[Result]) -> list[Any]:
    """Return what was found where there is something."""
    return [result.found for result in results if not result.failure]


def measured(
    cases: Sequence[Case], *, jobs: int = 1, limit_s: float | None = None
) -> Iterator[Result]:
    """Yield the result of every case as soon as it is there.

    Args:
        jobs: How many at once; more than one are measured in processes of their own.
        limit_s: Time after which a case has failed [s], in place of its own limit.
    """
    is_apart = jobs > 1 or limit_s is not None
    yield from (_result(c, c.measure) for c in cases if not (c.is_isolated or is_apart))
    apart = [case for case in cases if case.is_isolated or is_apart]
    groups = [list(each) for _, each in groupby(apart, key=lambda c: c.process or c.name)]
    found: SimpleQueue[Result | Exception] = SimpleQueue()
    free: SimpleQueue[IsolatedWorker] = SimpleQueue()
    stopped = Event()

    def work(group: Sequence[Case]) -> None:
        process = free.get()
        try:
            for case in group:
                if not stopped.is_set():
                    allowed = case.limit_s if limit_s is None else limit_s
                    found.put(_result(case, partial(process.call, case.measure, limit_s=allowed)))
        except Exception as error:  # noqa: BLE001 - a thread's top: raised where results are taken
            found.put(error)
        process.end()
        free.put(process)

    with ExitStack() as running:
        for _ in range(jobs):
            free.put(running.enter_context(IsolatedWorker()))
        pool = ThreadPoolExecutor(jobs)
        running.callback(pool.shutdown, wait=False, cancel_futures=True)
        running.callback(stopped.set)
        for group in groups:
            pool.submit(work, group)
        for _ in apart:
            each = found.get()
            if isinstance(each, Exception):
                raise each
            yield each


def _result(case: Case, measure: Callable[[], Any]) -> Result:
    started, found, failure = time.monotonic(), None, ""
    try:
        found = measure()
    except RigError as error:
        failure = " ".join(error.message.split())
    spent = time.monotonic() - started
    return Result(name=case.name, shows=case.shows, found=found, failure=failure, wall_s=spent)


def kept_results(files: Sequence[Path], cases: Sequence[Case]) -> dict[str, Result]:
    """Read results of earlier runs, by case; of a case in several files the last counts.

    Args:
        cases: Those that are selected; results of others are left out.

    Raises:
        ConfigError: A file holds no results, or those of another case of the same name.
    """
    known = {case.name: case for case in cases}
    kept: dict[str, Result] = {}
    for file in files:
        try:
            rows = [Result(**row) for row in json.loads(file.read_text("utf-8"))["results"]]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ConfigError(
                f"--resume {file}: {error!r}", remedy="give what --json wrote"
            ) from error
        own = [row for row in rows if row.name in known]
        if others := [row.name for row in own if row.shows != known[row.name].shows]:
            raise ConfigError(
                f"--resume {file}: {', '.join(others)} differs there",
                remedy="give the options of that run",
            )
        kept |= {row.name: row for row in own}
    return kept


Item = TypeVar("Item")


def selected(
    items: Sequence[Item],
    patterns: Sequence[str],
    *,
    names: Callable[[Item], Sequence[str]],
    kind: str,
    remedy: str = "",
) -> tuple[Item, ...]:
    """Return the items of which a pattern matches a name, in their order; all without patterns.

    Args:
        names: Of an item; a list of what there is shows the first.
        kind: What an item is called in messages.
        remedy: Instead of that list.

    Raises:
        ConfigError: A pattern matches nothing.
    """
    found = {
        pattern: [item for item in items if any(fnmatch(name, pattern) for name in names(item))]
        for pattern in patterns
    }
    for pattern, fitting in found.items():
        if not fitting:
            known = "; ".join(names(item)[0] for item in items)
            raise ConfigError(
                f"--only {pattern!r}: no such {kind}", remedy=remedy or f"choose among {known}"
            )
    if not patterns:
        return tuple(items)
    return tuple(item for item in items if any(item in fitting for fitting in found.values()))
