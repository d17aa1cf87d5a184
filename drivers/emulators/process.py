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
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Container, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, asdict, dataclass, fields
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar, get_origin, get_type_hints

from pydantic import TypeAdapter, ValidationError

from drivers.emulators.faults import Device, Fault, FaultKind
from tacauchy_rig.core.errors import ConfigError, DeviceError, RigError

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
        self.fileno, self.close = self._inbox.fileno, self._inbox.close
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


_DATAGRAM_LIMIT = 65536


@dataclass(frozen=True, slots=True, kw_only=True)
class HungWeight:
    """What somebody has hung on the emulated cell [kg]; 0 once it is taken off."""

    mass_kg: float


_MESSAGE = TypeAdapter[Fault | HungWeight](Fault | HungWeight)


def encode_message(message: Fault | HungWeight) -> bytes:
    """Return the datagram that tells an emulator of a fault or a weight."""
    return json.dumps(asdict(message)).encode()


def decode_message(datagram: bytes) -> Fault | HungWeight:
    """Return what a datagram tells.

    Raises:
        ConfigError: Not such a datagram.
    """
    try:
        return _MESSAGE.validate_json(datagram)
    except ValidationError as error:
        raise ConfigError(f"fault message {datagram[:80]!r} is not understood") from error


def post_fault(folder: Path, fault: Fault) -> None:
    """Send ``fault`` to the emulator in ``folder`` that it is meant for.

    Raises:
        DeviceError: No emulator of that device listens in ``folder``.
    """
    _post(folder, fault.device, fault)


def hang_weight(folder: Path, mass_kg: float) -> None:
    """Hang a weight [kg] on the emulated cell in ``folder``; 0 takes it off.

    Raises:
        DeviceError: No emulated cell listens in ``folder``.
    """
    _post(folder, Device.FORCE_SENSOR, HungWeight(mass_kg=mass_kg))


def _post(folder: Path, device: Device, message: Fault | HungWeight) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        try:
            with _short_address(folder, device) as address:
                sender.sendto(encode_message(message), address)
        except OSError as error:
            raise DeviceError(
                f"emulated {device.value}: nothing listens at "
                f"{control_path(folder, device)} ({error.strerror or error})",
                remedy="start the emulated devices, and name the folder that they printed",
            ) from error


class FaultInbox:
    """The listening end, polled by an emulator's loop; never blocks.

    A fault or a weight is one JSON datagram to the Unix socket ``<folder>/<device>.control``.

    Attributes:
        hung_kg: Weight that hangs on the device [kg].
    """

    def __init__(self, folder: Path, device: Device) -> None:
        self.path = control_path(folder, device)
        self.device = device
        self.hung_kg = 0.0
        folder.mkdir(parents=True, exist_ok=True)
        self.path.unlink(missing_ok=True)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        with _short_address(folder, device) as address:
            self._socket.bind(address)

    def fileno(self) -> int:
        """Return the descriptor, for loops that wait on several at once."""
        return self._socket.fileno()

    def poll(self) -> list[Fault]:
        """Return the faults that arrived since the last call; bad messages are logged."""
        faults: list[Fault] = []
        while True:
            try:
                datagram = self._socket.recv(_DATAGRAM_LIMIT)
            except BlockingIOError:
                return faults
            try:
                message = decode_message(datagram)
            except RigError as error:
                logger.warning("%s", error)
                continue
            if isinstance(message, HungWeight):
                self.hung_kg = message.mass_kg
            elif message.device is self.device:
                faults.append(message)

    def close(self) -> None:
        """Stop listening and remove the socket."""
        self._socket.close()
        self.path.unlink(missing_ok=True)


class FaultSchedule:
    """Which faults are on now, by the clock of the emulator that asks."""

    def __init__(self) -> None:
        self._entries: list[tuple[float, float, Fault]] = []

    def add(self, fault: Fault, *, now_s: float) -> None:
        """Take ``fault`` in, its start counted from ``now_s`` [s]."""
        start_s = now_s + fault.start_s
        self._entries.append((start_s, start_s + fault.duration_s, fault))

    def forget(self, kinds: Container[FaultKind], *, now_s: float) -> None:
        """End those of ``kinds`` that have begun by ``now_s`` [s]; later ones are still to come."""
        self._entries = [
            entry for entry in self._entries if entry[0] > now_s or entry[2].kind not in kinds
        ]

    def active(self, now_s: float) -> list[Fault]:
        """Return the faults that are on at ``now_s`` [s] and forget those that are over."""
        if not self._entries:
            return []
        self._entries = [entry for entry in self._entries if now_s < entry[1]]
        return [fault for start_s, _, fault in self._entries if start_s <= now_s]


def control_path(folder: Path, device: Device) -> Path:
    """Return where the emulator of ``device`` listens."""
    return folder / f"{device.value}.control"


@contextmanager
def _short_address(folder: Path, device: Device) -> Iterator[str]:
    """Yield an address of the socket that fits the 107 bytes that Unix sockets allow."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{descriptor}/{control_path(folder, device).name}"
    finally:
        os.close(descriptor)
