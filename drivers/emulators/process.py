"""One emulator as a child process, and how it keeps time on a computer that it shares."""

from __future__ import annotations

import json
import logging
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from queue import Empty, Queue
from typing import Any

from tacauchy_rig.errors import DeviceError

logger = logging.getLogger(__name__)

READY_TIMEOUT_S = 60.0
END_TIMEOUT_S = 3.0


class EmulatedProcess:
    """One emulator: a child process that prints a JSON line when it is ready."""

    def __init__(self, name: str, arguments: list[str], *, folder: Path) -> None:
        self.name = name
        self.log = folder / f"{name}.log"
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", *arguments, "--parent-pid", str(os.getpid())],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=log,
                start_new_session=True,
            )
        self._lines: Queue[str] = Queue()
        self._reader = threading.Thread(target=self._read_lines, daemon=True)
        self._reader.start()

    def _read_lines(self) -> None:
        stream = self.process.stdout
        if stream is None:
            return
        with stream:
            for line in stream:
                self._lines.put(line.decode(errors="replace"))

    def wait_ready(self, *, timeout_s: float = READY_TIMEOUT_S) -> dict[str, Any]:
        """Return the emulator's ready line.

        Raises:
            DeviceError: It ended, or said nothing before the deadline.
        """
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            try:
                return dict(json.loads(self._lines.get(timeout=0.1)))
            except Empty:
                if self.process.poll() is not None:
                    break
            except ValueError:
                continue
        raise DeviceError(
            f"emulated {self.name}: not ready within {timeout_s:g} s "
            f"(exit status {self.process.poll()}): {self._log_tail()}",
            remedy=f"read {self.log}",
        )

    def _log_tail(self) -> str:
        lines = self.log.read_text(errors="replace").strip().splitlines()
        return lines[-1] if lines else "it printed no error"

    def stop(self) -> None:
        """Ask it to end, kill it if it does not, and let go of its output."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(timeout=END_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                logger.warning("emulated %s did not end; killing it", self.name)
                self.process.kill()
                self.process.wait()
        self._reader.join(timeout=END_TIMEOUT_S)


_logger = logging.getLogger(__name__)

_REAL_TIME_PRIORITY = 1
_NICENESS = -10


def keep_time(*, mostly_sleeps: bool) -> None:
    """Ask the kernel to run this process when it is due; without the right to it, go on.

    A real device is not slowed down by the computer that it serves.

    Args:
        mostly_sleeps: Whether the whole process works for a small part of its time, so that it
            may go ahead of all ordinary processes; otherwise it is only preferred to them.
    """
    try:
        if mostly_sleeps:
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_REAL_TIME_PRIORITY))
        else:
            os.nice(_NICENESS)
    except PermissionError:
        _logger.info("no right to a higher priority; `ulimit -r 1; ulimit -e 40` would give it")
