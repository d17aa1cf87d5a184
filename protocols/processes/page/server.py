"""The page's process: hears feeds and supervisor, serves the page, and can do nothing but stop."""

import asyncio
import contextlib
import json
import socket
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from functools import lru_cache
from importlib import resources

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route

from drivers.camera.frame_checks import jpeg_size
from protocols.processes.child_process import ignore_signals, run_child
from protocols.processes.ipc import AbortRequest, Channel, FeedReader, Job, Order, feed_readers
from protocols.processes.page.access_token import AccessRule
from protocols.processes.page.page_state import View
from tacauchy_rig.core.image_codec import decode_rgb, encode_jpeg, media_type
from tacauchy_rig.core.run import JournalEvent

WIDEST_PX = 1000


@lru_cache(maxsize=16)
def reduced(picture: bytes) -> bytes:
    """Return a JPEG wider than ``WIDEST_PX`` at a half, a quarter or an eighth of its size.

    Others are returned as they are, and so is what cannot be decoded.
    """
    size = jpeg_size(picture)
    if size is None or size[0] <= WIDEST_PX:
        return picture
    reduction = next((by for by in (2, 4) if size[0] <= by * WIDEST_PX), 8)
    colours = decode_rgb(picture, reduction=reduction)
    return picture if colours is None else encode_jpeg(colours)


PERIOD_S = 0.1
WATCHERS_MAX = 4
"""Event streams at once: a browser keeps six connections to an address, and a stop needs one."""
CONNECTIONS_MAX = 300
KEEP_ALIVE_S = 5
ALIVE_S = 0.5
LAST_WORDS_S = 0.4
LINGER_S, LINGER_POLL_S = 3600.0, 2.0
"""How long a page that somebody watches outlives the program, for its link to the report."""
REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
    "script-src 'unsafe-inline'"
)
"""A report may run its own script; it reads and sends nothing."""
SOURCES = ("control", "camera", "twin")
FILES = {"": ("page.html", "text/html"), "page.js": ("page.js", "text/javascript")}
FILES["page.css"] = ("page.css", "text/css")


