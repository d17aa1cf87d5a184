"""What the control loop hands over to be kept, entry by entry, and where it hands it to."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from drivers.interfaces import Clock, FrameMark, StreamHealth
from tacauchy_rig.core import run
from tacauchy_rig.core.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Begin:
    """An attempt begins."""

    trial: int
    attempt: int


@dataclass(frozen=True, slots=True)
class End:
    """An attempt ended; frames up to ``stamp_ns`` belong to it."""

    record: run.TrialRecord
    stamp_ns: int


Samples = tuple[run.ForceSample | run.ArmSample | run.ImageFrame, ...]
Entry = Begin | Samples | run.JournalEvent | End
"""What a producer records; samples of one entry are of one kind."""


class Sink(Protocol):
    """Takes the record of a run, in order; it never blocks, raises or loses in silence."""

    def put(self, entry: Entry) -> None:
        """Take an entry."""

    def problem(self) -> str:
        """Return why nothing more can be kept, or an empty text."""

    def lag_s(self) -> float:
        """Return for how long the oldest entry has been on its way to the disk [s]."""


PROGRESS = "progress"
"""Name of events that are shown and not kept."""


class Journal:
    """Writes events of the attempt that runs now; between trials its number is 0."""

    def __init__(
        self, sink: Sink, clock: Clock, *, listener: Callable[[run.JournalEvent], object]
    ) -> None:
        self.trial = 0
        self.attempt = 0
        self.phase = run.Phase.PREFLIGHT
        self._sink = sink
        self._clock = clock
        self._listener = listener

    def enter(self, phase: run.Phase, **detail: Any) -> None:
        """Note that a phase begins; units in the names of ``detail``."""
        self.phase = phase
        self.write("phase", phase=phase.value, **detail)

    def write(self, name: str, **detail: Any) -> None:
        """Keep and show an event."""
        event = self._event(name, detail)
        self._sink.put(event)
        self._listener(event)

    def show(self, **detail: Any) -> None:
        """Show progress without keeping it."""
        self._listener(self._event(PROGRESS, {"phase": self.phase.value, **detail}))

    def _event(self, name: str, detail: dict[str, Any]) -> run.JournalEvent:
        return run.JournalEvent(
            stamp_ns=self._clock.now_ns(),
            name=name,
            trial=self.trial,
            attempt=self.attempt,
            detail=detail,
        )


class RateMeter:
    """Counts what arrives; ``report`` says how well."""

    def __init__(self) -> None:
        self._force: list[run.ForceSample] = []
        self._frames: list[FrameMark] = []
        self._turns_s: list[float] = []
        self._arm_count = 0
        self._frames_lost: list[int] = []
        self._clipped_ratio = 0.0
        self._record_lag_s = 0.0
        self._force_lag_s = 0.0

    def force(self, samples: Sequence[run.ForceSample], *, lag_s: float) -> None:
        """Count force samples that arrived ``lag_s`` [s] late, against the undelayed stream."""
        self._force += samples
        self._force_lag_s = max(self._force_lag_s, lag_s)

    def frames(self, marks: Sequence[FrameMark], health: StreamHealth) -> None:
        """Count camera frames, and those that the driver dropped; note what was at full scale."""
        self._frames += marks
        self._frames_lost[1:] = [health.lost_count]  # the first and the last
        self._clipped_ratio = max(self._clipped_ratio, health.clipped_ratio)

    def arm(self, count: int) -> None:
        """Count arm states."""
        self._arm_count += count

    def record_lag(self, lag_s: float) -> None:
        """Note how far the disk is behind [s]."""
        self._record_lag_s = max(self._record_lag_s, lag_s)

    def turn(self, duration_s: float) -> None:
        """Note how long a turn of the control loop took [s]."""
        self._turns_s.append(duration_s)

    def frame_count(self, start_ns: int, end_ns: int) -> int:
        """Return how many frames arrived within a window."""
        return sum(start_ns <= mark.stamp_ns <= end_ns for mark in self._frames)

    def repeated_frame_count(self, before: tuple[int, int], window: tuple[int, int]) -> int:
        """Return how many frames of a window are, byte by byte, another of it or one of before.

        Windows are the first and the last stamp [ns].
        """
        start_ns, end_ns = before
        known = {mark.digest for mark in self._frames if start_ns <= mark.stamp_ns <= end_ns}
        start_ns, end_ns = window
        shown = [mark.digest for mark in self._frames if start_ns <= mark.stamp_ns <= end_ns]
        often = Counter(shown)
        return sum(digest in known or often[digest] > 1 for digest in shown)

    def report(self) -> dict[str, float]:
        """Return the numbers of ``TrialRecord.rates``; units are in the keys."""
        turns_ms = np.array(self._turns_s or [0.0]) * 1e3
        span_s = float(np.sum(turns_ms)) * 1e-3
        dropped = self._frames_lost or [0]
        return {
            **_stream("force", self._force),
            **_stream("image", self._frames, dropped_count=dropped[-1] - dropped[0]),
            "image_clipped_ratio": self._clipped_ratio,
            "arm_rate_hz": self._arm_count / span_s if span_s > 0.0 else 0.0,
            "force_lag_max_ms": self._force_lag_s * 1e3,
            "record_lag_max_ms": self._record_lag_s * 1e3,
            "control_loop_ms_p50": float(np.percentile(turns_ms, 50)),
            "control_loop_ms_p99": float(np.percentile(turns_ms, 99)),
            "control_loop_ms_max": float(np.max(turns_ms)),
        }


def lateness_ms(stamps_ns: Sequence[int], counters: Sequence[int]) -> FloatArray:
    """Return how much later than the promptest each sample arrived, shape [n] [ms].

    The device's clock is the straight line through stamps over counters; what all samples share
    (exposure, transfer) cannot be seen from here and is not in these numbers.
    """
    if len(stamps_ns) < 2:
        return np.zeros(len(stamps_ns))
    elapsed_ms = (np.array(stamps_ns, dtype=np.int64) - stamps_ns[0]) * 1e-6
    counted = np.array(counters, dtype=np.float64) - counters[0]
    clock = np.polynomial.Polynomial.fit(counted, elapsed_ms, 1)
    late = elapsed_ms - clock(counted)
    return np.asarray(late - late.min())


def _stream(
    name: str, arrived: Sequence[run.ForceSample | FrameMark], *, dropped_count: int = 0
) -> dict[str, float]:
    stamps_ns = [one.stamp_ns for one in arrived]
    counters = [one.counter for one in arrived]
    missing_count = counters[-1] - counters[0] + 1 - len(counters) if counters else 0
    late_ms = lateness_ms(stamps_ns, counters)
    late_ms = late_ms if len(late_ms) else np.zeros(1)
    gaps_ms = np.diff(np.array(stamps_ns, dtype=np.int64)) * 1e-6
    span_s = float(np.sum(gaps_ms)) * 1e-3
    return {
        f"{name}_count": float(len(stamps_ns)),
        f"{name}_rate_hz": len(gaps_ms) / span_s if span_s > 0.0 else 0.0,
        f"{name}_gap_max_ms": float(np.max(gaps_ms)) if len(gaps_ms) else 0.0,
        f"{name}_latency_ms_p50": float(np.percentile(late_ms, 50)),
        f"{name}_latency_ms_p99": float(np.percentile(late_ms, 99)),
        f"{name}_latency_ms_max": float(np.max(late_ms)),
        f"{name}_lost_count": float(missing_count + dropped_count),
    }
