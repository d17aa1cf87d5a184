"""What a killed program leaves behind: recordings are repaired, the journal is completed."""

from __future__ import annotations

import fcntl
import heapq
import logging
import os
import shutil
from collections import ChainMap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.check.files import JournalReading
from tacauchy_rig.core.store.check.run import RunCheck, check_run
from tacauchy_rig.core.store.durable import file_sha256, read_error, sync_folder, write_error
from tacauchy_rig.core.store.journal import StoreEvent, log_hashes
from tacauchy_rig.core.store.layout import RECORDING_NAME, SPILL_PATTERN, RunPaths
from tacauchy_rig.core.store.recording.messages import RawMessage
from tacauchy_rig.core.store.recording.reading import Recording
from tacauchy_rig.core.store.recording.writing import RecordingWriter
from tacauchy_rig.core.store.run_store import RunStore

_CHUNK_SIZE = 4 << 20  # [bytes] of a finished file, which nobody kills while it is written

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecoveryReport:
    """What became of one recording.

    Attributes:
        changed: The file was repacked; False for one that needed nothing.
        before: What state it was in, in words.
        message_count: Messages that are readable now.
        merged_count: Of these, those that came from spills (``unacknowledged-*.mcap``).
        original: Where the file as it was lies now, if it was repacked.
        problems: What could not be recovered, in words; empty when all was.
    """

    path: Path
    before: str
    changed: bool = False
    message_count: int = 0
    merged_count: int = 0
    original: Path | None = None
    problems: tuple[str, ...] = ()


def recover_recordings(root: Path) -> list[RecoveryReport]:
    """Recover every recording of a run; one beyond repair is reported and left as it is."""
    reports = []
    for folder in sorted(RunPaths(root).trials.glob("*/attempt-*")):
        path = folder / RECORDING_NAME
        if not path.exists() and not list(folder.glob(SPILL_PATTERN)):
            continue
        try:
            reports.append(recover_recording(path))
        except RecordError as error:
            reports.append(
                RecoveryReport(path=path, before="not recovered", problems=(str(error),))
            )
    return reports


def recover_recording(path: Path) -> RecoveryReport:
    """Repack a recording that is unfinished or damaged, and merge what its recorder never got.

    The new file replaces the old one in one step and the old one stays beside it as ``.torn``.
    Recovering twice changes nothing.

    Raises:
        RecordError: Nothing in it is readable, it is still being written, or the disk is full.
    """
    problems: list[str] = []
    spills = open_readable(sorted(path.parent.glob(SPILL_PATTERN)), problems)
    if not path.exists() and spills:
        return _repacked(path, [], spills, problems, before="missing")
    with _unused(path):
        try:
            recording = Recording.open(path)
        except RecordError as error:
            if not spills:
                raise
            problems.append(str(error))
            return _repacked(path, [], spills, problems, before="unreadable")
        if recording.is_intact and not spills:
            return RecoveryReport(
                path=path,
                before=recording.describe(),
                message_count=recording.message_count,
                problems=tuple(problems),
            )
        return _repacked(path, [recording], spills, problems, before=recording.describe())


def open_readable(paths: Sequence[Path], problems: list[str]) -> list[Recording]:
    """Open what can be read of some recordings; what is said of the others goes to ``problems``."""
    recordings = []
    for path in paths:
        try:
            recordings.append(Recording.open(path))
        except RecordError as error:
            problems.append(str(error))
    return recordings


def _repacked(
    path: Path,
    recording: list[Recording],
    spills: list[Recording],
    problems: list[str],
    *,
    before: str,
) -> RecoveryReport:
    temporary = path.with_name(f".{path.name}.recovered")
    temporary.unlink(missing_ok=True)
    try:
        counts = _repack([*recording, *spills], temporary)
    except RecordError as error:
        temporary.unlink(missing_ok=True)
        size = sum(source.path.stat().st_size for source in (*recording, *spills))
        raise RecordError(
            f"{error.message}; recovery writes a file of up to {size / 1e6:.1f} MB beside the old "
            "one, which is as it was",
            remedy="free that much space on this disk, then recover again",
        ) from error
    try:
        original = _keep(path) if path.exists() else None
        temporary.replace(path)
        for spill in spills:
            spill.path.rename(_free_name(spill.path, "merged"))
        sync_folder(path.parent)
    except OSError as error:
        raise write_error(path, error) from error
    if recording and recording[0].damage:
        problems.append(f"{path}: {recording[0].damage}")
    return RecoveryReport(
        path=path,
        changed=True,
        before=before,
        message_count=sum(counts),
        merged_count=sum(counts[len(recording) :]),
        original=original,
        problems=tuple(problems),
    )


