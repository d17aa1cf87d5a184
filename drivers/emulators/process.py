"""One emulator as a process: started and ended from outside, and what all of them do inside.

Inside there are settings, pickled on the command line, one JSON line when the device answers,
the faults that it is told of, and the word to end.
"""

import base64
import contextlib
import json
import logging
import os
import pickle
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Container, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from drivers.emulators.faults import Device, Fault, FaultKind
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import DeviceError, RigError

logger = logging.getLogger(__name__)

READY_TIMEOUT_S = 60.0
END_TIMEOUT_S = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceSettings:
    """What every emulator is told."""

    folder: Path  # where the world and its truth, traces, logs and control sockets lie
    config: RigConfig  # the rig that it belongs to
    host: str = "127.0.0.1"  # address to serve at, or of the robot to follow
    port: int = 0  # of the camera's stream; 0 takes a free one
    # In what it differs from most of its kind: ``local-control`` of a robot; of a box ``smpr`` for
    # its rate, and replies that are ``bare`` or ``silent``.
    quirks: frozenset[str] = frozenset()
    parent_pid: int | None = None  # it ends with this process; None to serve until told otherwise


def command_line(module: str, settings: DeviceSettings) -> list[str]:
    """Return the command that runs an emulator, a module of this package, with its settings."""
    given = base64.b64encode(pickle.dumps(settings)).decode()
    return [sys.executable, "-m", f"drivers.emulators.{module}", given]


def own_settings() -> DeviceSettings:
    """Return the settings of this process, as ``command_line`` wrote them."""
    settings: DeviceSettings = pickle.loads(base64.b64decode(sys.argv[1]))  # noqa: S301
    return settings


class EmulatedProcess:
    """One emulator: a child process that prints a JSON line when it is ready."""

    def __init__(self, name: str, module: str, settings: DeviceSettings) -> None:
        self.name = name
        self.log = settings.folder / f"{name}.log"
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                command_line(module, replace(settings, parent_pid=os.getpid())),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=log,
                start_new_session=True,
                bufsize=0,  # so that what can be read is what ``select`` says
            )

    def wait_ready(self) -> dict[str, Any]:
        """Return the emulator's ready line."""
        deadline = time.monotonic() + READY_TIMEOUT_S
        stream = self.process.stdout
        while stream and select.select([stream], [], [], max(0.0, deadline - time.monotonic()))[0]:
            line = stream.readline()
            if not line:  # it ended
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self.process.wait(END_TIMEOUT_S)
                break
            with contextlib.suppress(ValueError):
                return dict(json.loads(line))
        lines = self.log.read_text(errors="replace").strip().splitlines()
        raise DeviceError(
            f"emulated {self.name}: not ready within {READY_TIMEOUT_S:g} s (exit status "
            f"{self.process.poll()}): {lines[-1] if lines else 'it printed no error'}",
            remedy=f"read {self.log}",
        )

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


class Service:
    """What an emulated device listens to besides its wire: faults, a weight, the word to end.

    A fault or a weight is one JSON datagram to the Unix socket ``<folder>/<device>.control``.
    """

    def __init__(self, settings: DeviceSettings, device: Device) -> None:
        self.device = device
        self._is_told_to_end = False
        # Weight that somebody has hung on the device [kg], as of the last look at its faults.
        self.hung_kg = 0.0
        self._parent_pid = settings.parent_pid
        self._faults: list[tuple[float, float, Fault]] = []  # with start and end [s]
        self._path = control_path(settings.folder, device)
        try:
            settings.folder.mkdir(parents=True, exist_ok=True)
            self._path.unlink(missing_ok=True)
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._socket.setblocking(False)
            with short_address(self._path) as address:
                self._socket.bind(address)
        except OSError as error:
            raise DeviceError(
                f"emulated {device.value}: {error.strerror or error}",
                remedy=f"see that {settings.folder} can be created and written",
            ) from error

    @property
    def is_over(self) -> bool:
        """True once it was told to end or its parent process has ended."""
        return self._is_told_to_end or self._parent_pid not in (None, os.getppid())

    def end(self, *_: object) -> None:
        """Be over; a handler of signals."""
        self._is_told_to_end = True

    def faults_at(self, now_s: float) -> list[Fault]:
        """Return the faults that are on at ``now_s`` [s]; a new one's start counts from there."""
        self._listen(now_s)
        self._faults = [each for each in self._faults if now_s < each[1]]
        return [fault for start_s, _, fault in self._faults if start_s <= now_s]

    def end_faults(self, kinds: Container[FaultKind], *, now_s: float) -> None:
        """End those of ``kinds`` that have begun by ``now_s`` [s], as somebody has mended them."""
        self._faults = [
            each for each in self._faults if each[0] > now_s or each[2].kind not in kinds
        ]

    def announce(self, **where: object) -> None:
        """Print the one line that says that the device answers, and where."""
        line = {"device": self.device.value, "pid": os.getpid(), **where}
        print(json.dumps(line), flush=True)

    def fileno(self) -> int:
        """Return the descriptor, for loops that wait on several at once."""
        return self._socket.fileno()

    def close(self) -> None:
        """Stop listening and remove the socket."""
        self._socket.close()
        self._path.unlink(missing_ok=True)

    def _listen(self, now_s: float) -> None:
        """Take in what was told since the last call; bad messages are logged."""
        while True:
            try:
                datagram = self._socket.recv(_DATAGRAM_LIMIT)
            except BlockingIOError:
                return
            try:
                message = _MESSAGE.validate_json(datagram)
            except (ValidationError, RigError) as error:
                logger.warning("message %r is not understood: %s", datagram[:80], error)
                continue
            if isinstance(message, HungWeight):
                self.hung_kg = message.mass_kg
            elif message.device is self.device:
                logger.info("fault: %s", message)
                start_s = now_s + message.start_s
                self._faults.append((start_s, start_s + message.duration_s, message))


def run_device(device: Device, serve: Callable[[DeviceSettings, Service], None]) -> int:
    """Be an emulated device, as this process's command line says; return the exit status.

    ``serve`` serves, announced, until its ``Service`` is over.
    """
    settings = own_settings()
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
    try:
        with contextlib.closing(Service(settings, device)) as service:
            for number in (signal.SIGTERM, signal.SIGINT):
                signal.signal(number, service.end)
            serve(settings, service)
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


def post_fault(folder: Path, message: Fault | HungWeight) -> None:
    """Send a fault, or a weight on the cell, to the emulator in ``folder`` that it is meant for.

    Raises:
        DeviceError: No emulator of that device listens in ``folder``.
    """
    device = message.device if isinstance(message, Fault) else Device.FORCE_SENSOR
    path = control_path(folder, device)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        try:
            with short_address(path) as address:
                sender.sendto(json.dumps(asdict(message)).encode(), address)
        except OSError as error:
            raise DeviceError(
                f"emulated {device.value}: nothing listens at {path} ({error.strerror or error})",
                remedy="start the emulated devices, and name the folder that they printed",
            ) from error


def hang_weight(folder: Path, mass_kg: float) -> None:
    """Hang a weight [kg] on the emulated cell in ``folder``; 0 takes it off."""
    post_fault(folder, HungWeight(mass_kg=mass_kg))


def control_path(folder: Path, device: Device) -> Path:
    """Return where the emulator of ``device`` listens."""
    return folder / f"{device.value}.control"


@contextmanager
def short_address(path: Path) -> Iterator[str]:
    """Yield an address of a socket that fits the 107 bytes that Unix sockets allow."""
    descriptor = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{descriptor}/{path.name}"
    finally:
        os.close(descriptor)
