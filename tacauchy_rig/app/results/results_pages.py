"""Pages of results: a folder's runs, a comparison of two, a sensor's trend, and who serves them."""

import math
import os
from base64 import b64encode
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from hashlib import sha256
from importlib import resources
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from protocols.processes.page.access_token import AccessRule
from reports.page.report_html import at, report_script
from sim.scene.indenter import describe
from tacauchy_rig.app.gel_health import COVERAGE, Change, GelState, compare_runs
from tacauchy_rig.app.replay.open_run import open_run
from tacauchy_rig.app.replay.simulator_inputs import indenter_of
from tacauchy_rig.app.twin.run_follower import watch_script
from tacauchy_rig.core.errors import ConfigError, RecordError, RigError, command_line
from tacauchy_rig.core.markdown_page import environment_of
from tacauchy_rig.core.run import Outcome
from tacauchy_rig.core.store.json_codec import loads
from tacauchy_rig.core.store.run_files import MAX_BYTES, ascii_path, read_bytes
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.store.trusted_force import force_series

DESCRIPTION = "run.json"
REPORT = Path("report", "report.html")
SUMMARY = Path("report", "summary.json")
FIGURES = Path("report", "figures")
# An imported press was watched by no protocol: it can neither pass nor fail.
_USED = (Outcome.PASSED, Outcome.IMPORTED)


@dataclass(frozen=True, slots=True, kw_only=True)
class ListedRun:
    """A run's folder at a glance."""

    name: str  # of the folder
    folder: Path
    fault: str = ""  # why it cannot be read; empty where it can
    created: str = ""  # in ISO 8601
    kind: str = ""  # ``live``, ``dry`` or ``imported``
    sensor: str = ""
    indenter: str = ""
    trial_count: int = 0  # trials that it was to have
    passed_count: int = 0  # trials that passed and are not doubted since
    # Least and most measured force of these [N]; None where none passed
    forces_n: tuple[float, float] | None = None
    # ``summary.json`` of its report; empty where there is none
    summary: dict[str, Any] = field(default_factory=dict)
    figures: tuple[str, ...] = ()  # names of the PDF figures of its report
    missed: tuple[str, ...] = ()  # criteria that its report says were not met, in words
    next_command: str = ""  # what to do next with it; empty where nothing is left to do

    @property
    def has_report(self) -> bool:
        """There is a page to open."""
        return (self.folder / REPORT).is_file()

    @property
    def alike(self) -> tuple[str, str, str]:
        """What runs have in common whose presses can be compared."""
        return self.kind, self.sensor, self.indenter


def folder_of_runs(path: Path) -> tuple[Path, str]:
    """Return the folder that runs lie in, and the one run that was asked for.

    Raises:
        ConfigError: It does not exist, or holds no run.
    """
    if not path.is_dir():
        raise ConfigError(
            f"{path}: there is no such folder",
            remedy="name the folder that runs were written to; `tacauchy-rig dry-run` makes one",
        )
    if (path / DESCRIPTION).is_file():
        return path.resolve().parent, path.resolve().name
    if not any(_folders(path)):
        raise ConfigError(
            f"{path}: contains no run",
            remedy="`tacauchy-rig dry-run` or `tacauchy-rig run rig.toml` record one",
        )
    return path.resolve(), ""


def find_runs(root: Path, *, only: str = "") -> list[ListedRun]:
    """Return the runs in a folder, the newest first."""
    folders = [folder for folder in _folders(root) if not only or folder.name == only]
    found = [_found(folder) for folder in folders]
    return sorted(found, key=lambda run: (run.created, run.name), reverse=True)


def _folders(root: Path) -> list[Path]:
    inside = [each for each in root.iterdir() if each.is_dir() and not each.is_symlink()]
    return [each for each in inside if os.path.lexists(each / DESCRIPTION)]


def _found(folder: Path) -> ListedRun:
    try:
        return _read(folder)
    except Exception as error:  # noqa: BLE001 - a run from elsewhere must not hide the others
        return ListedRun(name=ascii_path(Path(folder.name)), folder=folder, fault=_reason(error))


def _reason(error: Exception) -> str:
    return error.message if isinstance(error, RigError) else f"{type(error).__name__}: {error}"


