"""What a device says instead of what it sees, while nothing about its stream looks wrong.

The counters advance, the stamps are new.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Iterable

import numpy as np

from drivers.emulators.faults import OLDEST_S, Fault, FaultKind
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.run import FZ, Vector6, vector6

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
        self._held: tuple[Vector6, FloatArray, FloatArray] | None = None  # newest, mean and noise
        self._count = 0

    def reading(self, true: Vector6, faults: Iterable[Fault], *, stamp_ns: int) -> Vector6:
        """Return Fx, Fy, Fz [N], Mx, My, Mz [N m] as ``faults`` make them of what is true."""
        self._count += 1
        active = {fault.kind: fault for fault in faults}
        self._past.append((stamp_ns, true))
        while stamp_ns - self._past[0][0] > OLDEST_S * 1e9:
            self._past.popleft()
        reported = self._changed(true, active, stamp_ns)
        sticks = active.keys() & {FaultKind.FREEZE, FaultKind.STICK, FaultKind.STICK_NOISILY}
        if not sticks:
            self._held = None
        # It is too early to stick noisily while its noise is not known yet.
        is_early = FaultKind.STICK_NOISILY in sticks and len(self._reported) < _NOISE_SAMPLES
        if not sticks or is_early:
            self._reported.append(reported)
            return reported
        if self._held is None:
            self._reported.append(reported)
            before = np.array(self._reported)
            # From neighbours: a slow rise is no noise.
            steps = np.diff(before, axis=0)
            noise = np.sqrt(0.5 * np.sum(steps**2, axis=0) / max(len(steps), 1))
            self._held = (reported, before[-_MEAN_SAMPLES:].mean(axis=0), noise)
        return self._stuck(FaultKind(min(sticks)), *self._held)

    def _changed(self, true: Vector6, active: dict[FaultKind, Fault], stamp_ns: int) -> Vector6:
        if not active:
            return true
        values = list(true)
        if FaultKind.OLD_DATA in active:
            values = list(self._at(stamp_ns - round(active[FaultKind.OLD_DATA].size * 1e9)))
        factor = active[FaultKind.SCALE].size if FaultKind.SCALE in active else 1.0
        if FaultKind.SIGN in active:
            factor = -factor
        values = [factor * value for value in values]
        if FaultKind.SWAP_AXES in active:
            for x, z in ((_FX, FZ), (_FX + 3, FZ + 3)):
                values[x], values[z] = values[z], values[x]
        if FaultKind.SATURATE in active:
            asked = active[FaultKind.SATURATE].amount
            values[FZ] = self._full_scale_n if asked is None else asked
        return vector6(values)

    def _at(self, stamp_ns: int) -> Vector6:
        """Return what was true then, or the oldest that is known."""
        known = [values for stamp, values in self._past if stamp <= stamp_ns]
        return known[-1] if known else self._past[0][1]

    def _stuck(
        self, kind: FaultKind, newest: Vector6, mean: FloatArray, noise: FloatArray
    ) -> Vector6:
        if kind is FaultKind.FREEZE:
            return newest
        if kind is FaultKind.STICK:
            digit = _LAST_DIGIT * (self._count % 2)
            return vector6(value + digit for value in newest)
        noisy = zip(mean.tolist(), noise.tolist(), strict=True)
        return vector6(value + self._random.gauss(0.0, sigma) for value, sigma in noisy)


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
