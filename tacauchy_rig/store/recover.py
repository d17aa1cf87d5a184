"""Repairing recordings: a torn or damaged MCAP becomes one that every viewer opens."""

from __future__ import annotations

import fcntl
import logging
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tacauchy_rig.errors import RecordError
from tacauchy_rig.store.durable import read_error, sync_folder, write_error
from tacauchy_rig.store.layout import RECORDING_NAME, SPILL_PATTERN, RunPaths
from tacauchy_rig.store.reading import Recording
from tacauchy_rig.store.repack import repack

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
        problem: Why it could not be recovered; empty when it was, or needed nothing.
    """

    path: Path
    changed: bool
    before: str
    message_count: int
    merged_count: int = 0
    original: Path | None = None
    problem: str = ""


def recover_run(root: Path) -> list[RecoveryReport]:
    """Recover every recording of a run; one beyond repair is reported and left as it is."""
    reports = []
    for folder in sorted(RunPaths(root).trials.glob("*/attempt-*")):
        path = folder / RECORDING_NAME
        if not path.exists() and not list(folder.glob(SPILL_PATTERN)):
            continue
        try:
            reports.append(recover_recording(path))
        except RecordError as error:
            logger.warning("%s", error)
            reports.append(
                RecoveryReport(
                    path=path, changed=False, before="", message_count=0, problem=str(error)
                )
            )
    return reports


def recover_recording(path: Path) -> RecoveryReport:
    """Repack a recording that is unfinished or damaged, and merge what its recorder never got.

    The new file replaces the old one in one step and the old one stays beside it as ``.torn``.
    Recovering twice changes nothing.

    Raises:
        RecordError: Nothing in it is readable, it is still being written, or the disk is full.
    """
    spills = [Recording.open(spill) for spill in sorted(path.parent.glob(SPILL_PATTERN))]
    if not path.exists() and spills:
        return _recover_spills_alone(path, spills)
    with _unused(path):
        recording = Recording.open(path)
        if recording.is_intact and not spills:
            return RecoveryReport(
                path=path,
                changed=False,
                before=recording.describe(),
                message_count=recording.message_count,
            )
        temporary = path.with_name(f".{path.name}.recovered")
        counts = _repack_beside(temporary, [recording, *spills])
        original = _replace_keeping(path, temporary)
    _retire(spills)
    return RecoveryReport(
        path=path,
        changed=True,
        before=recording.describe(),
        message_count=sum(counts),
        merged_count=sum(counts[1:]),
        original=original,
    )


def _recover_spills_alone(path: Path, spills: list[Recording]) -> RecoveryReport:
    temporary = path.with_name(f".{path.name}.recovered")
    counts = _repack_beside(temporary, spills)
    try:
        temporary.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        raise write_error(path, error) from error
    _retire(spills)
    return RecoveryReport(
        path=path,
        changed=True,
        before="missing; only unacknowledged messages were left",
        message_count=sum(counts),
        merged_count=sum(counts),
    )


def _repack_beside(temporary: Path, recordings: list[Recording]) -> list[int]:
    temporary.unlink(missing_ok=True)
    try:
        return repack(recordings, temporary)
    except RecordError:
        temporary.unlink(missing_ok=True)
        raise


def _replace_keeping(path: Path, temporary: Path) -> Path:
    """Put ``temporary`` in the place of ``path``, which is never missing, and keep the old."""
    original = _free_name(path)
    try:
        try:
            original.hardlink_to(path)
        except OSError:
            shutil.copy2(path, original)
        temporary.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        raise write_error(path, error) from error
    return original


def _free_name(path: Path) -> Path:
    candidate, number = path.with_name(f"{path.name}.torn"), 1
    while candidate.exists():
        number += 1
        candidate = path.with_name(f"{path.name}.torn-{number}")
    return candidate


def _retire(spills: list[Recording]) -> None:
    for spill in spills:
        spill.path.rename(spill.path.with_name(f"{spill.path.name}.merged"))


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
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError as error:
        raise RecordError(
            f"{path}: is being written by a program that is still running",
            remedy="wait for the run to end, or stop it, then recover",
        ) from error
    finally:
        os.close(descriptor)
