"""Child processes: what each does first and last, how the supervisor starts and sees it.

Those of viewers are everything that the supervisor keeps for those who watch a run.
"""

import errno
import faulthandler
import logging
import os
import secrets
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import protocols
from protocols.guard.abort import SIGNALS
from protocols.processes.ipc import Channel, FeedLines, Job, Order, PageOptions, ViewerOptions
from tacauchy_rig.core.errors import ConfigError, DeviceError, RigError
from tacauchy_rig.core.run import JournalEvent

logger = logging.getLogger(__name__)

JOB_TIMEOUT_S = 10.0


def run_child(name: str, work: Callable[[Job, Channel], None]) -> int:
    """Take the job from the supervisor and do it; return the exit status.

    Errors go to the supervisor as plain words, and with their traceback to the log (stderr).
    """
    faulthandler.enable()
    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s"
    )
    supervisor = Channel.inherited(int(sys.argv[1]))
    try:
        work(_receive_job(name, supervisor), supervisor)
    except RigError as error:
        logger.error("%s", error)
        supervisor.send(error)
        return error.exit_code
    except Exception as error:
        supervisor.send(_unforeseen(name, error))  # first: without memory the log may fail
        logger.critical("unforeseen", exc_info=error)
        return 2
    return 0


def _unforeseen(name: str, error: Exception) -> RigError:
    # Where a program cannot get the memory of its arguments, the kernel says E2BIG.
    refused = isinstance(error, OSError) and error.errno in (errno.ENOMEM, errno.E2BIG)
    if refused or isinstance(error, MemoryError):
        return RigError(
            f"{name}: out of memory",
            remedy="check where the arm is; end other programs or lift `ulimit -v`, then "
            "`tacauchy-rig resume` continues",
        )
    return RigError(
        f"{name}: unforeseen {type(error).__name__}: {error}",
        remedy=f"read logs/{name}.log in the run folder",
    )


def ask_for_priority(niceness: int) -> None:
    """Ask the kernel to prefer this process; without the right to it, say so and go on.

    Not a real-time class: ur_rtde polls in a loop, and a real-time thread that polls can starve
    whatever it waits for on the same core (seen as commands without an answer for a second).
    """
    try:
        os.nice(niceness)
    except PermissionError:
        logger.info("no right to a higher priority; `ulimit -e 40` would give it")


