"""What a killed program or a power cut leaves behind is repaired, completed, or set aside."""

import fcntl
import heapq
import math
from collections import ChainMap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import JournalEvent, TrialRecord
from tacauchy_rig.core.store.atomic_write import (
    free_name,
    give_second_name,
    set_aside,
    sync_folder,
    writing,
)
from tacauchy_rig.core.store.check.run_and_press_check import RunCheck, check_run
from tacauchy_rig.core.store.journal import START, Journal, StoreEvent, append_event, log_hashes
from tacauchy_rig.core.store.json_codec import read_json
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.recording.mcap_writer import RawMessage, RecordingWriter
from tacauchy_rig.core.store.run_files import (
    RESULT_NAME,
    SPILL_PATTERN,
    RunPaths,
    file_sha256,
    open_file,
    run_root_of,
)
from tacauchy_rig.core.store.run_store import RunStore

_CHUNK_SIZE = 4 << 20  # [bytes] of a finished file, which nobody kills while it is written
_BEGIN, _END = "attempt-start", "attempt-end"
_SPILL_MARGIN_NS = 10**9
"""A sample may have waited for so long when an attempt began, and come so late after its end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecoveryReport:
    """What became of one recording."""

    path: Path
    before: str  # what state it was in, in words
    changed: bool = False  # the file was repacked; False for one that needed nothing
    message_count: int = 0  # messages that are readable now
    merged_count: int = 0  # of these, those that came from spills (``unacknowledged-*.mcap``)
    original: Path | None = None  # where the file as it was lies now, if it was repacked
    problems: tuple[str, ...] = ()  # what could not be recovered, in words; empty when all was


Opener = Callable[[Path], Recording]


def recover_recordings(root: Path, *, opener: Opener = Recording.open) -> list[RecoveryReport]:
    """Recover every recording of a run; one beyond repair is reported and set aside."""
    paths, reports = RunPaths(root), []
    for key in paths.attempts():
        path = paths.recording(*key)
        if not path.exists() and not paths.spills(*key):
            continue
        try:
            reports.append(recover_recording(path, opener=opener))
        except RecordError as error:
            report = RecoveryReport(path=path, before="not recovered", problems=(str(error),))
            reports.append(report)
    return reports


def recover_recording(path: Path, *, opener: Opener = Recording.open) -> RecoveryReport:
    """Repack a recording that is unfinished or damaged, and merge what its recorder never got.

    The new file replaces the old one in one step and the old one stays beside it as ``.torn``.
    A recording that is the one that its result tells of is never written again. A spill of
    another attempt is set aside as ``.refused``. Recovering twice changes nothing.

    Raises:
        RecordError: It is still being written, or the disk is full.
    """
    problems: list[str] = []
    with _unused(path) if path.exists() else nullcontext():
        recording, before, error = _opened(path, opener)
        spills = _spills_of(path, recording, problems)
        problems += error
        closed_sha256: str | None = None
        original: Path | None = None
        with suppress(RecordError):  # no result tells what it was when it was closed
            result = read_json(TrialRecord, path.with_name(RESULT_NAME), what="the result")
            closed_sha256 = result.recording_sha256
        found_sha256 = "" if recording is None else file_sha256(path, what="the recording")
        if recording is not None and closed_sha256 == found_sha256:
            for spill in spills:  # a closed recording is never written again
                if lacking := sum(index for index, _ in _merged([recording, spill])):
                    told = (
                        f"{spill.path}: {lacking} of its messages are not in the closed recording"
                    )
                    _refuse(spill.path, told, problems)
                else:
                    set_aside(spill.path, "merged")
        elif spills or (recording is not None and not recording.is_intact):
            return _repacked(path, recording, spills, problems, before=before)
        elif recording is None and path.exists() and closed_sha256 is None:
            original = set_aside(path, "torn")
    return RecoveryReport(
        path=path,
        before=before,
        message_count=0 if recording is None else recording.message_count,
        original=original,
        problems=tuple(problems),
    )


def _opened(path: Path, opener: Opener) -> tuple[Recording | None, str, list[str]]:
    """Return a recording, what state it is in, in words, and why it cannot be opened, if so."""
    if not path.exists():
        return None, "missing", []
    try:
        recording = opener(path)
    except RecordError as error:
        return None, "unreadable", [str(error)]
    return recording, recording.describe(), []


def _spills_of(path: Path, recording: Recording | None, problems: list[str]) -> list[Recording]:
    """Return the spills beside a recording that hold messages of its attempt; refuse the others."""
    spills = []
    for place in sorted(path.parent.glob(SPILL_PATTERN)):
        if not place.stat().st_size:
            continue
        try:
            spill = Recording.open(place)
        except RecordError as error:
            _refuse(place, error.message, problems)
            continue
        if not spill.message_count:
            continue
        if reason := _misfit(spill, path, recording):
            _refuse(place, reason, problems)
        else:
            spills.append(spill)
    return spills


def _refuse(spill: Path, reason: str, problems: list[str]) -> None:
    aside = set_aside(spill, "refused")
    problems.append(f"{reason}; it stays as {aside.name}, and nothing of it was merged")


def _misfit(spill: Recording, path: Path, recording: Recording | None) -> str:
    """Return why a spill cannot be of a recording's attempt; an empty text where it can."""
    attempt = path.parent.name.removeprefix("attempt-")
    trial = path.parent.parent.name
    if not (attempt.isdecimal() and trial.isdecimal()):
        return ""
    key = (int(trial), int(attempt))
    stated = {name: spill.metadata.get(name) for name in ("trial", "attempt")}
    for (name, value), number in zip(stated.items(), key, strict=True):
        if value is not None and value != str(number):
            return f"{spill.path}: it is of {name} {value}"
    first_ns, last_ns = _window(path, key, recording)
    if spill.start_ns < first_ns - _SPILL_MARGIN_NS or spill.end_ns > last_ns + _SPILL_MARGIN_NS:
        return (
            f"{spill.path}: its messages are from {spill.start_ns} to {spill.end_ns} ns, and the "
            f"attempt was from {first_ns:.0f} to {last_ns:.0f} ns"
        )
    return ""


