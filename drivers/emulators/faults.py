"""How an emulated device is told to fail, while it runs or by a plan made before.

A fault travels as one JSON datagram to the Unix socket ``<folder>/<device>.control``, which every
emulator polls in its loop. So does the weight that somebody hangs on the emulated cell.
"""

from __future__ import annotations

import json
import logging
import os
import socket
from collections.abc import Container, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from drivers.device.faults import Device, Fault, FaultKind
from tacauchy_rig.core.errors import ConfigError, DeviceError, RigError

_logger = logging.getLogger(__name__)

_DATAGRAM_LIMIT = 65536
_FAULT = TypeAdapter(Fault)


@dataclass(frozen=True, slots=True, kw_only=True)
class HungWeight:
    """What somebody has hung on the emulated cell [kg]; 0 once it is taken off."""

    mass_kg: float


_WEIGHT = TypeAdapter(HungWeight)


def post_fault(folder: Path, fault: Fault) -> None:
    """Send ``fault`` to the emulator in ``folder`` that it is meant for.

    Raises:
        DeviceError: No emulator of that device listens in ``folder``.
    """
    _post(folder, fault.device, encode_fault(fault))


def hang_weight(folder: Path, mass_kg: float) -> None:
    """Hang a weight [kg] on the emulated cell in ``folder``; 0 takes it off.

    Raises:
        DeviceError: No emulated cell listens in ``folder``.
    """
    _post(folder, Device.FORCE_SENSOR, json.dumps({"mass_kg": mass_kg}).encode())


def _post(folder: Path, device: Device, datagram: bytes) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        try:
            with _short_address(folder, device) as address:
                sender.sendto(datagram, address)
        except OSError as error:
            raise DeviceError(
                f"emulated {device.value}: nothing listens at "
                f"{control_path(folder, device)} ({error.strerror or error})",
                remedy="start the emulated devices, and name the folder that they printed",
            ) from error


def encode_fault(fault: Fault) -> bytes:
    """Return the datagram for ``fault``."""
    return json.dumps(asdict(fault)).encode()


def decode_fault(datagram: bytes) -> Fault:
    """Return the fault in ``datagram``.

    Raises:
        ConfigError: Not such a datagram.
    """
    try:
        return _FAULT.validate_json(datagram)
    except ValidationError as error:
        raise ConfigError(f"fault message {datagram[:80]!r} is not understood") from error


def _decode_weight(datagram: bytes) -> HungWeight | None:
    try:
        return _WEIGHT.validate_json(datagram)
    except ValidationError:
        return None


class FaultInbox:
    """The listening end, polled by an emulator's loop; never blocks.

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
            if (weight := _decode_weight(datagram)) is not None:
                self.hung_kg = weight.mass_kg
                continue
            try:
                fault = decode_fault(datagram)
            except RigError as error:
                _logger.warning("%s", error)
                continue
            if fault.device is self.device:
                faults.append(fault)

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
