"""What the journal says of the run's own files: their SHA-256 when they were written.

The last line of the journal thereby stands for the whole run. None of this is signed: whoever
rewrites every file and every line after it leaves no trace here.
"""

from __future__ import annotations

import hashlib
import time
from enum import StrEnum
from pathlib import Path
from typing import Any

from tacauchy_rig.core.run import JournalEvent
from tacauchy_rig.core.store.durable import read_error
from tacauchy_rig.core.store.journal import append_event


class Seal(StrEnum):
    """Events that the store writes into the journal itself.

    Attributes:
        WRITTEN: A file of the run as a whole is about to be written.
        SEALED: The result of an attempt was written.
        RECOVERED: A recording was repacked.
        CUT_OFF: The session before ended without a word.
        REPLAYED: A replay was written.
    """

    WRITTEN = "written"
    SEALED = "sealed"
    RECOVERED = "recovered"
    CUT_OFF = "cut-off"
    REPLAYED = "replayed"


def seal(journal: Path, kind: Seal, *, trial: int = 0, attempt: int = 0, **detail: Any) -> None:
    """Write a line of the journal about a file of the run.

    Raises:
        RecordError: The disk is full, or the journal cannot be written.
    """
    event = JournalEvent(
        stamp_ns=time.monotonic_ns(),
        name=kind.value,
        trial=trial,
        attempt=attempt,
        detail=detail,
    )
    append_event(journal, event)


def bytes_sha256(content: bytes) -> str:
    """Return the SHA-256 of some content."""
    return hashlib.sha256(content).hexdigest()


def file_sha256(path: Path, *, what: str) -> str:
    """Return the SHA-256 of a file that has to be there.

    Args:
        path: The file.
        what: What it is, for the message.

    Raises:
        RecordError: It is missing, or may not be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise read_error(path, error, what=what) from error
