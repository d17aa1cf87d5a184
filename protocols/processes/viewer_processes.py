"""Everything that the supervisor keeps for those who watch a run."""

import logging
import secrets
import socket
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

from protocols.processes.child_process import Launched
from protocols.processes.ipc import FeedLines, Job, Order, PageOptions, ViewerOptions
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

    The page shows what the ``others`` show; ``address`` holds its token and is empty without one.
    """

    def __init__(
        self, page: PageOptions | None, job: Job, others: Sequence[ViewerOptions] = ()
    ) -> None:
        self._job = job
        self._viewers: dict[str, Viewer] = {}
        self._listener: socket.socket | None = None
        self._options = list(others)
        self.address = ""
        if page is not None:
            token = secrets.token_urlsafe(TOKEN_BYTES)
            self._listener = listen(page.port)
            self.address = f"http://{LOOPBACK}:{self._listener.getsockname()[1]}/{token}/"
            shown = tuple(other.name for other in others)
            options = {"token": token, "outline": page.outline}
            self._options.append(
                ViewerOptions(name=PAGE, module=_MODULE, options=options, sources=shown)
            )
        known = {*PRODUCERS, *(each.name for each in self._options)}
        self.feeds = FeedLines(
            (source, each.name)
            for each in self._options
            for source in (*PRODUCERS, *each.sources)
            if source in known
        )

    def start(self) -> None:
        """Start every viewer."""
        for each in self._options:
            ends = self.feeds.descriptors(each.name)
            if each.name == PAGE and self._listener is not None:
                ends["listen"] = self._listener.fileno()
            job = replace(self._job, descriptors=ends, options=each.options)
            self._viewers[each.name] = Viewer(each.name, job, module=each.module)

    def running(self) -> list[Launched]:
        """Return the viewers that can be spoken to."""
        children = (viewer.child for viewer in self._viewers.values())
        return [child for child in children if child is not None and not child.channel.closed]

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
        event = JournalEvent.now(AFTERWARDS, state=state, text=text, passed=passed)
        for viewer in self.running():
            viewer.receive()  # it says that it lives
            viewer.channel.send(event)

    def release(self) -> None:
        """Leave a page that was kept to those who watch it, and let go of all sockets."""
        for viewer in self._viewers.values():
            if viewer.child is not None:
                viewer.child.release()
                viewer.child = None
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


class Viewer:
    """Started again when it dies or hangs, on the sockets that it had; given up after some times.

    The descriptors of ``job`` stay open in this process; ``child`` is None where it does not run.
    """

    def __init__(self, name: str, job: Job, *, module: str) -> None:
        self.child: Launched | None = None
        self._name, self._job, self._module = name, job, module
        self._starts, self._started_s = 0, 0.0
        self._start()

    def restart_if_ended(self) -> str:
        """Start it again if it is gone or silent; return what happened, or an empty text."""
        child = self.child
        if child is None:
            return ""
        if not child.has_ended and time.monotonic() - child.last_message_s > SILENT_S:
            child.kill()
        if not child.has_ended:
            return ""
        end = child.describe_end()
        self.close()
        # What it said at its start, that it cannot be, it would say again.
        at_start = time.monotonic() - self._started_s < START_S
        refused = at_start and not child.killed and child.process.poll() == RigError.exit_code
        then = "not started again" if refused else self._start()
        return f"{end}; {then}; the run goes on"

    def end(self) -> None:
        """Let it finish, and end it if it does not."""
        if self.child is None:
            return
        self.child.channel.send(Order.STOP)
        deadline = time.monotonic() + END_S
        while not self.child.has_ended and time.monotonic() < deadline:
            time.sleep(0.01)
        self.close()

    def close(self) -> None:
        """End it at once, if it runs."""
        if self.child is not None:
            self.child.close()
            self.child = None

    def _start(self) -> str:
        """Start it, and return what became of that."""
        self._starts += 1
        self._started_s = time.monotonic()
        if self._starts > STARTS_MAX:
            return "not started again"
        try:
            job = replace(self._job, again=self._starts > 1)
            self.child = Launched(self._name, job, module=self._module)
        except OSError as error:
            logger.error("%s: it cannot be started (%s)", self._name, error)
            return f"it cannot be started ({error})"
        self.child.last_message_s += START_S - SILENT_S
        return "started again"
