"""Faults that a stand-in for a device can show, and how they are written.

A fault is written ``device:kind[@start][+duration]``, for example ``force_sensor:freeze@12s+2s``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TypeVar

from tacauchy_rig.errors import ConfigError
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


ChoiceT = TypeVar("ChoiceT", bound=StrEnum)

_STOPS = frozenset({FaultKind.PROTECTIVE_STOP, FaultKind.EMERGENCY_STOP})

FAULTS_OF_DEVICE: dict[Device, frozenset[FaultKind]] = {
    Device.ROBOT: frozenset(FaultKind) - {FaultKind.GARBLE, FaultKind.UNPLUG, FaultKind.SATURATE},
    Device.FORCE_SENSOR: frozenset(FaultKind) - _STOPS,
    Device.CAMERA: frozenset(FaultKind) - _STOPS,
}

_PLAN = re.compile(r"^\s*([^:@+\s]+):([^:@+\s]+)(?:@([^@+]+))?(?:\+([^@+]+))?\s*$")
_EXAMPLE = "write device:kind@start+duration, for example force_sensor:freeze@12s+2s"


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
        device=_named(Device, "device", device),
        kind=_named(FaultKind, "kind", kind),
        start_s=_seconds(start) if start else 0.0,
        duration_s=_seconds(duration) if duration else math.inf,
    )


def _named(choices: type[ChoiceT], what: str, name: str) -> ChoiceT:
    if name not in set(choices):
        raise ConfigError(
            f"fault: {what} {name!r} is unknown", remedy=f"one of: {', '.join(choices)}"
        )
    return choices(name)


def _seconds(text: str) -> float:
    return parse_quantity(text, dimension=Dimension.TIME, field="fault")
