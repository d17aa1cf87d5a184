"""One emulator as a process: started and ended from outside, and what all of them do inside.

Inside there is a dataclass of settings that is also the command line, one JSON line when the device
answers, the faults that it is told of, and the word to end.
"""

from __future__ import annotations

import argparse
import contextlib
import inspect
import json
import logging
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Container, Sequence
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar, get_origin, get_type_hints

from pydantic import TypeAdapter, ValidationError

from drivers.device.faults import Device, Fault, FaultKind
from drivers.emulators.faults import FaultInbox, FaultSchedule
from tacauchy_rig.core.errors import DeviceError, RigError

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
                bufsize=0,  # so that what can be read is what ``select`` says
            )

    def wait_ready(self, *, timeout_s: float = READY_TIMEOUT_S) -> dict[str, Any]:
        """Return the emulator's ready line.

        Raises:
            DeviceError: It ended, or said nothing before the deadline.
        """
        deadline = time.monotonic() + timeout_s
        stream = self.process.stdout
        while stream is not None and time.monotonic() < deadline:
            if not select.select([stream], [], [], 0.1)[0]:
                continue
            line = stream.readline()
            if not line:  # it ended
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self.process.wait(END_TIMEOUT_S)
                break
            with contextlib.suppress(ValueError):
                return dict(json.loads(line))
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
        if self.process.stdout is not None:
            self.process.stdout.close()


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
        logger.info("no right to a higher priority; `ulimit -r 1; ulimit -e 40` would give it")


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceSettings:
    """What every emulated device is told.

    Attributes:
        folder: Where its traces and its control socket lie.
        seed: Draws its noise and its faults.
        parent_pid: It ends with this process; None to serve until told otherwise.
    """

    folder: Path
    seed: int = 0
    parent_pid: int | None = None


SettingsT = TypeVar("SettingsT")


def settings_from(kind: type[SettingsT], arguments: Sequence[str] | None = None) -> SettingsT:
    """Return the settings that a command line asks for: an option for each field of ``kind``.

    Args:
        kind: A dataclass of settings; its docstring and its bases' are the help. Values of tuples
            are given with commas between them.
        arguments: The command line; this process's if None.
    """
    parser = argparse.ArgumentParser(
        description="\n\n".join(inspect.getdoc(each) or "" for each in kind.__mro__[:-1]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    for field in fields(kind):  # type: ignore[arg-type]
        needed = field.default is MISSING
        text = "needed" if needed else f"{field.default} if left out"
        parser.add_argument(_option(field.name), required=needed, help=text)
    hints = get_type_hints(kind)
    given: dict[str, Any] = {
        name: text.split(",") if get_origin(hints[name]) is tuple else text
        for name, text in vars(parser.parse_args(arguments)).items()
        if text is not None
    }
    try:
        return TypeAdapter(kind).validate_python(given)
    except ValidationError as error:
        wrong = [f"{_option(str(each['loc'][0]))}: {each['msg']}" for each in error.errors()]
        parser.error("; ".join(wrong))


def arguments_of(settings: object) -> list[str]:
    """Return the command line that ``settings_from`` turns into ``settings`` again."""
    given = {field.name: getattr(settings, field.name) for field in fields(settings)}  # type: ignore[arg-type]
    texts = {
        name: ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
        for name, value in given.items()
        if value is not None
    }
    return [f"{_option(name)}={text}" for name, text in texts.items()]


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


class Service:
    """What an emulated device listens to besides its wire: faults, SIGTERM, SIGINT, its parent."""

    def __init__(self, settings: DeviceSettings, device: Device) -> None:
        self._device = device
        self._parent_pid = settings.parent_pid
        self._inbox = FaultInbox(settings.folder, device)
        self._schedule = FaultSchedule()
        self._told_to_end = False
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._end)

    def _end(self, _number: int, _frame: FrameType | None) -> None:
        self._told_to_end = True

    @property
    def is_over(self) -> bool:
        """True once it was told to end or its parent process has ended."""
        return self._told_to_end or self._parent_pid not in (None, os.getppid())

    @property
    def hung_kg(self) -> float:
        """Weight that somebody has hung on the device [kg], as of the last look at its faults."""
        return self._inbox.hung_kg

    def fileno(self) -> int:
        """Return the descriptor on which faults arrive, for loops that wait on several at once."""
        return self._inbox.fileno()

    def faults_at(self, now_s: float) -> list[Fault]:
        """Return the faults that are on at ``now_s`` [s]; a new one's start counts from there."""
        for fault in self._inbox.poll():
            logger.info("fault: %s", fault)
            self._schedule.add(fault, now_s=now_s)
        return self._schedule.active(now_s)

    def end_faults(self, kinds: Container[FaultKind]) -> None:
        """End the faults of ``kinds`` that are on, as somebody has mended them."""
        self._schedule.forget(kinds, now_s=time.monotonic())

    def announce(self, **where: object) -> None:
        """Print the one line that says that the device answers, and where."""
        line = {"device": self._device.value, "pid": os.getpid(), **where}
        print(json.dumps(line), flush=True)

    def close(self) -> None:
        """Hear of no more faults."""
        self._inbox.close()


DeviceSettingsT = TypeVar("DeviceSettingsT", bound=DeviceSettings)


def run_device(
    kind: type[DeviceSettingsT],
    device: Device,
    serve: Callable[[DeviceSettingsT, Service], None],
) -> int:
    """Be an emulated device, as this process's command line says; return the exit status.

    Args:
        kind: Its settings.
        device: What it is.
        serve: Serves, announced, until its ``Service`` is over.
    """
    settings = settings_from(kind)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
    try:
        try:
            service = Service(settings, device)
        except OSError as error:
            raise DeviceError(
                f"emulated {device.value}: {error.strerror or error}",
                remedy=f"see that {settings.folder} can be created and written",
            ) from error
        try:
            serve(settings, service)
        finally:
            service.close()
    except RigError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0
