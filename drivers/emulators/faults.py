"""Faults that a stand-in for a device can show, and how they are written.

A fault is written ``device:kind[=amount][@start][+duration]``, for example
``force_sensor:freeze@12s+2s`` or ``force_sensor:scale=0.1@3s``.
"""

import functools
import itertools
import math
import random
import re
import statistics
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, TypeVar

from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import Dimension, parse_quantity
from tacauchy_rig.core.run import FZ, Vector6, vector6


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
TimeT = TypeVar("TimeT", int, float)

STOPS = frozenset({FaultKind.PROTECTIVE_STOP, FaultKind.EMERGENCY_STOP})
SILENT_FORCE_FAULTS = frozenset(
    map(FaultKind, ("scale", "stick", "stick-noisily", "sign", "swap-axes", "old-data"))
)


class Amount(NamedTuple):
    """How much of a fault there can be."""

    dimension: Dimension
    usual: str  # as one writes it; empty where the device decides
    least: float  # smallest possible [SI unit]
    most: float  # largest possible [SI unit]


OLDEST_S = 60.0  # nothing older than this is sent again [s]
_LONGEST_LOOP = 100.0

_ROBOT = {*STOPS, FaultKind.FREEZE, FaultKind.DROP, FaultKind.STALL, FaultKind.UNLOCK}
_SENSOR = {FaultKind.FREEZE, FaultKind.UNPLUG, FaultKind.STALL, *SILENT_FORCE_FAULTS}
_CAMERA = {FaultKind.UNPLUG, FaultKind.SATURATE, FaultKind.STALL, FaultKind.FREEZE_IMAGE}
FAULTS_OF_DEVICE: dict[Device, dict[FaultKind, Amount | None]] = {
    Device.ROBOT: dict.fromkeys(_ROBOT)
    | {
        FaultKind.DELAY: Amount(Dimension.TIME, "200 ms", 0.0, OLDEST_S),
        FaultKind.WRONG_POSE: Amount(Dimension.SPEED, "0.1 mm/s", -0.1, 0.1),
        FaultKind.CLOCK_JUMP: Amount(Dimension.TIME, "10 s", -86400.0, 86400.0),
    },
    Device.FORCE_SENSOR: dict.fromkeys(_SENSOR)
    | {
        FaultKind.DROP: Amount(Dimension.RATIO, "50 %", 0.0, 1.0),
        FaultKind.GARBLE: Amount(Dimension.RATIO, "30 %", 0.0, 1.0),
        FaultKind.DELAY: Amount(Dimension.TIME, "200 ms", 0.0, OLDEST_S),
        FaultKind.SATURATE: Amount(Dimension.FORCE, "", -1e6, 1e6),
        FaultKind.SCALE: Amount(Dimension.RATIO, "0.5", -1e3, 1e3),
        FaultKind.OLD_DATA: Amount(Dimension.TIME, "3 s", 0.0, OLDEST_S),
    },
    Device.CAMERA: dict.fromkeys(_CAMERA)
    | {
        FaultKind.DROP: Amount(Dimension.RATIO, "30 %", 0.0, 1.0),
        FaultKind.GARBLE: Amount(Dimension.RATIO, "30 %", 0.0, 1.0),
        FaultKind.DELAY: Amount(Dimension.TIME, "500 ms", 0.0, OLDEST_S),
        FaultKind.REPEAT_IMAGE: Amount(Dimension.RATIO, "5", 2.0, _LONGEST_LOOP),
    },
}
"""The kinds that each device knows, with their amounts; None is a kind without."""

