"""The server of results: pages made from what lies there, and the files of reports."""

import asyncio
from base64 import b64encode
from collections.abc import Callable, Sequence
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
from reports.page.report_html import report_script
from tacauchy_rig.app.results.run_list_comparison_trend import (
    Health,
    ListedRun,
    Row,
    charts_of,
    compare,
    differing,
    find_runs,
    in_words,
)
from tacauchy_rig.app.twin.run_follower import watch_script
from tacauchy_rig.core.markdown_page import environment_of
from tacauchy_rig.core.store.run_files import MAX_BYTES

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

    def __init__(
        self, root: Path, access: AccessRule, *, only: str = "", health: Health | None = None
    ):
        self._root, self._only, self._access = root, only, access
        self._health = health or Health()
        self._pages = environment_of("tacauchy_rig.app.results")
        self._pages.filters["in_words"] = in_words
        style = resources.files("tacauchy_rig.app.results").joinpath("templates", "results.css")
        self._style = Response(style.read_bytes(), media_type="text/css; charset=utf-8")

    @property
    def app(self) -> ASGIApp:
        """The application, behind its access rule."""
        routes = [
            Route("/", self._answer(self._list)),
            Route("/compare", self._answer(self._compare)),
            Route("/health/{name}", self._answer(self._trend)),
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

    def _answer(self, page: Callable[[Request], Response]) -> Callable[[Request], Any]:
        """Return a page's answer, made in a thread: recordings take a second to read."""

        async def answer(request: Request) -> Response:
            return await asyncio.to_thread(page, request)

        return answer

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
            judged = self._health.of(*sorted((one, other), key=lambda run: run.created))
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
        first, judged = self._health.trend(runs, like)
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
