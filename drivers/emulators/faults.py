"""Faults that a stand-in for a device can show, and how they are written.

A fault is written ``device:kind[=amount][@start][+duration]``, for example
``force_sensor:freeze@12s+2s`` or ``force_sensor:scale=0.1@3s``.
"""

from __future__ import annotations

import math
import random
import re
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeVar

from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import Dimension, parse_quantity


class Device(StrEnum):
    """Emulated devices that can be told to fail."""

    ROBOT = "robot"
    FORCE_SENSOR = "force_sensor"
    CAMERA = "camera"


class FaultKind(StrEnum):
    """What can go wrong; the later ones go wrong quietly. ``unlock`` is a person's remedy."""

    FREEZE = "freeze"
    DROP = "drop"
    GARBLE = "garble"
    DELAY = "delay"
    PROTECTIVE_STOP = "protective-stop"
    EMERGENCY_STOP = "emergency-stop"
    UNPLUG = "unplug"
    SATURATE = "saturate"
    STALL = "stall"
    UNLOCK = "unlock"
    SCALE = "scale"
    STICK = "stick"
    STICK_NOISILY = "stick-noisily"
    SIGN = "sign"
    SWAP_AXES = "swap-axes"
    OLD_DATA = "old-data"
    FREEZE_IMAGE = "freeze-image"
    REPEAT_IMAGE = "repeat-image"
    WRONG_POSE = "wrong-pose"
    CLOCK_JUMP = "clock-jump"


ChoiceT = TypeVar("ChoiceT", bound=StrEnum)

STOPS = frozenset({FaultKind.PROTECTIVE_STOP, FaultKind.EMERGENCY_STOP})
SILENT_FORCE_FAULTS = frozenset(
    {
        FaultKind.SCALE,
        FaultKind.STICK,
        FaultKind.STICK_NOISILY,
        FaultKind.SIGN,
        FaultKind.SWAP_AXES,
        FaultKind.OLD_DATA,
    }
)
_ANY_DEVICE = frozenset({FaultKind.DROP, FaultKind.DELAY, FaultKind.STALL})
_SENSORS = _ANY_DEVICE | {FaultKind.GARBLE, FaultKind.UNPLUG, FaultKind.SATURATE}

FAULTS_OF_DEVICE: dict[Device, frozenset[FaultKind]] = {
    Device.ROBOT: _ANY_DEVICE
    | STOPS
    | {FaultKind.FREEZE, FaultKind.UNLOCK, FaultKind.WRONG_POSE, FaultKind.CLOCK_JUMP},
    Device.FORCE_SENSOR: _SENSORS | SILENT_FORCE_FAULTS | {FaultKind.FREEZE},
    Device.CAMERA: _SENSORS | {FaultKind.FREEZE_IMAGE, FaultKind.REPEAT_IMAGE},
}


@dataclass(frozen=True, slots=True)
class Amount:
    """How much of a fault there can be.

    Attributes:
        dimension: Of the amount.
        usual: As one writes it; empty where the device decides.
        least: Smallest possible [SI unit].
        most: Largest possible [SI unit].
    """

    dimension: Dimension
    usual: str
    least: float
    most: float


OLDEST_S = 60.0
"""Nothing older than this is sent again [s]."""
_LONGEST_LOOP = 100.0

AMOUNTS: dict[tuple[Device, FaultKind], Amount] = {
    (Device.ROBOT, FaultKind.DELAY): Amount(Dimension.TIME, "200 ms", 0.0, OLDEST_S),
    (Device.ROBOT, FaultKind.WRONG_POSE): Amount(Dimension.SPEED, "0.1 mm/s", -0.1, 0.1),
    (Device.ROBOT, FaultKind.CLOCK_JUMP): Amount(Dimension.TIME, "10 s", -86400.0, 86400.0),
    (Device.FORCE_SENSOR, FaultKind.DROP): Amount(Dimension.RATIO, "50 %", 0.0, 1.0),
    (Device.FORCE_SENSOR, FaultKind.GARBLE): Amount(Dimension.RATIO, "30 %", 0.0, 1.0),
    (Device.FORCE_SENSOR, FaultKind.DELAY): Amount(Dimension.TIME, "200 ms", 0.0, OLDEST_S),
    (Device.FORCE_SENSOR, FaultKind.SATURATE): Amount(Dimension.FORCE, "", -1e6, 1e6),
    (Device.FORCE_SENSOR, FaultKind.SCALE): Amount(Dimension.RATIO, "0.5", -1e3, 1e3),
    (Device.FORCE_SENSOR, FaultKind.OLD_DATA): Amount(Dimension.TIME, "3 s", 0.0, OLDEST_S),
    (Device.CAMERA, FaultKind.DROP): Amount(Dimension.RATIO, "30 %", 0.0, 1.0),
    (Device.CAMERA, FaultKind.GARBLE): Amount(Dimension.RATIO, "30 %", 0.0, 1.0),
    (Device.CAMERA, FaultKind.DELAY): Amount(Dimension.TIME, "500 ms", 0.0, OLDEST_S),
    (Device.CAMERA, FaultKind.REPEAT_IMAGE): Amount(Dimension.RATIO, "5", 2.0, _LONGEST_LOOP),
}

