"""What the page shows of a run, put together from feeds and events."""

from __future__ import annotations

import shutil
import time
from collections import deque
from contextlib import suppress
from dataclasses import asdict
from typing import Any

from protocols.processes.child_process import AFTERWARDS, CONTROL_ENDED
from protocols.processes.ipc import Job, Shown
from protocols.trials.time_left import TimeLeft
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import JournalEvent, Phase, TrialRecord
from tacauchy_rig.core.store.journal import Journal
from tacauchy_rig.core.store.run_files import read_bytes
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.store.trusted_force import ForceSeries, force_series

TRACE_SAMPLES = 6000
JOURNAL_LINES = 12
DISK_S = 2.0
_NOT_SHOWN = ("progress", "page")
_EACH_SAMPLE = ("stamp_ns", "counter")


class View:
    """Everything that a browser is told; what it was told before a restart is read from the run.

    Its ``version`` changes with what changes seldom: phase, trials, journal, checks.
    """

    def __init__(self, job: Job) -> None:
        self.version = 0
        self.dropped_count = 0
        self.ended = False
        self._job = job
        self._store = RunStore.open(job.root)
        self._streams: dict[str, StreamView] = {}
        self._trace: deque[tuple[int, float]] = deque(maxlen=TRACE_SAMPLES)
        self._traced = 0
        self._journal: deque[JournalEvent] = deque(maxlen=JOURNAL_LINES)
        self._phase = ""
        self._trial = self._attempt = 0
        self._running = (0, 0)  # trial and attempt that are pressed now
        self._target_n: float | None = None
        self._outcome = self._reason = ""
        self._afterwards: dict[str, Any] = {}
        self._pictures: dict[str, bytes] = {}
        self._left = TimeLeft(job.config, job.plan, job.expected)
        self._doubts = ForceSeries()
        self._disk: tuple[float, dict[str, int]] = (0.0, {})
        if job.again:
            self._catch_up()

    def take(self, shown: Shown) -> None:
        """Take in what a feed shows."""
        stream = self._streams.setdefault(shown.stream, StreamView())
        numbers = shown.numbers
        stream.numbers = numbers
        counters = numbers.get("counter", ())
        each = tuple(counters) if isinstance(counters, list) else (counters,)
        count = len(numbers["stamp_ns"]) if "stamp_ns" in numbers else numbers.get("count", 1)
        stream.take(shown.stamp_ns, count=count, counters=each if counters != () else ())
        if shown.stream == "force" and numbers["is_tared"]:
            self._trace.extend(zip(numbers["stamp_ns"], numbers["force_n"], strict=True))
            self._traced += count
        if shown.picture is not None:
            self._keep(shown.stream, stream, shown.picture)

    def _keep(self, name: str, stream: StreamView, picture: bytes) -> None:
        stream.picture = picture
        if name != "camera":
            return
        if self._phase == Phase.REFERENCE:
            self._pictures["reference"] = picture
        elif self._phase == Phase.DWELL:
            self._pictures[f"trial-{self._trial}"] = picture

    def note(self, event: JournalEvent) -> None:
        """Take in an event."""
        self._left.note(event)
        is_fault = event.name == "progress" and event.detail.get("phase") == Phase.FAULT
        if is_fault and self._phase != Phase.FAULT:
            self._phase = Phase.FAULT  # of which no event tells before it is over
            self.version += 1
        if event.name in _NOT_SHOWN:
            return
        self.version += 1
        if event.name == AFTERWARDS:
            self._afterwards = event.detail
            return
        if event.name == CONTROL_ENDED:
            self._running = 0, 0
            self._phase = "stopped" if self._phase == "stopped" else "closing"
            return
        self._journal.append(event)
        if event.trial:
            self._trial, self._attempt = event.trial, event.attempt
        match event.name:
            case "run-start":
                self.ended, self._phase, self._outcome, self._reason = False, "", "", ""
            case "phase":
                self._phase = str(event.detail.get("phase", ""))
            case "attempt-start":
                self._target_n = event.detail["force_target_n"]
                self._outcome = self._reason = ""
                self._running = event.trial, event.attempt
            case "attempt-end":
                self._running = 0, 0
            case "fault" | "abort":  # written once the arm is safe
                self._phase, self._reason = "stopped", str(event.detail.get("reason", ""))
            case "run-end":
                with suppress(RecordError):
                    self._doubts = force_series(self._store)
                self.ended, self._phase = True, "ended"
                self._outcome = str(event.detail["outcome"])
                self._reason = str(event.detail["reason"])

    def check_disk(self) -> None:
        """Look now and then how much room there is; results may have come, too."""
        now_s = time.monotonic()
        if now_s - self._disk[0] > DISK_S:
            usage = shutil.disk_usage(self._job.root)
            self._disk = now_s, {"free_bytes": usage.free}
            self.version += 1

    def setup(self) -> dict[str, Any]:
        """Return what does not change during a run."""
        config = self._job.config
        return {
            "run": self._job.root.name,
            "simulated": self._store.simulated,
            "sensor": config.sensor.name,
            "targets_n": list(config.protocol.force_targets),
            "tolerance_n": config.protocol.force_tolerance,
            "soft_force_n": config.limits.soft_force,
            "hard_force_n": config.limits.hard_force,
            "stale_s": {
                "force": max(0.4, config.limits.stale_force),
                "arm": max(0.4, config.limits.stale_robot),
                "camera": min(0.6, max(0.4, config.limits.stale_image)),
            },
            "outline": self._job.options.get("outline"),
        }

    def run(self) -> dict[str, Any]:
        """Return what changes now and then."""
        return {
            "phase": self._phase,
            "trial": self._trial,
            "attempt": self._attempt,
            "target_n": self._target_n,
            "ended": self.ended,
            "outcome": self._outcome,
            "reason": self._reason,
            "afterwards": self._afterwards,
            "trials": [self._trial_row(planned.index) for planned in self._job.plan],
            "journal": [
                {name: getattr(event, name) for name in ("name", "trial", "detail")}
                | {"stamp_s": event.stamp_ns * 1e-9}
                for event in self._journal
            ],
            "disk": self._disk[1],
            "has_reference": "reference" in self._pictures,
        }

    def live(self, drawn: int) -> tuple[dict[str, Any], int]:
        """Return what changes all the time, with the force since sample ``drawn``; and how far."""
        now_ns = time.monotonic_ns()
        fresh = min(self._traced - drawn, len(self._trace))
        newest = list(self._trace)[len(self._trace) - fresh :] if fresh else []
        live = {
            "now_s": now_ns * 1e-9,
            "left_s": self._left.seconds(now_ns),
            "dropped": self.dropped_count,
            "from_start": drawn == 0,
            "trace": [(round(stamp * 1e-9, 3), round(force, 4)) for stamp, force in newest],
            "streams": {
                name: {
                    **stream.summary(now_ns),
                    "picture": stream.newest_ns if stream.picture is not None else None,
                    "numbers": {k: v for k, v in stream.numbers.items() if k not in _EACH_SAMPLE},
                }
                for name, stream in self._streams.items()
            },
        }
        return live, self._traced

    def picture(self, name: str) -> bytes | None:
        """Return a stream's newest picture, ``reference``, or that of a ``trial-1``."""
        if name in self._streams:
            return self._streams[name].picture
        for planned in self._job.plan:
            if name == f"trial-{planned.index}" and name not in self._pictures:
                self._recall(name, planned.index)
        return self._pictures.get(name)

    @property
    def is_reported(self) -> bool:
        """Whether a report of this session's run was written."""
        return self._afterwards.get("state") == "reported"

    def report(self) -> bytes | None:
        """Return the report's page; None before it is written."""
        if self.is_reported:
            with suppress(RecordError):
                return read_bytes(self._store.paths.report / "report.html", what="report")
        return None

    def _recorded(self, index: int) -> TrialRecord | None:
        """Return the last result of a trial; of one that is pressed again, none until it ends."""
        record = self._store.latest(index)
        is_on = index == self._running[0]
        return None if record is None or (is_on and record.attempt != self._running[1]) else record

    def _recall(self, name: str, index: int) -> None:
        """Take the last frame of the dwell of a trial of an earlier session from its recording."""
        record = self._recorded(index)
        if record is None or record.dwell_end_ns is None:
            return
        with suppress(RecordError):
            recording = self._store.recording(index, record.attempt)
            stamps = recording.frame_stamps()[0]
            held = stamps[stamps <= record.dwell_end_ns]
            for frame in recording.frames(int(held[-1]), int(held[-1])) if len(held) else ():
                self._pictures[name] = frame.jpeg

    def _trial_row(self, index: int) -> dict[str, Any]:
        record = self._recorded(index)
        held = record is not None and record.dwell_end_ns is not None
        row: dict[str, Any] = {
            "index": index,
            "target_n": self._job.config.protocol.force_targets[index - 1],
            "has_picture": held or f"trial-{index}" in self._pictures,
        }
        if record is not None:
            doubt = self._doubts.criterion(index, record.attempt)
            record = record if doubt is None else record.doubted(doubt)
            row |= {
                "attempt": record.attempt,
                "outcome": record.outcome.value,
                "force_n": record.force_measured_n,
                "depth_m": record.depth_measured_m,
                "reason": record.reason,
                "checks": [asdict(criterion) for criterion in record.criteria],
            }
        return row

    def _catch_up(self) -> None:
        known: list[JournalEvent] = []
        with suppress(RecordError):
            known = Journal.read(self._store.paths.journal).events
        begun = [place for place, event in enumerate(known) if event.name == "run-start"]
        for event in known[begun[-1] :] if begun else []:
            self.note(event)


