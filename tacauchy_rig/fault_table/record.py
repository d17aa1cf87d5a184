"""What was kept: messages that were acknowledged against messages that can be read."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tacauchy_rig.errors import RecordError
from tacauchy_rig.run import JournalEvent
from tacauchy_rig.store.layout import RunPaths
from tacauchy_rig.store.recording.reading import Recording

PRODUCERS = ("control", "camera")


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptMessages:
    """Messages of one session, by the process that produced them.

    Attributes:
        acknowledged: Messages that the recorder acknowledged.
        readable: Different messages that can be read, spills included.
        force_gap_count: Package numbers missing between the first and the last force sample.
        frame_gap_count: Frame numbers missing between the first and the last frame.
        unreadable: Files that cannot be read at all, and why.
    """

    acknowledged: dict[str, int]
    readable: dict[str, int]
    force_gap_count: int
    frame_gap_count: int
    unreadable: tuple[str, ...] = ()

    @property
    def lost_count(self) -> int:
        """Messages that were acknowledged and cannot be read."""
        return sum(
            max(0, count - self.readable.get(name, 0)) for name, count in self.acknowledged.items()
        )


def acknowledged_messages(events: Iterable[JournalEvent]) -> dict[str, int]:
    """Return how many messages of each producer the recorder acknowledged in one session.

    The recorder tells it at its end, the supervisor at the run's end; a fault may silence one of
    them, and the larger number counts.
    """
    counts = dict.fromkeys(PRODUCERS, 0)
    for event in events:
        if event.name in ("record-end", "run-end"):
            for name, count in event.detail.get("acknowledged", {}).items():
                counts[name] = max(counts.get(name, 0), int(count))
    return counts


def attempts_of(paths: RunPaths) -> list[tuple[int, int]]:
    """Return (trial, attempt) of every attempt that has a folder."""
    return [
        (trial, attempt)
        for trial in paths.trial_indices()
        for attempt in paths.attempt_indices(trial)
    ]


def kept_messages(
    paths: RunPaths, attempts: Sequence[tuple[int, int]], acknowledged: dict[str, int]
) -> KeptMessages:
    """Read everything that a session has left of its attempts."""
    control = camera = force_gaps = frame_gaps = 0
    unreadable: list[str] = []
    for trial, attempt in attempts:
        recordings = _open_all(
            [paths.recording(trial, attempt), *paths.spills(trial, attempt)], unreadable
        )
        force = {int(n) for recording in recordings for n in recording.force().counter}
        frames = {int(n) for recording in recordings for n in recording.frame_stamps()[1]}
        states = {int(n) for recording in recordings for n in recording.arm().stamp_ns}
        events = {(e.stamp_ns, e.name) for recording in recordings for e in recording.events()}
        control += len(force) + len(states) + len(events)
        camera += len(frames)
        force_gaps += _gaps(force)
        frame_gaps += _gaps(frames)
    return KeptMessages(
        acknowledged=acknowledged,
        readable={"control": control, "camera": camera},
        force_gap_count=force_gaps,
        frame_gap_count=frame_gaps,
        unreadable=tuple(unreadable),
    )


def _open_all(paths: Sequence[Path], unreadable: list[str]) -> list[Recording]:
    recordings = []
    for path in paths:
        if not path.exists():
            continue
        try:
            recordings.append(Recording.open(path))
        except RecordError as error:
            unreadable.append(str(error))
    return recordings


def _gaps(counters: set[int]) -> int:
    return max(counters) - min(counters) + 1 - len(counters) if counters else 0