def _repack(recordings: Sequence[Recording], path: Path) -> list[int]:
    """Write the messages of ``recordings`` to ``path``, in order of arrival, each once.

    Returns:
        How many messages each recording gave; one that an earlier one held already counts there.

    Raises:
        RecordError: ``path`` exists, or the disk is full.
    """
    metadata = dict(ChainMap(*(recording.metadata for recording in recordings)))
    counts = [0] * len(recordings)
    with RecordingWriter(path, metadata=metadata, chunk_size=_CHUNK_SIZE) as writer:
        for index, message in _merged(recordings):
            writer.write_raw([message])
            counts[index] += 1
    return counts


def _merged(recordings: Sequence[Recording]) -> Iterator[tuple[int, RawMessage]]:
    """Yield (index of the recording, message) by arrival, without what two of them hold.

    Equal messages have equal stamps, so only those of one stamp have to be remembered.
    """
    streams = [zip(repeat(i), each.raw_messages()) for i, each in enumerate(recordings)]
    stamp, holders = -1, dict[RawMessage, int]()
    for index, message in heapq.merge(*streams, key=lambda item: item[1].log_time):
        if message.log_time != stamp:
            stamp = message.log_time
            holders.clear()
        if holders.setdefault(message, index) == index:
            yield index, message


def _keep(path: Path) -> Path:
    """Give the file a second name, so that it is never missing under its first."""
    original = _free_name(path, "torn")
    try:
        original.hardlink_to(path)
    except OSError as error:
        logger.info("%s: no hard links here (%s); copying", path, error.strerror)
        shutil.copy2(path, original)
    return original


def _free_name(path: Path, suffix: str) -> Path:
    candidate, number = path.with_name(f"{path.name}.{suffix}"), 1
    while candidate.exists():
        number += 1
        candidate = path.with_name(f"{path.name}.{suffix}-{number}")
    return candidate


@contextmanager
def _unused(path: Path) -> Iterator[None]:
    """Hold the lock that a writer holds.

    Raises:
        RecordError: A writer is at work.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError as error:
        raise read_error(path, error, what="the recording") from error
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise RecordError(
                f"{path}: is being written by a program that is still running",
                remedy="wait for the run to end, or stop it, then recover",
            ) from error
        yield
    finally:
        os.close(descriptor)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRecovery:
    """What became of a run.

    Attributes:
        recordings: One for each recording.
        was_cut_off: Its journal had no end, and now says so.
        check: What contradicts what else afterwards.
    """

    recordings: list[RecoveryReport]
    was_cut_off: bool
    check: RunCheck

    @property
    def is_whole(self) -> bool:
        """True where nothing stays lost and nothing contradicts anything."""
        return not any(report.problems for report in self.recordings) and self.check.passed


def recover_run(store: RunStore) -> RunRecovery:
    """Recover every recording of a run, close its journal, and check all of it.

    Raises:
        RecordError: Another program works on the run, or it cannot be written.
    """
    with store.lock():
        reports = recover_recordings(store.paths.root)
        for report in reports:
            if report.changed:
                _note(store, report)
        journal = JournalReading.of(store.paths.journal)
        if journal.is_open:
            for key in _unsealed(store, journal):
                store.log_result_hashes(*key)
            log_hashes(store.paths.journal, StoreEvent.CUT_OFF, lines=len(journal.lines))
    return RunRecovery(recordings=reports, was_cut_off=journal.is_open, check=check_run(store))


def _note(store: RunStore, report: RecoveryReport) -> None:
    trial, attempt = next(
        key for key in store.paths.attempts() if store.paths.recording(*key) == report.path
    )
    original = report.original
    log_hashes(
        store.paths.journal,
        StoreEvent.RECOVERED,
        trial=trial,
        attempt=attempt,
        recording_sha256=file_sha256(report.path, what="the recording"),
        original_sha256=None if original is None else file_sha256(original, what="the original"),
        before=report.before,
        message_count=report.message_count,
        merged_count=report.merged_count,
    )


def _unsealed(store: RunStore, journal: JournalReading) -> Iterator[tuple[int, int]]:
    for trial, attempt in store.paths.attempts():
        has_result = store.paths.result(trial, attempt).exists()
        if has_result and not journal.store_events(StoreEvent.SEALED, trial=trial, attempt=attempt):
            yield trial, attempt