def _read(folder: Path) -> ListedRun:
    store = RunStore.open(folder)
    records = [each for index in store.trial_indices() if (each := store.counting(index))]
    doubted = force_series(store).doubted
    passed = [
        each
        for each in records
        if each.outcome in _USED and (each.index, each.attempt) not in doubted
    ]
    forces = [each.force_measured_n for each in passed if each.force_measured_n is not None]
    config, wanted = store.config, len(store.trial_indices())
    summary = _summary(folder / SUMMARY)
    todo = None if summary else "report"
    if not store.replays():
        todo = "replay"
    if len(passed) < wanted and not config.is_imported:
        todo = "resume"
    kind = "imported" if config.is_imported else "dry" if store.simulated else "live"
    return ListedRun(
        name=folder.name,
        folder=folder,
        created=str(store.description["created"]),
        kind=kind,
        sensor=config.sensor.name,
        indenter=_indenter(store),
        trial_count=wanted,
        passed_count=len(passed),
        forces_n=(min(forces), max(forces)) if forces else None,
        summary=summary,
        missed=tuple(
            f"{where}{str(each.get('name')).replace('_', ' ')}; required: {each.get('limit')}"
            for where, each in criteria_of(summary)
            if each.get("passed") is False
        ),
        figures=tuple(sorted(path.name for path in (folder / FIGURES).glob("*.pdf"))),
        next_command="" if todo is None else command_line(todo, folder),
    )


def _indenter(store: RunStore) -> str:
    """Return the indenter of a run, or how many an import has."""
    kinds = {trial.indenter for trial in store.imported_trials.values()} or {""}
    if len(kinds) > 1:
        return f"{len(kinds)} indenters"
    (kind,) = kinds
    return kind or describe(indenter_of(store.config))