def _window(path: Path, key: tuple[int, int], recording: Recording | None) -> tuple[float, float]:
    """Return when an attempt began and ended [ns], as far as journal and recording tell."""
    events = Journal.read(RunPaths(run_root_of(path)).journal).events
    own = [e for e in events if (e.trial, e.attempt) == key]
    own += [] if recording is None else recording.events()
    begun = [e.stamp_ns for e in own if e.name == _BEGIN]
    ended = [e.stamp_ns for e in own if e.name == _END]
    first_ns = min(begun, default=-math.inf)
    later = [e.stamp_ns for e in events if e.name == _BEGIN and e.stamp_ns > first_ns]
    return first_ns, max(ended) if ended else min(later, default=math.inf)


def _repacked(
    path: Path,
    recording: Recording | None,
    spills: Sequence[Recording],
    problems: list[str],
    *,
    before: str,
) -> RecoveryReport:
    """Put a file with the messages of recording and spills in the place of the recording."""
    sources = [*([] if recording is None else [recording]), *spills]
    temporary = path.with_name(f".{path.name}.recovered")
    temporary.unlink(missing_ok=True)
    try:
        metadata = dict(ChainMap(*(source.metadata for source in sources)))
        counts = [0] * len(sources)
        with RecordingWriter(temporary, metadata=metadata, chunk_size=_CHUNK_SIZE) as writer:
            for index, message in _merged(sources):
                writer.write_raw([message])
                counts[index] += 1
    except RecordError as error:
        temporary.unlink(missing_ok=True)
        size = sum(source.path.stat().st_size for source in sources)
        raise RecordError(
            f"{error.message}; recovery writes a file of up to {size / 1e6:.1f} MB beside the old "
            "one, which is as it was",
            remedy="free that much space on this disk, then recover again",
        ) from error
    with writing(path):
        original = give_second_name(path, free_name(path, "torn")) if path.exists() else None
        temporary.replace(path)
        for spill in spills:
            spill.path.rename(free_name(spill.path, "merged"))
        sync_folder(path.parent)
    if recording is not None and recording.damage:
        problems.append(f"{path}: {recording.damage}")
    return RecoveryReport(
        path=path,
        changed=True,
        before=before,
        message_count=sum(counts),
        merged_count=sum(counts[len(sources) - len(spills) :]),
        original=original,
        problems=tuple(problems),
    )


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


@contextmanager
def _unused(path: Path) -> Iterator[None]:
    """Hold the lock that a writer holds; RecordError if one is at work."""
    with open_file(path, what="the recording") as descriptor:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise RecordError(
                f"{path}: is being written by a program that is still running",
                remedy="wait for the run to end, or stop it, then recover",
            ) from error
        yield


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRecovery:
    """What became of a run."""

    recordings: list[RecoveryReport]  # one for each recording
    was_cut_off: bool  # its journal had no end, and now says so
    check: RunCheck  # what contradicts what else afterwards

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
        # What ``write_atomically`` and ``recover`` had not yet given its name.
        for pattern in (".*.new", ".*.recovered"):
            for path in store.paths.root.rglob(pattern):
                path.unlink(missing_ok=True)
        store.mend_files()
        journal = Journal.read(store.paths.journal)
        unfinished = _unfinished(store, journal)
        for key in unfinished or ():
            _set_aside_broken(store, journal, *key)
        reports = recover_recordings(store.paths.root, opener=store.opened)
        for report in reports:
            if report.changed:
                _note(store, report)
        if unfinished is not None:
            _complete_journal(store, journal, unfinished)
    return RunRecovery(
        recordings=reports, was_cut_off=unfinished is not None, check=check_run(store)
    )


