"""The program under test as a process: started, confirmed, watched by its journal, killed."""

import contextlib
import os
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import psutil

from tacauchy_rig.app.cli.operator_prompts import expected_answer
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import DeviceError, RecordError
from tacauchy_rig.core.run import JournalEvent, Phase
from tacauchy_rig.core.store.journal import Journal
from tacauchy_rig.core.store.run_files import RunPaths
from tests.studies.fault_table.cases import Blow, BlowKind, Victim

_LOOK_S = 0.005
_ORPHANS_S = 40.0
PAGE = re.compile(r"\bpage (http://\S+)")
"""How the address of a page is printed, which may be behind the prompt of a confirmation."""


class CommandProcess:
    """``tacauchy-rig COMMAND ... --press-only`` with its output in files."""

    def __init__(
        self,
        arguments: list[str],
        *,
        folder: Path,
        name: str,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.hung = False  # it had to be ended because it did not end by itself
        self._out, self._err = folder / f"{name}.out", folder / f"{name}.err"
        with self._out.open("wb") as out, self._err.open("wb") as err:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "tacauchy_rig.app.cli.app", *arguments, "--press-only"],
                stdin=subprocess.PIPE,
                stdout=out,
                stderr=err,
                env=environment,
                start_new_session=True,
            )

    def confirm(self, config: RigConfig) -> None:
        """Type what the confirmation asks for; standard input stays open."""
        if self.process.stdin is None:
            return
        try:
            self.process.stdin.write(f"{expected_answer(config)}\n".encode())
            self.process.stdin.flush()
        except BrokenPipeError:
            return  # It has ended already, and its exit status will be told.

    def wait(self, timeout_s: float) -> int:
        """Return the exit status; negative is the signal that killed it."""
        try:
            self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self.hung = True
            self.process.kill()
            self.process.wait()
        self._close_input()
        return self.process.returncode

    def close(self) -> None:
        """End it if it still runs."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self._close_input()

    def _close_input(self) -> None:
        if self.process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self.process.stdin.close()

    def error_text(self) -> str:
        """Return what it told the operator last: from the last ``error:`` on."""
        text = self.errors().strip()
        start = text.rfind("error: ")
        return text[start:] if start >= 0 else text

    def errors(self) -> str:
        """Return its standard error."""
        return self._err.read_text("utf-8", errors="replace")

    def output(self) -> str:
        """Return its standard output."""
        return self._out.read_text("utf-8", errors="replace")


class WatchedRun:
    """A run that is followed by its journal."""

    def __init__(self, command: CommandProcess, parent: Path) -> None:
        self.command = command
        self._parent = parent
        self.pids: dict[str, int] = {}

    @property
    def paths(self) -> RunPaths:
        """The run folder, the first that appeared."""
        folders = sorted(self._parent.glob("*/run.json"))
        if not folders:
            raise RecordError(f"{self._parent}: the run made no run folder")
        return RunPaths(folders[0].parent)

    def journal(self) -> list[JournalEvent]:
        """Return the journal so far; empty where there is none yet."""
        try:
            return Journal.read(self.paths.journal).events
        except RecordError:
            return []

    def wait_for_phase(self, phase: Phase, *, timeout_s: float) -> JournalEvent:
        """Return the event with which a phase began."""
        deadline = time.monotonic() + timeout_s
        seen_size = -1
        while time.monotonic() < deadline:
            size = self._journal_size()
            events = self.journal() if size != seen_size else []
            seen_size = size
            for event in events:
                if event.name == "run-start":
                    self.pids = dict(event.detail["pids"])
                if event.name == "phase" and event.detail.get("phase") == phase.value:
                    return event
            if self.command.process.poll() is not None:
                raise DeviceError(
                    f"the run ended before its {phase.value}: {self.command.error_text()}"
                )
            time.sleep(_LOOK_S)
        raise DeviceError(f"the run did not reach its {phase.value} within {timeout_s:g} s")

    def strike(self, blow: Blow) -> None:
        """Kill a process of the run without warning, stop it, or let it have no more memory."""
        known = {**self.pids, Victim.SUPERVISOR.value: self.command.process.pid}
        pid = known[blow.victim.value]
        if blow.kind is BlowKind.KILL:
            os.kill(pid, signal.SIGKILL)
        elif blow.kind is BlowKind.HANG:
            os.kill(pid, signal.SIGSTOP)
        else:
            resource.prlimit(pid, resource.RLIMIT_AS, (1, 1))

    def page_address(self) -> str:
        """Return the address of its page, as it was printed."""
        addresses = PAGE.findall(self.command.output())
        if not addresses:
            raise DeviceError("the run printed no address of a page")
        return str(addresses[-1])

    def wait_until_gone(self) -> list[str]:
        """Wait for every process of the run; return those that had to be ended."""
        deadline = time.monotonic() + _ORPHANS_S
        while (alive := self._alive()) and time.monotonic() < deadline:
            time.sleep(0.05)
        for name in alive:
            os.kill(self.pids[name], signal.SIGKILL)
        return alive

    def _alive(self) -> list[str]:
        return [name for name, pid in self.pids.items() if _is_alive(pid)]

    def _journal_size(self) -> int:
        try:
            return self.paths.journal.stat().st_size
        except (OSError, RecordError):
            return 0


def _is_alive(pid: int) -> bool:
    try:
        return bool(psutil.Process(pid).status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False