def _summary(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    found = loads(read_bytes(path, what="the summary of its report"), source=str(path))
    for name, kind in (("passed", bool), ("verdict", str)):
        if not isinstance(found, dict) or not isinstance(found.get(name), kind):
            raise RecordError(
                f"{path}: {name}: missing or of the wrong type",
                remedy=f"`{command_line('report', path.parent.parent)}` writes it again",
            )
    return dict(found)


def criteria_of(summary: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each criterion of a report after where it is: ``"trial 1: "``, or empty for the run."""
    trials = summary.get("trials")
    places: list[tuple[str, Any]] = [("", summary)]
    places += [(f"trial {k}: ", t) for k, t in enumerate(trials, 1)] if trials else []
    for where, place in places:
        criteria = place.get("criteria") if isinstance(place, dict) else None
        for criterion in criteria if isinstance(criteria, list) else ():
            if isinstance(criterion, dict):
                yield where, criterion


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """A run compared with an earlier one."""

    run: ListedRun
    state: GelState | None  # None where they cannot be compared; ``fault`` says why
    fault: str = ""


def judged_by(before: ListedRun, now: ListedRun) -> Judged:
    """Return a run compared with an earlier one, as ``check-press`` compares them."""
    found = _compared(before.folder, now.folder, (_age(before), _age(now)))
    if isinstance(found, str):
        return Judged(run=now, state=None, fault=found)
    return Judged(run=now, state=found)


@cache
def _compared(before: Path, now: Path, _ages: tuple[int, int]) -> GelState | str:
    """Compare two runs, or say why that cannot be: once, for reading recordings takes a second."""
    try:
        return compare_runs(open_run(before), open_run(now))
    except Exception as error:  # noqa: BLE001 - a run from elsewhere must not hide the others
        return _reason(error)


def trend(runs: Sequence[ListedRun], like: ListedRun) -> tuple[ListedRun, list[Judged]]:
    """Return the earliest comparable run, and every later one compared with it, in order."""
    alike = sorted(
        (run for run in runs if run.passed_count and run.alike == like.alike),
        key=lambda run: (run.created, run.name),
    )
    first = alike[0] if alike else like
    return first, [judged_by(first, run) for run in alike[1:]]


def _age(run: ListedRun) -> int:
    journal = run.folder / "journal.jsonl"
    return journal.stat().st_mtime_ns if journal.is_file() else 0


# What a report says of all trials of a run: title, its place in the summary, factor and unit.
_OF_ALL = (
    ("SSIM", "metrics.ssim", 1.0, ""),
    ("SSIM without contact", "no_contact.ssim", 1.0, ""),
    ("NCC", "metrics.ncc", 1.0, ""),
    ("NCC without contact", "no_contact.ncc", 1.0, ""),
    ("PSNR", "metrics.psnr_db", 1.0, "dB"),
    ("unexplained of the contact", "contact_relative_residual", 100.0, "%"),
    ("predicted force off by", "prediction_error_relative", 100.0, "%"),
)
_ROOM = 1.4
"""Of the limit, shown beyond it and beyond what was found."""
Value = tuple[float, float | None] | None
"""A number and its standard deviation; None where it is not known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A number of both runs."""

    title: str
    unit: str
    one: Value
    other: Value

    @property
    def difference(self) -> float | None:
        """The other's value less the one's."""
        return None if self.one is None or self.other is None else self.other[0] - self.one[0]

    @property
    def spreads(self) -> float | None:
        """The difference over the deviations of both; None where neither is known."""
        if self.difference is None or self.one is None or self.other is None:
            return None
        both = math.hypot(*(each or 0.0 for each in (self.one[1], self.other[1])))
        return self.difference / both if both > 0.0 else None


def compare(one: ListedRun, other: ListedRun) -> list[Row]:
    """Return the numbers of two runs' reports, row by row."""
    summaries = one.summary, other.summary
    models = [summary.get("model") for summary in summaries]
    modulus = "modulus_factor", "modulus_factor_deviation"
    rows = [_row("modulus, of the stated one", "", models, *modulus)]
    for title, place, factor, unit in _OF_ALL:
        found = [at(summary, f"statistics.{place}") for summary in summaries]
        rows.append(_row(title, unit, found, "mean", "deviation", factor))
    trials = [_trials(summary) for summary in summaries]
    for index in sorted(set(trials[0]) & set(trials[1])):
        both = [of_run[index] for of_run in trials]
        force = "force_measured_n", "force_deviation_n"
        rows.append(_row(f"force of trial {index}", "N", both, *force))
        rows.append(_row(f"depth of trial {index}", "mm", both, "depth_measured_m", "", 1e3))
    return [row for row in rows if row.one is not None or row.other is not None]


def _row(
    title: str, unit: str, places: Sequence[Any], name: str, deviation: str, factor: float = 1.0
) -> Row:
    """Return a number of two places in summaries, by its name and that of its deviation."""
    values: list[Value] = []
    for place in places:
        value, spread = at(place, name), at(place, deviation)
        known_spread = factor * spread if isinstance(spread, (int, float)) else None
        is_known = isinstance(value, (int, float))
        values.append((factor * value, known_spread) if is_known else None)
    return Row(title=title, unit=unit, one=values[0], other=values[1])


def _trials(summary: dict[str, Any]) -> dict[int, dict[str, Any]]:
    found = summary.get("trials")
    trials = found if isinstance(found, list) else []
    return {trial["index"]: trial for trial in trials if isinstance(at(trial, "index"), int)}


def differing(one: ListedRun, other: ListedRun) -> list[tuple[str, str, str]]:
    """Return the criteria that one run met and the other did not: name, and both outcomes."""
    outcomes = _outcomes(one.summary), _outcomes(other.summary)
    names = list(dict.fromkeys([*outcomes[0], *outcomes[1]]))
    rows = [(name, outcomes[0].get(name), outcomes[1].get(name)) for name in names]
    return [
        (name.replace("_", " "), _in_words(a), _in_words(b))
        for name, a, b in rows
        if (a is not None and a[0] == a[1]) != (b is not None and b[0] == b[1])
    ]


def _outcomes(summary: dict[str, Any]) -> dict[str, tuple[int, int]]:
    """Return in how many cases each criterion of a report was met, of how many."""
    found: dict[str, tuple[int, int]] = {}
    for _, criterion in criteria_of(summary):
        name = str(criterion.get("name"))
        met, count = found.get(name, (0, 0))
        found[name] = met + (criterion.get("passed") is True), count + 1
    return found


def _in_words(outcome: tuple[int, int] | None) -> str:
    return "not judged" if outcome is None else f"met in {outcome[0]} of {outcome[1]}"


def charts_of(judged: Sequence[Judged]) -> Iterator[dict[str, Any]]:
    """Yield the ``changes`` of each thing that ``check-press`` looks at, and the chart's end."""
    states = [(each.run, each.state.changes) for each in judged if each.state is not None]
    for k in range(len(states[0][1]) if states else 0):
        changes = [(run, found[k]) for run, found in states]
        reach = [abs(change.value) + COVERAGE * change.uncertainty for _, change in changes]
        yield {"changes": changes, "most": _ROOM * max(changes[0][1].limit, *reach)}


def in_words(value: float, change: Change) -> str:
    """Return a number in the unit of a change."""
    digits, factor, unit = (2, 1.0, change.unit) if change.unit else (1, 100.0, "%")
    return f"{round(factor * value, digits) + 0.0:+.{digits}f} {unit}"


MEDIA_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".json": "application/json",
    ".csv": "text/csv; charset=utf-8",
    ".xml": "application/xml",
    ".pdf": "application/pdf",
    ".png": "image/png",
}
"""What of a run's report is served, by the end of a file's name."""
OPENED = ("report/", "watch.html")
"""Where in a run's folder that lies."""
_OWN = {
    "content-security-policy": "default-src 'self'; img-src 'self' data:; form-action 'self'; "
    "base-uri 'none'; frame-ancestors 'none'"
}


@cache
def headers_of_runs() -> dict[str, str]:
    """Return the headers of a run's files, which may be from somebody else.

    Only the two scripts that this program writes run, in a sandbox of their own; nothing is loaded
    from and nothing is sent to anywhere.
    """
    hashes = (sha256(script.encode()).digest() for script in (report_script(), watch_script()))
    scripts = " ".join(f"'sha256-{b64encode(each).decode()}'" for each in hashes)
    return {
        "content-security-policy": f"sandbox allow-scripts; default-src 'none'; "
        f"script-src {scripts}; img-src data:; style-src 'unsafe-inline'; font-src data:; "
        "form-action 'none'; base-uri 'none'; frame-ancestors 'none'",
        "x-dns-prefetch-control": "off",
    }


class ResultsServer:
    """Answers what a browser asks of a folder of runs; it writes nothing.

    Args:
        only: The one run that is shown; empty shows all.
    """

    def __init__(self, root: Path, access: AccessRule, *, only: str = "") -> None:
        self._root, self._only, self._access = root, only, access
        self._pages = environment_of("tacauchy_rig.app.results")
        self._pages.filters["in_words"] = in_words
        style = resources.files("tacauchy_rig.app.results").joinpath("templates", "results.css")
        self._style = Response(style.read_bytes(), media_type="text/css; charset=utf-8")

    @property
    def app(self) -> ASGIApp:
        """The application, behind its access rule."""
        routes = [
            Route("/", self._list),  # each in a thread: recordings take a second to read
            Route("/compare", self._compare),
            Route("/health/{name}", self._trend),
            Route("/results.css", lambda _request: self._style),
            Route("/run/{name}/{path:path}", self._file),
        ]
        inner = Starlette(routes=routes)

        async def app(scope: Scope, receive: Receive, send: Send) -> None:
            """Admit to a run's files by a key of their own: their scripts can read the address."""
            parts = str(scope.get("path", "")).split("/", 4)
            is_file = len(parts) > 3 and parts[2] == "run"
            rule = self._access.narrowed(parts[3]) if is_file else self._access
            await rule.guard(inner)(scope, receive, send)

        return app

    def _list(self, _request: Request) -> Response:
        return self._page(
            "list.html.jinja",
            base="",
            runs=self._runs(),
            root=self._root,
            key=lambda name: self._access.narrowed(name).token,
        )

    def _compare(self, request: Request) -> Response:
        runs = {run.name: run for run in self._runs() if not run.fault}
        asked = [runs.get(request.query_params.get(each, "")) for each in ("a", "b")]
        one, other = chosen = _two(asked, list(runs.values()))
        rows: list[Row] = []
        differ: list[tuple[str, str, str]] = []
        judged = None
        if one is not None and other is not None and one is not other:
            rows, differ = compare(one, other), differing(one, other)
            judged = judged_by(*sorted((one, other), key=lambda run: run.created))
        return self._page(
            "compare.html.jinja",
            base="",
            runs=list(runs.values()),
            chosen=chosen,
            rows=rows,
            differ=differ,
            judged=judged,
        )

    def _trend(self, request: Request) -> Response:
        runs = self._runs()
        like = self._named(runs, request)
        if like is None:
            return PlainTextResponse("there is no such run\n", 404)
        first, judged = trend(runs, like)
        return self._page(
            "trend.html.jinja", base="../", first=first, judged=judged, charts=charts_of(judged)
        )

    def _file(self, request: Request) -> Response:
        run, path = self._named(self._runs(), request), request.path_params["path"]
        found = None if run is None or run.fault else _inside(run.folder, path)
        if found is None:
            return PlainTextResponse("there is no such file of a report\n", 404)
        return FileResponse(found, media_type=MEDIA_TYPES[found.suffix], headers=headers_of_runs())

    def _runs(self) -> list[ListedRun]:
        return find_runs(self._root, only=self._only)

    @staticmethod
    def _named(runs: list[ListedRun], request: Request) -> ListedRun | None:
        name = request.path_params["name"]
        return next((run for run in runs if run.name == name), None)

    def _page(self, template: str, **facts: object) -> Response:
        return HTMLResponse(self._pages.get_template(template).render(**facts), headers=_OWN)


def _two(asked: Sequence[ListedRun | None], runs: Sequence[ListedRun]) -> list[ListedRun | None]:
    """Return the runs that were asked for; in place of None the newest other, one alike first."""
    one, other = asked
    if other is None:
        other = next((run for run in runs if run is not one), None)
    if one is None and other is not None:
        rest = [run for run in runs if run is not other]
        one = next((run for run in rest if run.alike == other.alike), rest[0] if rest else None)
    return [one, other]


def _inside(folder: Path, path: str) -> Path | None:
    """Return a file of a run's report; None for whatever lies elsewhere, links included."""
    if not path.startswith(OPENED) or "\0" in path:
        return None
    try:
        found = (folder / path).resolve(strict=True)
        inside = found.relative_to(folder.resolve()).as_posix().startswith(OPENED)
    except (OSError, ValueError, RuntimeError):
        return None
    is_served = inside and found.is_file() and found.suffix in MEDIA_TYPES
    return found if is_served and found.stat().st_size <= MAX_BYTES else None