WINDOW_NS = 2_000_000_000


class StreamView:
    """Counts what arrives of one stream, and keeps the newest of it."""

    def __init__(self) -> None:
        self.numbers: dict[str, Any] = {}
        self.picture: bytes | None = None
        self.newest_ns = 0
        self.lost_count = 0  # samples that their counter says were never seen
        self._counter: int | None = None
        self._arrivals: deque[tuple[int, int]] = deque()

    def take(self, stamp_ns: int, *, count: int = 1, counters: tuple[int, ...] = ()) -> None:
        """Take in ``count`` samples, the newest of them stamped ``stamp_ns``."""
        self.newest_ns = stamp_ns
        self._arrivals.append((stamp_ns, count))
        while stamp_ns - self._arrivals[0][0] > WINDOW_NS:
            self._arrivals.popleft()
        for counter in counters:
            if self._counter is not None and counter > self._counter:
                self.lost_count += counter - self._counter - 1
            self._counter = counter

    def summary(self, now_ns: int) -> dict[str, float | None]:
        """Return rate [Hz], losses and age [s]."""
        return {
            "rate_hz": round(self._rate_hz(), 1),
            "lost": self.lost_count,
            "age_s": round((now_ns - self.newest_ns) * 1e-9, 3) if self.newest_ns else None,
        }

    def _rate_hz(self) -> float:
        recent = [one for one in self._arrivals if time.monotonic_ns() - one[0] < WINDOW_NS]
        if len(recent) < 2:
            return 0.0
        span_s = (recent[-1][0] - recent[0][0]) * 1e-9
        return sum(count for _, count in recent[1:]) / span_s if span_s > 0.0 else 0.0
