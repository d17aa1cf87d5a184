"""The stream of an emulated M8128-family box: numbering, faults, and the bytes due now."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Iterable, Mapping

from drivers.emulators.faults import Fault, FaultKind
from drivers.force_sensor.sri_frame import encode_frame
from tacauchy_rig.config.model import Checksum
from tacauchy_rig.run import Vector6

_DROP_FRACTION = 0.5
_GARBLE_FRACTION = 0.3
_DELAY_S = 0.2


class FrameStream:
    """Turn values into the bytes that leave the box, as faults allow.

    Faults take these parameters: ``drop`` and ``garble`` a ``fraction`` of the frames, ``delay``
    a ``delay_s`` [s], ``saturate`` a ``full_scale_n`` [N].

    Args:
        full_scale_n: What Fz reads when its channel is saturated [N].
        latency_s: From the moment that a frame belongs to until it leaves [s].

    Attributes:
        number: Package number of the newest frame, not wrapped; it advances in every fault.
    """

    def __init__(self, *, seed: int, full_scale_n: float, latency_s: float = 0.0) -> None:
        self._random = random.Random(seed)  # noqa: S311 - faults, not secrets
        self._full_scale_n = full_scale_n
        self._latency_s = latency_s
        self._held: Vector6 | None = None
        self._waiting: deque[tuple[int, bytes]] = deque()
        self.number = -1

    def next_frame(
        self, values: Vector6, *, stamp_ns: int, faults: Iterable[Fault], checksum: Checksum
    ) -> Vector6:
        """Queue the next frame and return the values that it carries."""
        self.number += 1
        active = {fault.kind: fault.parameters for fault in faults}
        if FaultKind.FREEZE in active:
            values = self._held = self._held or values
        else:
            self._held = None
        if FaultKind.SATURATE in active:
            full_scale_n = active[FaultKind.SATURATE].get("full_scale_n", self._full_scale_n)
            values = (values[0], values[1], full_scale_n, *values[3:])
        if FaultKind.STALL in active or self._chance(active, FaultKind.DROP, _DROP_FRACTION):
            return values
        data = encode_frame(self.number, values, checksum=checksum)
        if self._chance(active, FaultKind.GARBLE, _GARBLE_FRACTION):
            data = self._garble(data)
        delay_s = self._latency_s
        if FaultKind.DELAY in active:
            delay_s += active[FaultKind.DELAY].get("delay_s", _DELAY_S)
        self._waiting.append((stamp_ns + int(delay_s * 1e9), data))
        return values

    @property
    def next_due_ns(self) -> int | None:
        """When the next waiting frame leaves; None where none waits."""
        return self._waiting[0][0] if self._waiting else None

    def due(self, now_ns: int) -> bytes:
        """Return the bytes that leave the box by ``now_ns``, in order."""
        data = b""
        while self._waiting and self._waiting[0][0] <= now_ns:
            data += self._waiting.popleft()[1]
        return data

    def _chance(
        self, active: dict[FaultKind, Mapping[str, float]], kind: FaultKind, usual: float
    ) -> bool:
        return kind in active and self._random.random() < active[kind].get("fraction", usual)

    def _garble(self, data: bytes) -> bytes:
        damaged = bytearray(data)
        for _ in range(3):
            damaged[self._random.randrange(len(damaged))] ^= self._random.randrange(1, 256)
        return bytes(damaged)
