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
from typing import Any

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
    with _unused(path) if path.exists() else nullcontext():
        return _Recovery(path, opener).done()


class _Recovery:
    """A recording, the spills beside it that hold messages of its attempt, and what stays lost."""

    def __init__(self, path: Path, opener: Opener) -> None:
        self.path, self.problems = path, list[str]()
        self.recording: Recording | None = None
        self.before = "unreadable" if path.exists() else "missing"
        try:
            self.recording = opener(path) if path.exists() else None
        except RecordError as error:
            self.problems.append(str(error))
        if self.recording is not None:
            self.before = self.recording.describe()
        self.spills = list(self._spills())

    def done(self) -> RecoveryReport:
        """Leave the recording as it is, repack it, or set it aside."""
        closed_sha256 = original = None
        with suppress(RecordError):  # no result tells what it was when it was closed
            result = read_json(TrialRecord, self.path.with_name(RESULT_NAME), what="the result")
            closed_sha256 = result.recording_sha256
        found = self.recording
        if found and closed_sha256 == file_sha256(self.path, what="the recording"):
            for spill in self.spills:  # a closed recording is never written again
                if lacking := sum(index for index, _ in _merged([found, spill])):
                    self._refuse(
                        spill.path,
                        f"{spill.path}: {lacking} of its messages are not in the closed recording",
                    )
                else:
                    set_aside(spill.path, "merged")
        elif self.spills or (found and not found.is_intact):
            return self._repacked()
        elif found is None and self.path.exists() and closed_sha256 is None:
            original = set_aside(self.path, "torn")
        return self._report(message_count=found.message_count if found else 0, original=original)

    def _report(self, **found: Any) -> RecoveryReport:
        problems = tuple(self.problems)
        return RecoveryReport(path=self.path, before=self.before, problems=problems, **found)

    def _spills(self) -> Iterator[Recording]:
        for place in sorted(self.path.parent.glob(SPILL_PATTERN)):
            if not place.stat().st_size:
                continue
            try:
                spill = Recording.open(place)
            except RecordError as error:
                self._refuse(place, error.message)
                continue
            if spill.message_count and (reason := self._misfit(spill)):
                self._refuse(place, reason)
            elif spill.message_count:
                yield spill

    def _refuse(self, spill: Path, reason: str) -> None:
        aside = set_aside(spill, "refused")
        self.problems.append(f"{reason}; it stays as {aside.name}, and nothing of it was merged")

    def _misfit(self, spill: Recording) -> str:
        """Return why a spill cannot be of the recording's attempt; an empty text where it can."""
        attempt = self.path.parent.name.removeprefix("attempt-")
        trial = self.path.parent.parent.name
        if not (attempt.isdecimal() and trial.isdecimal()):
            return ""
        key = {"trial": int(trial), "attempt": int(attempt)}
        for name, number in key.items():
            if (stated := spill.metadata.get(name)) not in (None, str(number)):
                return f"{spill.path}: it is of {name} {stated}"
        first_ns, last_ns = self._window(**key)
        is_early = spill.start_ns < first_ns - _SPILL_MARGIN_NS
        if is_early or spill.end_ns > last_ns + _SPILL_MARGIN_NS:
            return (
                f"{spill.path}: its messages are from {spill.start_ns} to {spill.end_ns} ns, and "
                f"the attempt was from {first_ns:.0f} to {last_ns:.0f} ns"
            )
        return ""

    def _window(self, trial: int, attempt: int) -> tuple[float, float]:
        """Return when an attempt began and ended [ns], as far as journal and recording tell."""
        events = Journal.read(RunPaths(run_root_of(self.path)).journal).events
        own = [e for e in events if (e.trial, e.attempt) == (trial, attempt)]
        own += self.recording.events() if self.recording else []
        begun = [e.stamp_ns for e in own if e.name == _BEGIN]
        ended = [e.stamp_ns for e in own if e.name == _END]
        first_ns = min(begun, default=-math.inf)
        later = [e.stamp_ns for e in events if e.name == _BEGIN and e.stamp_ns > first_ns]
        return first_ns, max(ended) if ended else min(later, default=math.inf)

    def _repacked(self) -> RecoveryReport:
        """Put a file with the messages of recording and spills in the place of the recording."""
        path, sources = self.path, [*([self.recording] if self.recording else []), *self.spills]
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
                f"{error.message}; recovery writes a file of up to {size / 1e6:.1f} MB beside the "
                "old one, which is as it was",
                remedy="free that much space on this disk, then recover again",
            ) from error
        with writing(path):
            original = give_second_name(path, free_name(path, "torn")) if path.exists() else None
            temporary.replace(path)
            for spill in self.spills:
                spill.path.rename(free_name(spill.path, "merged"))
            sync_folder(path.parent)
        if self.recording and self.recording.damage:
            self.problems.append(f"{path}: {self.recording.damage}")
        return self._report(
            changed=True,
            message_count=sum(counts),
            merged_count=sum(counts[len(sources) - len(self.spills) :]),
            original=original,
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
        with suppress(RecordError):  # it is missing, or beyond repair
            recorded = store.recording(*key).events()
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
