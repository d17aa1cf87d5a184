"""Everything that the supervisor keeps for those who watch a run."""

from __future__ import annotations

import logging
import secrets
import socket
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from protocols.processes.child import Launched
from protocols.processes.feed import FeedLines
from protocols.processes.messages import Channel, Job, Order, PageOptions, ViewerOptions
from tacauchy_rig.core.errors import ConfigError, RigError
from tacauchy_rig.core.run import JournalEvent

logger = logging.getLogger(__name__)

LOOPBACK = "127.0.0.1"
BACKLOG = 256
TOKEN_BYTES = 24
PAGE = "page"
CONTROL_ENDED = "control-ended"
"""Name of the event that says that the arm rests, and that nothing new will be measured."""
AFTERWARDS = "afterwards"
"""Name of events that tell what is done with a recorded run: ``state``, ``text``, ``passed``."""
_MODULE = "protocols.processes.page.server"
PRODUCERS = ("control", "camera")
SILENT_S = 5.0
START_S = 30.0
STARTS_MAX = 6
END_S = 2.0


class Viewing:
    """The viewers of a session, their feeds, and the page's address, which a restart keeps.

    Args:
        page: The operator's page; None for none.
        job: Of the run; each viewer gets it with its own descriptors.
        others: Further viewers; the page shows what they show.

    Attributes:
        feeds: Lead from the producers to the viewers.
        address: Of the page, with its token; empty without one.

    Raises:
        ConfigError: The page's port is taken.
    """

    def __init__(
        self, page: PageOptions | None, job: Job, others: Sequence[ViewerOptions] = ()
    ) -> None:
        self._page, self._job = page, job
        self._viewers: dict[str, Viewer] = {}
        self._listener: socket.socket | None = None
        self._options = list(others)
        self.address = ""
        if page is not None:
            token = secrets.token_urlsafe(TOKEN_BYTES)
            self._listener = listen(page.port)
            self.address = f"http://{LOOPBACK}:{self._listener.getsockname()[1]}/{token}/"
            shown = tuple(other.name for other in others)
            self._options.append(
                ViewerOptions(name=PAGE, module=_MODULE, options={"token": token}, sources=shown)
            )
        names = [each.name for each in self._options]
        pairs = [(producer, name) for name in names for producer in PRODUCERS]
        pairs += [
            (source, each.name)
            for each in self._options
            for source in each.sources
            if source in names
        ]
        self.feeds = FeedLines(pairs)

    def start(self) -> None:
        """Start every viewer."""
        for each in self._options:
            job = replace(
                self._job, descriptors=self.feeds.descriptors(each.name), options=each.options
            )
            if each.name == PAGE and self._listener is not None:
                job.descriptors["listen"] = self._listener.fileno()
                job = replace(job, page=self._page)
            self._viewers[each.name] = Viewer(each.name, job, module=each.module)

    def running(self) -> Iterator[Viewer]:
        """Yield the viewers that run."""
        return (viewer for viewer in self._viewers.values() if viewer.runs)

    def send(self, event: JournalEvent) -> None:
        """Tell each viewer of an event; one that is too slow misses it."""
        for viewer in self.running():
            viewer.channel.send(event)

    def restart_ended(self) -> Iterator[tuple[str, str]]:
        """Start again what is gone; yield its name and what happened."""
        for name, viewer in self._viewers.items():
            if happened := viewer.restart_if_ended():
                yield name, happened

    def end(self, *, keep_page: bool = False) -> None:
        """Let every viewer finish, or all but the page."""
        for name, viewer in self._viewers.items():
            if name != PAGE or not keep_page:
                viewer.end()

    def tell_page(self, state: str, text: str, *, passed: bool | None = None) -> None:
        """Tell a page that was kept what is done with the recorded run."""
        detail = {"state": state, "text": text, "passed": passed}
        event = JournalEvent(stamp_ns=time.monotonic_ns(), name=AFTERWARDS, detail=detail)
        for viewer in self.running():
            viewer.receive()  # it says that it lives
            viewer.channel.send(event)

    def release(self) -> None:
        """Leave a page that was kept to those who watch it, and let go of all sockets."""
        for viewer in self._viewers.values():
            viewer.release()
        self.close()

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
        ConfigError: The port is not available; ``option`` is what asked for it.
    """
    listener = socket.socket()
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((LOOPBACK, port))
    except OSError as error:
        listener.close()
        raise ConfigError(
            f"{option} {port}: {LOOPBACK}:{port} is not available: {error.strerror}",
            remedy="give another port, or leave it out for a free one",
        ) from error
    listener.listen(BACKLOG)
    return listener


_NO_MORE = "not started again"


class Viewer:
    """Started again when it dies or hangs, on the sockets that it had; given up after some times.

    Args:
        name: For messages and its log.
        job: What it is to do; its descriptors stay open in this process.
        module: What its process runs.
    """

    def __init__(self, name: str, job: Job, *, module: str) -> None:
        self.name = name
        self._module = module
        self._job = job
        self._starts, self._started_s = 0, 0.0
        self._given_up = ""
        self._child: Launched | None = None
        self._start()

    @property
    def channel(self) -> Channel:
        """Where it speaks.

        Raises:
            ValueError: It does not run.
        """
        if self._child is None:
            raise ValueError(f"{self.name} does not run")
        return self._child.channel

    @property
    def runs(self) -> bool:
        """Whether it can be spoken to."""
        return self._child is not None and not self._child.channel.closed

    @property
    def pid(self) -> int:
        """Its process; 0 where it does not run."""
        return 0 if self._child is None else self._child.process.pid

    def receive(self) -> list[Any]:
        """Return what it said."""
        return [] if self._child is None else self._child.receive()

    def restart_if_ended(self) -> str:
        """Start it again if it is gone or silent; return what happened, or an empty text."""
        child = self._child
        if child is None:
            return ""
        if not child.has_ended and time.monotonic() - child.last_message_s > SILENT_S:
            child.kill()
        if not child.has_ended:
            return ""
        end, refused = child.describe_end(), self._refused(child)
        child.close()
        self._child = None
        if refused:
            self._given_up = _NO_MORE
        else:
            self._start()
        return f"{end}; {self._given_up or 'started again'}; the run goes on"

    def _refused(self, child: Launched) -> bool:
        """Return whether it said at its start that it cannot be: it would say so again."""
        at_start = time.monotonic() - self._started_s < START_S
        return at_start and not child.killed and child.process.poll() == RigError.exit_code

    def end(self) -> None:
        """Let it finish, and end it if it does not."""
        if self._child is None:
            return
        self._child.channel.send(Order.STOP)
        deadline = time.monotonic() + END_S
        while not self._child.has_ended and time.monotonic() < deadline:
            time.sleep(0.01)
        self.close()

    def release(self) -> None:
        """Let it end by itself."""
        if self._child is not None:
            self._child.release()
            self._child = None

    def close(self) -> None:
        """End it at once, if it runs."""
        if self._child is not None:
            self._child.close()
            self._child = None

    def _start(self) -> None:
        self._starts += 1
        self._started_s = time.monotonic()
        if self._starts > STARTS_MAX:
            self._given_up = _NO_MORE
            return
        try:
            job = replace(self._job, again=self._starts > 1)
            self._child = Launched(self.name, job, module=self._module)
        except OSError as error:
            self._given_up = f"it cannot be started ({error})"
            logger.error("%s: %s", self.name, self._given_up)
            return
        self._child.last_message_s += START_S - SILENT_S
