"""``journal.jsonl``: one line for each change of state, on the disk before the run goes on."""

from __future__ import annotations

import json
import logging
import os
from pathlib import Path

from tacauchy_rig.errors import RecordError
from tacauchy_rig.run import JournalEvent
from tacauchy_rig.store.codec import dumps, from_json
from tacauchy_rig.store.durable import read_bytes, sync_folder, write_error

logger = logging.getLogger(__name__)


def append_event(path: Path, event: JournalEvent) -> None:
    """Append one line and bring it to the disk.

    The line goes out in one write, so lines of several processes never mix. Where a crash or a
    full disk left half a line behind, the new one starts on its own.

    Raises:
        RecordError: The disk is full, or the journal cannot be written.
    """
    line = dumps(event, indent=None)
    try:
        is_new = not path.exists()
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        try:
            line = b"\n" + line if _ends_torn(descriptor) else line
            written = os.write(descriptor, line)
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        if is_new:
            sync_folder(path.parent)
    except OSError as error:
        raise write_error(path, error) from error
    if written != len(line):
        raise RecordError(
            f"{path}: only {written} of {len(line)} bytes of a line could be written",
            remedy="free some space on that disk; the journal stays readable",
        )


def read_journal(path: Path) -> list[JournalEvent]:
    """Return the events, oldest first; half a line that a crash left is passed over.

    Raises:
        RecordError: Missing, unreadable, or a whole line that is no event.
    """
    events = []
    data = read_bytes(path, what="the journal")
    for number, line in enumerate(data.split(b"\n"), start=1):
        if not line:
            continue
        try:
            content = json.loads(line)
        except ValueError:
            logger.warning("%s line %d: incomplete, left by a crash; passed over", path, number)
            continue
        events.append(from_json(JournalEvent, content, source=f"{path} line {number}"))
    return events


def _ends_torn(descriptor: int) -> bool:
    size = os.fstat(descriptor).st_size
    return size > 0 and os.pread(descriptor, 1, size - 1) != b"\n"
