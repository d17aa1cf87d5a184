"""How an emulated device is told to fail, while it runs or by a plan made before.

A fault is written ``device:kind[@start][+duration]``, for example ``force_sensor:freeze@12s+2s``.
It travels as one JSON datagram to the Unix socket ``<folder>/<device>.control``, which every
emulator polls in its loop.
"""

from __future__ import annotations

import json
import math
import os
import re
import socket
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from tacauchy_rig.errors import ConfigError, DeviceError, RigError
from tacauchy_rig.quantities import Dimension, parse_quantity


class Device(StrEnum):
    """Emulated devices that can be told to fail."""

    ROBOT = "robot"
    FORCE_SENSOR = "force_sensor"
    CAMERA = "camera"


class FaultKind(StrEnum):
    """What can go wrong."""

    FREEZE = "freeze"
    DROP = "drop"
    GARBLE = "garble"
    DELAY = "delay"
    PROTECTIVE_STOP = "protective-stop"
    EMERGENCY_STOP = "emergency-stop"
    UNPLUG = "unplug"
    SATURATE = "saturate"
    STALL = "stall"


_STREAM_FAULTS = frozenset(
    {
        FaultKind.FREEZE,
        FaultKind.DROP,
        FaultKind.GARBLE,
        FaultKind.DELAY,
        FaultKind.UNPLUG,
        FaultKind.SATURATE,
        FaultKind.STALL,
    }
)

FAULTS_OF_DEVICE: dict[Device, frozenset[FaultKind]] = {
    Device.ROBOT: frozenset(
        {
            FaultKind.FREEZE,
            FaultKind.DROP,
            FaultKind.DELAY,
            FaultKind.PROTECTIVE_STOP,
            FaultKind.EMERGENCY_STOP,
            FaultKind.STALL,
        }
    ),
    Device.FORCE_SENSOR: _STREAM_FAULTS,
    Device.CAMERA: _STREAM_FAULTS,
}

_PLAN = re.compile(r"^\s*([^:@+\s]+):([^:@+\s]+)(?:@([^@+]+))?(?:\+([^@+]+))?\s*$")
_EXAMPLE = "write device:kind@start+duration, for example force_sensor:freeze@12s+2s"
_DATAGRAM_LIMIT = 65536


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One thing that goes wrong with one device.

    Attributes:
        duration_s: How long it lasts [s]; infinite for ever. At the end of a stop or an
            unplugging somebody has unlocked the arm or plugged the device in again.
        start_s: When it begins, after the emulator is told of it [s]; 0 is at once.
        parameters: Numbers that some kinds take, such as ``delay_s`` or ``fraction``.
    """

    device: Device
    kind: FaultKind
    duration_s: float = math.inf
    start_s: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.kind not in FAULTS_OF_DEVICE[self.device]:
            possible = ", ".join(sorted(FAULTS_OF_DEVICE[self.device]))
            raise ConfigError(
                f"fault: a {self.device.value} cannot {self.kind.value}",
                remedy=f"{self.device.value} knows: {possible}",
            )
        if not (self.duration_s > 0.0 and 0.0 <= self.start_s < math.inf):
            raise ConfigError(
                f"fault {self.device.value}:{self.kind.value}: start {self.start_s} s and duration "
                f"{self.duration_s} s are impossible",
                remedy="give a start of 0 s or later and a duration above 0 s",
            )


def parse_fault(text: str) -> Fault:
    """Parse text such as ``robot:stall@3s+500ms``; start and duration may be left out.

    Raises:
        ConfigError: Malformed, an unknown device or kind, or a kind the device cannot show.
    """
    match = _PLAN.match(text)
    if match is None:
        raise ConfigError(f"fault: {text!r} is not understood", remedy=_EXAMPLE)
    device, kind, start, duration = match.groups()
    return Fault(
        device=_device(device),
        kind=_kind(kind),
        start_s=_seconds(start) if start else 0.0,
        duration_s=_seconds(duration) if duration else math.inf,
    )


def send_fault(
    folder: Path,
    device: Device | str,
    kind: FaultKind | str,
    duration_s: float = math.inf,
    **parameters: float,
) -> None:
    """Tell a running emulator to fail now.

    Args:
        folder: The emulation's folder.
        device: Which emulator, or its name.
        kind: What goes wrong, or its name.
        duration_s: How long [s].
        parameters: Numbers for the kind, for example ``delay_s=0.2``.

    Raises:
        ConfigError: The device cannot fail in that way.
        DeviceError: No emulator of that device listens in ``folder``.
    """
    fault = Fault(
        device=_device(device), kind=_kind(kind), duration_s=duration_s, parameters=parameters
    )
    post_fault(folder, fault)


def post_fault(folder: Path, fault: Fault) -> None:
    """Send ``fault`` to the emulator in ``folder`` that it is meant for.

    Raises:
        DeviceError: No emulator of that device listens in ``folder``.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        try:
            with _ShortAddress(folder, fault.device) as address:
                sender.sendto(encode_fault(fault), address)
        except OSError as error:
            raise DeviceError(
                f"emulated {fault.device.value}: nothing listens at "
                f"{control_path(folder, fault.device)} ({error.strerror or error})",
                remedy="start the emulated devices, and name the folder that they printed",
            ) from error