_PLAN = re.compile(r"^\s*([^:@+=\s]+):([^:@+=\s]+)(?:=([^@+]+))?(?:@([^@+]+))?(?:\+([^@+]+))?\s*$")
_EXAMPLE = (
    "write device:kind=amount@start+duration, for example force_sensor:freeze@12s+2s or "
    "force_sensor:scale=0.1@3s"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One thing that goes wrong with one device."""

    device: Device
    kind: FaultKind
    # How long it lasts [s]; infinite for ever. At the end of a stop or an unplugging somebody has
    # unlocked the arm or plugged the device in again.
    duration_s: float = math.inf
    start_s: float = 0.0  # when it begins, after the emulator is told of it [s]; 0 is at once
    amount: float | None = None  # how much of it [SI unit]; the usual one if None

    def __post_init__(self) -> None:
        name, known = f"fault {self.device}:{self.kind}", FAULTS_OF_DEVICE[self.device]
        if self.kind not in known:
            raise ConfigError(
                f"fault: a {self.device} cannot {self.kind}",
                remedy=f"{self.device} knows: {', '.join(sorted(known))}",
            )
        if not (self.duration_s > 0.0 and 0.0 <= self.start_s < math.inf):
            raise ConfigError(
                f"{name}: start {self.start_s} s and duration {self.duration_s} s are impossible",
                remedy="give a start of 0 s or later and a duration above 0 s",
            )
        if self.amount is None:
            return
        possible = known[self.kind]
        if possible is None:
            raise ConfigError(f"{name} takes no amount", remedy="leave out = and what follows it")
        if not possible.least <= self.amount <= possible.most:
            raise ConfigError(
                f"{name}: {self.amount:g} is not from {possible.least:g} to {possible.most:g} "
                "[SI unit]",
                remedy=f"for example {self.kind}={possible.usual}",
            )

    @property
    def size(self) -> float:
        """How much of it [SI unit], as asked or as usual; NaN where only the device knows."""
        if self.amount is not None:
            return self.amount
        possible = FAULTS_OF_DEVICE[self.device][self.kind]
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
    known = FAULTS_OF_DEVICE[device].get(kind)
    dimension = known.dimension if known else Dimension.RATIO
    parsed = functools.partial(parse_quantity, field="fault")
    return Fault(
        device=device,
        kind=kind,
        start_s=parsed(start, dimension=Dimension.TIME) if start else 0.0,
        duration_s=parsed(duration, dimension=Dimension.TIME) if duration else math.inf,
        amount=parsed(amount, dimension=dimension) if amount else None,
    )


def written_faults(device: Device) -> str:
    """Return the kinds that ``device`` knows, as one writes them, with their usual amounts."""
    amounts = FAULTS_OF_DEVICE[device]
    return ", ".join(
        f"{kind}={amount.usual.replace(' ', '')}"
        if (amount := amounts[kind]) and amount.usual
        else kind.value
        for kind in FaultKind
        if kind in amounts
    )


def _named(choices: type[ChoiceT], what: str, name: str) -> ChoiceT:
    if name not in set(choices):
        raise ConfigError(
            f"fault: {what} {name!r} is unknown", remedy=f"one of: {', '.join(choices)}"
        )
    return choices(name)


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
        return take_due(self._waiting, now_ns)

    def _strikes(self, fault: Fault | None) -> bool:
        return fault is not None and self._random.random() < fault.size


def take_due(waiting: deque[tuple[TimeT, bytes]], now: TimeT) -> list[bytes]:
    """Take out what is due, in order: nothing overtakes what was delayed longer."""
    found = []
    while waiting and waiting[0][0] <= now:
        found.append(waiting.popleft()[1])
    return found


# What a device says instead of what it sees, while nothing about its stream looks wrong.

_FX = 0
_LAST_DIGIT = 1e-4  # of a force [N] and a moment [N m] as the box writes them
_NOISE_SAMPLES = 100  # that a sensor which sticks noisily takes its mean's noise from
_MEAN_SAMPLES = 10  # that it takes its mean from: few, or the mean would be an old one


class SilentWrenchFaults:
    """What a force sensor reads, sample by sample."""

    def __init__(self, *, seed: int, full_scale_n: float) -> None:
        self._random = random.Random(seed)  # noqa: S311 - noise, not a secret
        self._full_scale_n = full_scale_n
        self._past: deque[tuple[int, Vector6]] = deque()
        self._reported: deque[Vector6] = deque(maxlen=_NOISE_SAMPLES)
        # Of each axis of a sensor that sticks: newest value, mean and noise.
        self._held: list[tuple[float, float, float]] = []
        self._count = 0

    def reading(self, true: Vector6, faults: Iterable[Fault], *, stamp_ns: int) -> Vector6:
        """Return Fx, Fy, Fz [N], Mx, My, Mz [N m] as ``faults`` make them of what is true."""
        self._count += 1
        active = {fault.kind: fault for fault in faults}
        self._past.append((stamp_ns, true))
        while stamp_ns - self._past[0][0] > OLDEST_S * 1e9:
            self._past.popleft()
        sticks = active.keys() & {FaultKind.FREEZE, FaultKind.STICK, FaultKind.STICK_NOISILY}
        # It is too early to stick noisily while its noise is not known yet.
        is_early = FaultKind.STICK_NOISILY in sticks and len(self._reported) < _NOISE_SAMPLES
        if not sticks or is_early or not self._held:
            self._reported.append(self._changed(true, active, stamp_ns))
            self._held = []
        if not sticks or is_early:
            return self._reported[-1]
        self._held = self._held or [_held(axis) for axis in zip(*self._reported, strict=True)]
        if sticks == {FaultKind.STICK_NOISILY}:
            return vector6(self._random.gauss(mean, noise) for _, mean, noise in self._held)
        digit = 0.0 if FaultKind.FREEZE in sticks else _LAST_DIGIT * (self._count % 2)
        return vector6(newest + digit for newest, _, _ in self._held)

    def _changed(self, true: Vector6, active: dict[FaultKind, Fault], stamp_ns: int) -> Vector6:
        values = list(true)
        if FaultKind.OLD_DATA in active:  # or the oldest that is known
            then_ns = stamp_ns - round(active[FaultKind.OLD_DATA].size * 1e9)
            known = (past for stamp, past in reversed(self._past) if stamp <= then_ns)
            values = list(next(known, self._past[0][1]))
        factor = active[FaultKind.SCALE].size if FaultKind.SCALE in active else 1.0
        factor = -factor if FaultKind.SIGN in active else factor
        values = [factor * value for value in values]
        if FaultKind.SWAP_AXES in active:
            for x, z in ((_FX, FZ), (_FX + 3, FZ + 3)):
                values[x], values[z] = values[z], values[x]
        if FaultKind.SATURATE in active:
            asked = active[FaultKind.SATURATE].amount
            values[FZ] = self._full_scale_n if asked is None else asked
        return vector6(values)


def _held(axis: Sequence[float]) -> tuple[float, float, float]:
    """Return newest value, mean and noise; the noise from neighbours: a slow rise is none."""
    steps = [(after - before) ** 2 for before, after in itertools.pairwise(axis)]
    noise = math.sqrt(0.5 * sum(steps) / max(len(steps), 1))
    return axis[-1], statistics.fmean(axis[-_MEAN_SAMPLES:]), noise


class SilentImageFaults:
    """What a camera shows, frame by frame."""

    def __init__(self) -> None:
        self._loop: list[bytes] = []
        self._next = 0

    def frame(self, jpeg: bytes, faults: Iterable[Fault]) -> bytes:
        """Return the frame that goes out in place of ``jpeg``: itself, or one of before."""
        lengths = [
            1 if fault.kind is FaultKind.FREEZE_IMAGE else round(fault.size)
            for fault in faults
            if fault.kind in (FaultKind.FREEZE_IMAGE, FaultKind.REPEAT_IMAGE)
        ]
        if not lengths:
            self._loop, self._next = [], 0
            return jpeg
        if len(self._loop) < min(lengths):
            self._loop.append(jpeg)
        shown = self._loop[self._next % len(self._loop)]
        self._next += 1
        return shown


class SilentArmFaults:
    """By how much an arm's state is off, state by state."""

    def __init__(self) -> None:
        self.height_m = 0.0  # height that it reports above its true one [m]
        self.clock_s = 0.0  # how far its clock is ahead [s]

    def advance(self, faults: Iterable[Fault], velocity: Vector6, *, duration_s: float) -> None:
        """Let time pass under ``faults``; without them it is right at once.

        Args:
            velocity: Of the tool [m/s, rad/s]: what slips in an arm slips while it moves.
        """
        active = {fault.kind: fault for fault in faults}
        wrong_pose, jump = active.get(FaultKind.WRONG_POSE), active.get(FaultKind.CLOCK_JUMP)
        if wrong_pose is None:
            self.height_m = 0.0
        elif any(velocity):
            self.height_m += wrong_pose.size * duration_s
        self.clock_s = jump.size if jump else 0.0
