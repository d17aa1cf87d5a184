"""The page's server: one page, its events, pictures, and the stop."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
from collections.abc import AsyncIterator, Callable, Iterator
from importlib import resources

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route

from protocols.processes.page.door import Door
from protocols.processes.page.picture import media_type, reduced
from protocols.processes.page.view import View

PERIOD_S = 0.1
WATCHERS_MAX = 4
"""Event streams at once: a browser keeps six connections to an address, and a stop needs one."""
CONNECTIONS_MAX = 300
KEEP_ALIVE_S = 5
FILES = {"": ("page.html", "text/html"), "page.js": ("page.js", "text/javascript")}
FILES["page.css"] = ("page.css", "text/css")


class PageServer:
    """Serves a view to browsers.

    Args:
        view: What is shown.
        door: Who may come in.
        stop: Asks the supervisor to stop the arm; False where it does not hear.
    """

    def __init__(self, view: View, door: Door, *, stop: Callable[[], bool]) -> None:
        self._view = view
        self._stop = stop
        self._watchers = 0
        self._ending = False
        routes = [Route(f"/{name}", _file(*file)) for name, file in FILES.items()]
        routes += [
            Route("/events", self._events),
            Route("/picture/{stream}", self._picture),
            Route("/stop", self._ask_to_stop, methods=["POST"]),
        ]
        config = uvicorn.Config(
            door.before(Starlette(routes=routes)),
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

    async def serve(self, listener: socket.socket) -> None:
        """Serve until ``end`` is called."""
        thinning = asyncio.create_task(self._thin_out())
        try:
            await self._server.serve(sockets=[listener])
        finally:
            thinning.cancel()

    def end(self) -> None:
        """End the streams, then the server."""
        self._ending = True
        self._server.should_exit = True

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
                yield _event("live", {**live, "watchers": self._watchers})
                await asyncio.sleep(PERIOD_S)
        finally:
            self._watchers -= 1

    async def _picture(self, request: Request) -> Response:
        picture = self._view.picture(request.path_params["stream"])
        if picture is None:
            return PlainTextResponse("no such picture yet\n", 404)
        data = await asyncio.to_thread(reduced, picture)
        return Response(data, media_type=media_type(data))

    async def _ask_to_stop(self, _request: Request) -> Response:
        heard = self._stop()
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