_PLAN = re.compile(r"^\s*([^:@+=\s]+):([^:@+=\s]+)(?:=([^@+]+))?(?:@([^@+]+))?(?:\+([^@+]+))?\s*$")
_EXAMPLE = (
    "write device:kind=amount@start+duration, for example force_sensor:freeze@12s+2s or "
    "force_sensor:scale=0.1@3s"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One thing that goes wrong with one device.

    Attributes:
        duration_s: How long it lasts [s]; infinite for ever. At the end of a stop or an
            unplugging somebody has unlocked the arm or plugged the device in again.
        start_s: When it begins, after the emulator is told of it [s]; 0 is at once.
        amount: How much of it, in the SI unit of ``AMOUNTS``; the usual one if None.
    """

    device: Device
    kind: FaultKind
    duration_s: float = math.inf
    start_s: float = 0.0
    amount: float | None = None

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
        if self.amount is not None:
            self._require_amount(self.amount)

    def _require_amount(self, amount: float) -> None:
        name = f"fault {self.device.value}:{self.kind.value}"
        possible = AMOUNTS.get((self.device, self.kind))
        if possible is None:
            raise ConfigError(f"{name} takes no amount", remedy="leave out = and what follows it")
        if not possible.least <= amount <= possible.most:
            raise ConfigError(
                f"{name}: {amount:g} is not from {possible.least:g} to {possible.most:g} [SI unit]",
                remedy=f"for example {self.kind.value}={possible.usual}",
            )

    @property
    def size(self) -> float:
        """How much of it [SI unit], as asked or as usual; NaN where only the device knows."""
        if self.amount is not None:
            return self.amount
        possible = AMOUNTS.get((self.device, self.kind))
        if possible is None or not possible.usual:
            return math.nan
        return parse_quantity(possible.usual, dimension=possible.dimension, field="fault")


def parse_fault(text: str) -> Fault:
    """Parse text such as ``robot:stall@3s+500ms``; amount, start and duration may be left out.

    Raises:
        ConfigError: Malformed, an unknown device or kind, or a kind the device cannot show.
    """
    match = _PLAN.match(text)
    if match is None:
        raise ConfigError(f"fault: {text!r} is not understood", remedy=_EXAMPLE)
    device_name, kind_name, amount, start, duration = match.groups()
    device, kind = _named(Device, "device", device_name), _named(FaultKind, "kind", kind_name)
    known = AMOUNTS.get((device, kind))
    dimension = Dimension.RATIO if known is None else known.dimension
    return Fault(
        device=device,
        kind=kind,
        start_s=_seconds(start) if start else 0.0,
        duration_s=_seconds(duration) if duration else math.inf,
        amount=parse_quantity(amount, dimension=dimension, field="fault") if amount else None,
    )


def written_faults(device: Device) -> str:
    """Return the kinds that ``device`` knows, as one writes them, with their usual amounts."""
    kinds = [kind for kind in FaultKind if kind in FAULTS_OF_DEVICE[device]]
    amounts = [AMOUNTS.get((device, kind)) for kind in kinds]
    return ", ".join(
        f"{kind}={amount.usual.replace(' ', '')}" if amount and amount.usual else kind.value
        for kind, amount in zip(kinds, amounts, strict=True)
    )


def _named(choices: type[ChoiceT], what: str, name: str) -> ChoiceT:
    if name not in set(choices):
        raise ConfigError(
            f"fault: {what} {name!r} is unknown", remedy=f"one of: {', '.join(choices)}"
        )
    return choices(name)


def _seconds(text: str) -> float:
    return parse_quantity(text, dimension=Dimension.TIME, field="fault")


class FaultyLine:
    """What leaves a device of the messages that it makes: late, damaged or not at all.

    Args:
        seed: Draws which messages are lost or damaged.
        damage: Returns a message as a bad cable leaves it.
    """

    def __init__(self, seed: int, damage: Callable[[bytes, random.Random], bytes]) -> None:
        self._random = random.Random(seed)  # noqa: S311 - faults, not secrets
        self._damage = damage
        self._waiting: deque[tuple[int, bytes]] = deque()

    def put(self, message: bytes, active: dict[FaultKind, Fault], *, due_ns: int) -> None:
        """Take a message that should leave at ``due_ns``."""
        if FaultKind.STALL in active or self._strikes(active.get(FaultKind.DROP)):
            return
        if self._strikes(active.get(FaultKind.GARBLE)):
            message = self._damage(message, self._random)
        if FaultKind.DELAY in active:
            due_ns += round(active[FaultKind.DELAY].size * 1e9)
        self._waiting.append((due_ns, message))

    @property
    def next_due_ns(self) -> int | None:
        """When the next waiting message leaves; None where none waits."""
        return self._waiting[0][0] if self._waiting else None

    def due(self, now_ns: int) -> list[bytes]:
        """Return the messages that leave by ``now_ns``, in order."""
        left = []
        while self._waiting and self._waiting[0][0] <= now_ns:
            left.append(self._waiting.popleft()[1])
        return left

    def _strikes(self, fault: Fault | None) -> bool:
        return fault is not None and self._random.random() < fault.size