def ignore_signals() -> None:
    """Leave signals meant for the run to the processes that can act on them."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def _receive_job(name: str, supervisor: Channel) -> Job:
    deadline = time.monotonic() + JOB_TIMEOUT_S
    while time.monotonic() < deadline and not supervisor.closed:
        supervisor.wait(0.1)
        # One at a time: an order that follows the job is for whoever does the job.
        for message in supervisor.receive(limit=1):
            if isinstance(message, Job):
                return message
    raise DeviceError(f"{name}: no job from the supervisor within {JOB_TIMEOUT_S:g} s")


LOG_FOLDER = "logs"


class Launched:
    """A child that runs ``protocols.processes.NAME``, or a module that is given.

    Its descriptors are closed here once it has them, so that its end shows as an end of file.
    """

    def __init__(self, name: str, job: Job, *, module: str = "") -> None:
        self.name = name
        self.killed = False  # by this supervisor
        self.started_s = self.last_message_s = time.monotonic()
        self.log = job.root / LOG_FOLDER / f"{name}.log"
        self.log.parent.mkdir(exist_ok=True)
        self.channel, theirs = Channel.pair()
        with self.log.open("ab") as log:
            what = module or f"protocols.processes.{name}_process"
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-m", what, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                pass_fds=(theirs.fileno(), *job.descriptors.values()),
                env=_environment(),
                # A session of its own: Linux shares the processor between sessions first, so
                # whatever else runs in the operator's terminal cannot starve a child.
                start_new_session=True,
            )
        theirs.close()
        self.channel.send(job)

    def receive(self) -> list[Any]:
        """Return what it said, and note that it said something."""
        messages = self.channel.receive()
        if messages:
            self.last_message_s = time.monotonic()
        return messages

    @property
    def has_ended(self) -> bool:
        """Whether the process is gone."""
        return self.process.poll() is not None

    def kill(self) -> None:
        """End it at once, if it runs. An arm in motion is then stopped by its own watchdog."""
        if not self.has_ended:
            self.killed = True
            self.process.kill()
            self.process.wait()

    def close(self) -> None:
        """End it if it still runs, and let go of its channel."""
        self.kill()
        self.channel.close()

    def release(self) -> None:
        """Let go of its channel, and let it end by itself."""
        self.channel.close()
        self.process.returncode = 0  # nobody waits for it any more

    def describe_end(self) -> str:
        """Return how it ended, in words, with the last line of its log."""
        code = self.process.poll()
        if code is None:
            return f"the {self.name} process still runs"
        how = f"exit status {code}" if code >= 0 else f"killed by {signal.Signals(-code).name}"
        how = "it had stopped answering and was ended" if self.killed else how
        lines = self.log.read_text(errors="replace").strip().splitlines()
        last_words = f": {lines[-1]}" if lines else ""
        return f"the {self.name} process died ({how}){last_words}"


def _environment() -> dict[str, str]:
    """Return our environment; the child finds the same packages, and computes with one thread."""
    root = str(Path(protocols.__file__).parents[1])
    known = os.environ.get("PYTHONPATH", "")
    one_thread = {"OPENBLAS_NUM_THREADS": os.environ.get("OMP_NUM_THREADS", "1")}
    return {**one_thread, **os.environ, "PYTHONPATH": os.pathsep.join(filter(None, (root, known)))}


def launch_children(job: Job, feeds: FeedLines) -> dict[str, Launched]:
    """Start recorder, camera and control with ``job``; return them by name.

    Every end is closed here once its owner has it, so that the death of a process shows to its
    partners as an end of file. Those of ``feeds`` stay open: no viewer's death is to show.
    """
    ends: dict[str, dict[str, socket.socket | Channel]]
    ends = {"recorder": {}, "camera": {}, "control": {}}
    for producer in ("camera", "control"):
        for what, make_pair in (("data", socket.socketpair), ("acks", Channel.pair)):
            ends[producer][f"recorder-{what}"], ends["recorder"][f"{producer}-{what}"] = make_pair()
    ends["camera"]["control-status"], ends["control"]["camera-status"] = Channel.pair()
    children: dict[str, Launched] = {}
    with ExitStack() as opened:
        for sockets in ends.values():
            for end in sockets.values():
                opened.callback(end.close)
        for name, sockets in ends.items():
            theirs = {what: end.fileno() for what, end in sockets.items()}
            descriptors = {**theirs, **feeds.descriptors(name)}
            children[name] = Launched(name, replace(job, descriptors=descriptors))
    return children


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

    A viewer is started again when it dies or hangs, on the sockets that it had, and given up after
    some times. The page shows what the ``others`` show; ``address`` holds its token and is empty
    without one.
    """

    def __init__(
        self, page: PageOptions | None, job: Job, others: Sequence[ViewerOptions] = ()
    ) -> None:
        self._job = job
        self._children: dict[str, Launched] = {}  # the viewers that run, by name
        self._starts: Counter[str] = Counter()
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
            self._start(each)

    def _start(self, viewer: ViewerOptions) -> str:
        """Start a viewer, and return what became of that."""
        name = viewer.name
        self._starts[name] += 1
        if self._starts[name] > STARTS_MAX:
            return "not started again"
        ends = self.feeds.descriptors(name)
        if name == PAGE and self._listener is not None:
            ends["listen"] = self._listener.fileno()
        again = self._starts[name] > 1
        job = replace(self._job, descriptors=ends, options=viewer.options, again=again)
        try:
            child = self._children[name] = Launched(name, job, module=viewer.module)
        except OSError as error:
            logger.error("%s: it cannot be started (%s)", name, error)
            return f"it cannot be started ({error})"
        child.last_message_s += START_S - SILENT_S
        return "started again"

    def running(self) -> list[Launched]:
        """Return the viewers that can be spoken to."""
        return [child for child in self._children.values() if not child.channel.closed]

    def send(self, event: JournalEvent) -> None:
        """Tell each viewer of an event; one that is too slow misses it."""
        for viewer in self.running():
            viewer.channel.send(event)

    def restart_ended(self) -> Iterator[tuple[str, str]]:
        """Start again what is gone or silent; yield its name and what happened."""
        for viewer in self._options:
            child = self._children.get(viewer.name)
            if child is None:
                continue
            if not child.has_ended and time.monotonic() - child.last_message_s > SILENT_S:
                child.kill()
            if not child.has_ended:
                continue
            end = child.describe_end()
            self._children.pop(viewer.name).close()
            # What it said at its start, that it cannot be, it would say again.
            at_start = time.monotonic() - child.started_s < START_S
            refused = at_start and not child.killed and child.process.poll() == RigError.exit_code
            then = "not started again" if refused else self._start(viewer)
            yield viewer.name, f"{end}; {then}; the run goes on"

    def end(self, *, keep_page: bool = False) -> None:
        """Let every viewer finish, or all but the page, and end one that does not."""
        for name in [each for each in self._children if each != PAGE or not keep_page]:
            child = self._children.pop(name)
            child.channel.send(Order.STOP)
            deadline = time.monotonic() + END_S
            while not child.has_ended and time.monotonic() < deadline:
                time.sleep(0.01)
            child.close()

    def tell_page(self, state: str, text: str, *, passed: bool | None = None) -> None:
        """Tell a page that was kept what is done with the recorded run."""
        event = JournalEvent.now(AFTERWARDS, state=state, text=text, passed=passed)
        for viewer in self.running():
            viewer.receive()  # it says that it lives
            viewer.channel.send(event)

    def release(self) -> None:
        """Leave a page that was kept to those who watch it, and let go of all sockets."""
        while self._children:
            self._children.popitem()[1].release()
        self.close()

    def close(self) -> None:
        """End every viewer and let go of all sockets."""
        while self._children:
            self._children.popitem()[1].close()
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
