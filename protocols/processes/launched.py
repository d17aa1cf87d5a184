"""The child processes as the supervisor sees them, and the sockets between them."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import protocols
from protocols.processes.channel import Channel
from protocols.processes.feed import FeedLines
from protocols.processes.messages import Job
from protocols.trials.trial import PlannedTrial
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.expected_press import ExpectedPress

LOG_FOLDER = "logs"


class Launched:
    """A child that runs ``protocols.processes.NAME``, or a module that is given.

    Its descriptors are closed here once it has them, so that its end shows as an end of file.

    Attributes:
        heard_s: When it said something last, by ``time.monotonic``.
        killed: Whether this supervisor had to kill it.
    """

    def __init__(self, name: str, job: Job, *, module: str = "") -> None:
        self.name = name
        self.killed = False
        self.heard_s = time.monotonic()
        self.log = job.root / LOG_FOLDER / f"{name}.log"
        self.log.parent.mkdir(exist_ok=True)
        self.channel, theirs = Channel.pair()
        handed = (theirs.fileno(), *job.descriptors.values())
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                [
                    *(sys.executable, "-P", "-m", module or f"protocols.processes.{name}"),
                    str(theirs.fileno()),
                ],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                pass_fds=handed,
                env=_environment(),
                # A session of its own: Linux shares the processor between sessions first, so
                # whatever else runs in the operator's terminal cannot starve a child.
                start_new_session=True,
            )
        theirs.close()
        self.channel.send(job)

    def hear(self) -> list[Any]:
        """Return what it said, and note that it said something."""
        messages = self.channel.receive()
        if messages:
            self.heard_s = time.monotonic()
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

    def describe_end(self) -> str:
        """Return how it ended, in words, with the last line of its log."""
        code = self.process.poll()
        if code is None:
            return f"the {self.name} process still runs"
        how = f"exit status {code}"
        if code < 0:
            how = f"killed by {signal.Signals(-code).name}"
        if self.killed:
            how = "it had stopped answering and was ended"
        return f"the {self.name} process died ({how}){self._last_words()}"

    def _last_words(self) -> str:
        lines = self.log.read_text(errors="replace").strip().splitlines()
        return f": {lines[-1]}" if lines else ""


def _environment() -> dict[str, str]:
    """Return our environment; the child finds the same packages, and computes with one thread."""
    root = str(Path(protocols.__file__).parents[1])
    known = os.environ.get("PYTHONPATH", "")
    one_thread = {"OPENBLAS_NUM_THREADS": os.environ.get("OMP_NUM_THREADS", "1")}
    return {**one_thread, **os.environ, "PYTHONPATH": os.pathsep.join(filter(None, (root, known)))}


Ends = dict[str, dict[str, socket.socket | Channel]]


def launch_children(
    root: Path,
    config: RigConfig,
    plan: tuple[PlannedTrial, ...],
    expected: ExpectedPress | None,
    feeds: FeedLines,
) -> dict[str, Launched]:
    """Start recorder, camera and control; return them by name.

    Every end is closed here once its owner has it, so that the death of a process shows to its
    partners as an end of file. Those of ``feeds`` stay open: no viewer's death is to show.
    """
    children: dict[str, Launched] = {}
    ends = _connect_all()
    try:
        for name, sockets in ends.items():
            job = Job(
                root=root,
                config=config,
                plan=plan,
                expected=expected,
                descriptors={
                    **{what: end.fileno() for what, end in sockets.items()},
                    **feeds.descriptors(name),
                },
            )
            children[name] = Launched(name, job)
    finally:
        for sockets in ends.values():
            for end in sockets.values():
                end.close()
    return children


def _connect_all() -> Ends:
    ends: Ends = {"recorder": {}, "camera": {}, "control": {}}
    for producer in ("camera", "control"):
        for what, make_pair in (("data", socket.socketpair), ("acks", Channel.pair)):
            ends[producer][f"recorder-{what}"], ends["recorder"][f"{producer}-{what}"] = make_pair()
    ends["camera"]["control-status"], ends["control"]["camera-status"] = Channel.pair()
    return ends
