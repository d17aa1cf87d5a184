"""A process that watches a run, and that the run does without."""

from __future__ import annotations

import logging
import time
from dataclasses import replace
from typing import Any

from protocols.processes.channel import Channel
from protocols.processes.launched import Launched
from protocols.processes.messages import Job, Order
from tacauchy_rig.core.errors import RigError

logger = logging.getLogger(__name__)

SILENT_S = 5.0
START_S = 30.0
STARTS_MAX = 6
END_S = 2.0
_NO_MORE = "not started again"


class Viewer:
    """Started again when it dies or hangs, on the sockets that it had; given up after some times.

    Args:
        name: Module of ``protocols.processes`` that it runs, unless one is given.
        job: What it is to do; its descriptors stay open in this process.
        module: What it runs instead, by its whole name.
    """

    def __init__(self, name: str, job: Job, *, module: str = "") -> None:
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

    def hear(self) -> list[Any]:
        """Return what it said."""
        return [] if self._child is None else self._child.hear()

    def look(self) -> str:
        """Start it again if it is gone or silent; return what happened, or an empty text."""
        child = self._child
        if child is None:
            return ""
        if not child.has_ended and time.monotonic() - child.heard_s > SILENT_S:
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
        self._child.heard_s += START_S - SILENT_S
