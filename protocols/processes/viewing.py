"""Everything that the supervisor keeps for those who watch a run."""

from __future__ import annotations

import secrets
import socket
from collections.abc import Iterator, Sequence
from dataclasses import replace

from protocols.processes.feed import FeedLines
from protocols.processes.messages import Job, PageJob, PageWish, ViewerWish
from protocols.processes.viewer import Viewer
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.run import JournalEvent

LOOPBACK = "127.0.0.1"
BACKLOG = 256
TOKEN_BYTES = 24
PAGE = "page"
PRODUCERS = ("control", "camera")


class Viewing:
    """The viewers of a session, their feeds, and the page's address, which a restart keeps.

    Args:
        wish: The operator's page; None for none.
        job: Of the run; each viewer gets it with its own descriptors.
        others: Further viewers; the page is shown what they show.

    Attributes:
        feeds: Lead from the producers to the viewers.
        address: Of the page, with its token; empty without one.

    Raises:
        ConfigError: The page's port is taken.
    """

    def __init__(self, wish: PageWish | None, job: Job, others: Sequence[ViewerWish] = ()) -> None:
        self._wish, self._job, self._others = wish, job, others
        self._viewers: dict[str, Viewer] = {}
        self._listener: socket.socket | None = None
        self.address = ""
        if wish is not None:
            self._token = secrets.token_urlsafe(TOKEN_BYTES)
            self._listener = listen(wish.port)
            self.address = f"http://{LOOPBACK}:{self._listener.getsockname()[1]}/{self._token}/"
        names = [other.name for other in others]
        viewers = [*names, *([] if wish is None else [PAGE])]
        pairs = [(producer, viewer) for viewer in viewers for producer in PRODUCERS]
        pairs += [] if wish is None else [(name, PAGE) for name in names]
        pairs += [(each, other.name) for other in others for each in other.sources if each in names]
        self.feeds = FeedLines(pairs)

    def start(self) -> None:
        """Start every viewer."""
        for other in self._others:
            job = replace(
                self._job, descriptors=self.feeds.descriptors(other.name), options=other.options
            )
            self._viewers[other.name] = Viewer(other.name, job, module=other.module)
        if self._wish is None or self._listener is None:
            return
        descriptors = {"listen": self._listener.fileno(), **self.feeds.descriptors(PAGE)}
        page = PageJob(token=self._token, outline=self._wish.outline)
        self._viewers[PAGE] = Viewer(PAGE, replace(self._job, descriptors=descriptors, page=page))

    def running(self) -> Iterator[Viewer]:
        """Yield the viewers that run."""
        return (viewer for viewer in self._viewers.values() if viewer.runs)

    def tell(self, event: JournalEvent) -> None:
        """Tell each viewer of an event; one that is too slow misses it."""
        for viewer in self.running():
            viewer.channel.send(event)

    def look(self) -> Iterator[tuple[str, str]]:
        """Start again what is gone; yield its name and what happened."""
        for name, viewer in self._viewers.items():
            if happened := viewer.look():
                yield name, happened

    def end(self) -> None:
        """Let every viewer finish."""
        for viewer in self._viewers.values():
            viewer.end()

    def close(self) -> None:
        """End every viewer and let go of all sockets."""
        for viewer in self._viewers.values():
            viewer.close()
        if self._listener is not None:
            self._listener.close()
        self.feeds.close()


def listen(port: int, *, option: str = "--page") -> socket.socket:
    """Return a socket that listens on the loopback address; port 0 takes a free one.

    Raises:
        ConfigError: The port cannot be had; ``option`` is what asked for it.
    """
    listener = socket.socket()
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((LOOPBACK, port))
    except OSError as error:
        listener.close()
        raise ConfigError(
            f"{option} {port}: {LOOPBACK}:{port} cannot be had: {error.strerror}",
            remedy="give another port, or leave it out for a free one",
        ) from error
    listener.listen(BACKLOG)
    return listener