def encode_fault(fault: Fault) -> bytes:
    """Return the datagram for ``fault``."""
    return json.dumps(
        {
            "device": fault.device.value,
            "kind": fault.kind.value,
            "start_s": fault.start_s,
            "duration_s": None if math.isinf(fault.duration_s) else fault.duration_s,
            "parameters": dict(fault.parameters),
        }
    ).encode()


def decode_fault(datagram: bytes) -> Fault:
    """Return the fault in ``datagram``.

    Raises:
        ConfigError: Not such a datagram.
    """
    try:
        content = json.loads(datagram)
        duration_s = content["duration_s"]
        return Fault(
            device=_device(content["device"]),
            kind=_kind(content["kind"]),
            start_s=float(content["start_s"]),
            duration_s=math.inf if duration_s is None else float(duration_s),
            parameters={str(name): float(v) for name, v in content["parameters"].items()},
        )
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ConfigError(f"fault message {datagram[:80]!r} is not understood") from error


class FaultInbox:
    """The listening end, polled by an emulator's loop; never blocks."""

    def __init__(self, folder: Path, device: Device) -> None:
        self.path = control_path(folder, device)
        self.device = device
        self.rejected: list[str] = []
        folder.mkdir(parents=True, exist_ok=True)
        self.path.unlink(missing_ok=True)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        with _ShortAddress(folder, device) as address:
            self._socket.bind(address)

    def fileno(self) -> int:
        """Return the descriptor, for loops that wait on several at once."""
        return self._socket.fileno()

    def poll(self) -> list[Fault]:
        """Return the faults that arrived since the last call; bad messages go to ``rejected``."""
        faults: list[Fault] = []
        while True:
            try:
                datagram = self._socket.recv(_DATAGRAM_LIMIT)
            except BlockingIOError:
                return faults
            try:
                fault = decode_fault(datagram)
            except RigError as error:
                self.rejected.append(str(error))
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

    def active(self, now_s: float) -> list[Fault]:
        """Return the faults that are on at ``now_s`` [s] and forget those that are over."""
        if not self._entries:
            return []
        self._entries = [entry for entry in self._entries if now_s < entry[1]]
        return [fault for start_s, _, fault in self._entries if start_s <= now_s]


def control_path(folder: Path, device: Device) -> Path:
    """Return where the emulator of ``device`` listens."""
    return folder / f"{device.value}.control"


class _ShortAddress:
    """An address of the socket that fits the 107 bytes that Unix sockets allow."""

    def __init__(self, folder: Path, device: Device) -> None:
        self._folder = folder
        self._name = control_path(folder, device).name

    def __enter__(self) -> str:
        self._descriptor = os.open(self._folder, os.O_RDONLY | os.O_DIRECTORY)
        return f"/proc/self/fd/{self._descriptor}/{self._name}"

    def __exit__(self, *_: object) -> None:
        os.close(self._descriptor)


def _device(name: str) -> Device:
    if name not in set(Device):
        raise ConfigError(
            f"fault: device {name!r} is unknown", remedy=f"one of: {', '.join(Device)}"
        )
    return Device(name)


def _kind(name: str) -> FaultKind:
    if name not in set(FaultKind):
        raise ConfigError(
            f"fault: kind {name!r} is unknown", remedy=f"one of: {', '.join(FaultKind)}"
        )
    return FaultKind(name)


def _seconds(text: str) -> float:
    return parse_quantity(text, dimension=Dimension.TIME, field="fault").value