class PageServer:
    """Shows a run to browsers until the supervisor ends it, and passes their stop on to it."""

    def __init__(self, job: Job, supervisor: Channel) -> None:
        self._view, self._supervisor = View(job), supervisor
        self._feeds = feed_readers(job.descriptors, SOURCES)
        self._listener = socket.socket(fileno=job.descriptors["listen"])
        self._watchers = 0
        self._ending = False
        self._ended = asyncio.Event()
        routes = [Route(f"/{name}", _file(*file)) for name, file in FILES.items()]
        routes += [
            Route("/events", self._events),
            Route("/picture/{stream}", self._picture),
            Route("/report", self._report),
            Route("/stop", self._ask_to_stop, methods=["POST"]),
        ]
        access = AccessRule(job.options["token"], port=self._listener.getsockname()[1])
        config = uvicorn.Config(
            access.guard(Starlette(routes=routes)),
            loop="asyncio",
            http="h11",
            ws="none",
            lifespan="off",
            log_level="warning",
            access_log=False,
            server_header=False,
            timeout_keep_alive=KEEP_ALIVE_S,
            timeout_graceful_shutdown=1,
        )
        self._server = _Server(config)

    async def run(self) -> None:
        """Serve until the supervisor says stop or is gone, or the server ends."""
        loop = asyncio.get_running_loop()
        for feed in self._feeds:
            loop.add_reader(feed.fileno(), self._read_feed, feed)
        loop.add_reader(self._supervisor.fileno(), self._take_orders)
        thinning = asyncio.create_task(self._thin_out())
        serving = asyncio.create_task(self._server.serve(sockets=[self._listener]))
        ending = asyncio.create_task(self._ended.wait())
        while not ending.done() and not serving.done():
            self._supervisor.send(Order.ALIVE)
            self._view.check_disk()
            both = {ending, serving}
            await asyncio.wait(both, timeout=ALIVE_S, return_when=asyncio.FIRST_COMPLETED)
        ending.cancel()
        await asyncio.sleep(LAST_WORDS_S)  # for the last event to reach the browsers
        linger_until_s = loop.time() + LINGER_S
        while self._view.is_reported and self._watchers and loop.time() < linger_until_s:
            await asyncio.sleep(LINGER_POLL_S)
        self._ending = self._server.should_exit = True
        await serving
        thinning.cancel()

    def _read_feed(self, feed: FeedReader) -> None:
        for shown in feed.receive():
            self._view.take(shown)
        self._view.dropped_count = sum(each.lost_count for each in self._feeds)

    def _take_orders(self) -> None:
        for message in self._supervisor.receive():
            if isinstance(message, JournalEvent):
                self._view.note(message)
            elif message is Order.STOP:
                self._ended.set()
        if self._supervisor.closed:
            asyncio.get_running_loop().remove_reader(self._supervisor.fileno())
            self._ended.set()

    async def _thin_out(self) -> None:
        """Close connections that ask for nothing when there are too many: a stop needs room."""
        while True:
            await asyncio.sleep(KEEP_ALIVE_S / 10)
            connections = list(self._server.server_state.connections)
            for connection in connections[: max(0, len(connections) - CONNECTIONS_MAX)]:
                if getattr(connection, "cycle", None) is None:
                    connection.transport.abort()

    async def _events(self, _request: Request) -> Response:
        if self._watchers >= WATCHERS_MAX:
            return PlainTextResponse(f"{WATCHERS_MAX} pages watch already\n", 503)
        return StreamingResponse(self._tell(), media_type="text/event-stream")

    async def _tell(self) -> AsyncIterator[str]:
        """Yield what is new ten times a second; a slow browser gets less, never late."""
        self._watchers += 1
        try:
            yield _event("setup", self._view.setup())
            seen, drawn = -1, 0
            while not self._ending:
                if seen != self._view.version:
                    seen = self._view.version
                    yield _event("run", self._view.run())
                live, drawn = self._view.live(drawn)
                yield _event("live", live)
                await asyncio.sleep(PERIOD_S)
        finally:
            self._watchers -= 1

    async def _picture(self, request: Request) -> Response:
        # One of an earlier session is read from its recording.
        picture = await asyncio.to_thread(self._view.picture, request.path_params["stream"])
        if picture is None:
            return PlainTextResponse("no such picture yet\n", 404)
        data = await asyncio.to_thread(reduced, picture)
        return Response(data, media_type=media_type(data))

    async def _report(self, _request: Request) -> Response:
        report = await asyncio.to_thread(self._view.report)
        if report is None:
            return PlainTextResponse("no report yet\n", 404)
        return Response(
            report,
            media_type="text/html; charset=utf-8",
            headers={"content-security-policy": REPORT_POLICY},
        )

    async def _ask_to_stop(self, _request: Request) -> Response:
        heard = self._supervisor.send(AbortRequest(reason="stop was pressed on the page"))
        return JSONResponse({"asked": heard}, 200 if heard else 503)


class _Server(uvicorn.Server):
    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals alone: they are the supervisor's."""
        yield


def _file(name: str, kind: str) -> Callable[[Request], Response]:
    content = resources.files("protocols.processes.page").joinpath(name).read_bytes()

    def respond(_request: Request) -> Response:
        return Response(content, media_type=f"{kind}; charset=utf-8")

    return respond


def _event(name: str, content: object) -> str:
    return f"event: {name}\ndata: {json.dumps(content, allow_nan=False)}\n\n"


def serve(job: Job, supervisor: Channel) -> None:
    """Do the page's job."""
    ignore_signals()
    asyncio.run(PageServer(job, supervisor).run())


if __name__ == "__main__":
    sys.exit(run_child("page", serve))
