"""What an emulated camera's faults do to the frames on their way out."""

from __future__ import annotations

import random
from collections import deque

from drivers.emulators.faults import Fault, FaultKind

_DROP_SHARE = 0.3
_GARBLE_SHARE = 0.3
_DELAY_S = 0.5
_GARBLED_BYTES = 64


class FaultyOutput:
    """Turns the frame that should go out into the frames that do."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)  # noqa: S311 - damage, not a secret
        self._frozen: bytes | None = None
        self._late: deque[tuple[float, bytes]] = deque()

    def frames(self, jpeg: bytes, faults: list[Fault], *, now_s: float) -> list[bytes]:
        """Return what to send at ``now_s`` [s] in place of ``jpeg``, oldest first."""
        active = {fault.kind: fault for fault in faults}
        if FaultKind.FREEZE in active:
            self._frozen = jpeg = self._frozen or jpeg
        else:
            self._frozen = None
        if FaultKind.STALL in active or self._strikes(active.get(FaultKind.DROP), _DROP_SHARE):
            return []
        if self._strikes(active.get(FaultKind.GARBLE), _GARBLE_SHARE):
            jpeg = self._garbled(jpeg)
        delay = active.get(FaultKind.DELAY)
        delay_s = 0.0 if delay is None else delay.parameters.get("delay_s", _DELAY_S)
        due_s = max(now_s + delay_s, self._late[-1][0] if self._late else 0.0)
        self._late.append((due_s, jpeg))
        return [self._late.popleft()[1] for _ in range(sum(d <= now_s for d, _ in self._late))]

    def _strikes(self, fault: Fault | None, share: float) -> bool:
        return fault is not None and self._random.random() < fault.parameters.get("fraction", share)

    def _garbled(self, jpeg: bytes) -> bytes:
        """Overwrite bytes and cut the end off, as a bad cable does."""
        damaged = bytearray(jpeg[: self._random.randrange(len(jpeg) // 2, len(jpeg))])
        for _ in range(_GARBLED_BYTES):
            damaged[self._random.randrange(len(damaged) // 4, len(damaged))] ^= 0x5A
        return bytes(damaged)