def _unfinished(store: RunStore, journal: Journal) -> list[tuple[int, int]] | None:
    """Return each (trial, attempt) that the last session may have left unfinished.

    None where that session ended properly. A journal may have lost its last lines, the session's
    first among them: then there is an attempt that it does not know. One that passed is none of
    these: it took longer.
    """
    events = journal.events
    names = (_BEGIN, StoreEvent.SEALED, StoreEvent.CUT_OFF)
    known = {(e.trial, e.attempt) for e in events if e.name in names}
    unknown = {key for key in store.paths.attempts() if key not in known}
    begun: set[tuple[int, int]] = set()
    if journal.is_open:
        first = max(place for place, event in enumerate(events) if event.name == START)
        begun = {(e.trial, e.attempt) for e in events[first:] if e.name == _BEGIN}
    else:
        results = [store.readable_result(*key) for key in unknown]
        if store.config.is_imported or not unknown or any(r and r.passed for r in results):
            return None
    return sorted(begun | unknown)


def _set_aside_broken(store: RunStore, journal: Journal, trial: int, attempt: int) -> None:
    """Set aside a result that is torn, or tells of another recording than there is."""
    store.paths.attempt(trial, attempt).mkdir(parents=True, exist_ok=True)
    if why := _broken(store, journal, trial, attempt):
        path = store.paths.result(trial, attempt)
        log_hashes(
            store.paths.journal,
            StoreEvent.CUT_OFF,
            trial=trial,
            attempt=attempt,
            why=why,
            set_aside=set_aside(path, "torn").name if path.exists() else None,
        )


def _broken(store: RunStore, journal: Journal, trial: int, attempt: int) -> str:
    """Return why the result of an attempt does not count; an empty text where it does."""
    try:
        record = store.load_result(trial, attempt)
    except RecordError:
        return "its result was torn"
    if record is None:
        if journal.store_events(StoreEvent.SEALED, trial=trial, attempt=attempt):
            return "its result is missing"
        return "" if journal.of_attempt(trial, attempt) else "it had just begun"
    recording = store.paths.recording(trial, attempt)
    if record.recording_sha256 is None:
        return ""
    if not recording.exists():
        return "its recording is missing"
    is_same = file_sha256(recording, what="the recording") == record.recording_sha256
    return "" if is_same else "its recording was torn"


def _complete_journal(
    store: RunStore, journal: Journal, unfinished: Sequence[tuple[int, int]]
) -> None:
    """Write what the journal lost and the recordings hold, the hashes of results, and an end."""
    path = store.paths.journal
    known = set(map(_identity, journal.events))
    for key in unfinished:
        recorded: list[JournalEvent] = []
        if (recording := store.paths.recording(*key)).exists():
            with suppress(RecordError):
                recorded = Recording.open(recording).events()
        for event in recorded:
            if (event.trial, event.attempt) == key and _identity(event) not in known:
                append_event(path, event)
    sealed = {(e.trial, e.attempt) for e in journal.events if e.name == StoreEvent.SEALED}
    for key in store.paths.attempts():
        if key not in sealed and store.paths.result(*key).exists():
            store.log_result_hashes(*key)
    log_hashes(path, StoreEvent.CUT_OFF, lines=len(journal.lines))


def _identity(event: JournalEvent) -> tuple[object, ...]:
    return event.stamp_ns, event.name, event.trial, event.attempt


def _note(store: RunStore, report: RecoveryReport) -> None:
    """Write into the journal that a recording was repacked."""
    paths, original = store.paths, report.original
    trial, attempt = next(key for key in paths.attempts() if paths.recording(*key) == report.path)
    log_hashes(
        paths.journal,
        StoreEvent.RECOVERED,
        trial=trial,
        attempt=attempt,
        recording_sha256=file_sha256(report.path, what="the recording"),
        original_sha256=None if original is None else file_sha256(original, what="the original"),
        before=report.before,
        message_count=report.message_count,
        merged_count=report.merged_count,
    )
