"""A file of the run as a whole: read as what it holds, written with its hash in the journal."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Generic, TypeVar

from tacauchy_rig.core.store.codec import dumps, from_json, loads
from tacauchy_rig.core.store.durable import read_bytes, write_atomically
from tacauchy_rig.core.store.seals import Seal, bytes_sha256, seal

T = TypeVar("T")


class SealedFile(Generic[T]):
    """One such file.

    Args:
        path: Where it lies.
        kind: What it holds.
        journal: The run's.
        what: What it is, for messages.
    """

    def __init__(self, path: Path, kind: Any, *, journal: Path, what: str) -> None:
        self._path, self._kind, self._journal, self._what = path, kind, journal, what

    def load(self) -> T | None:
        """Read it; None where it was never written.

        Raises:
            RecordError: It is damaged.
        """
        if not self._path.exists():
            return None
        found: T = read_json(self._kind, self._path, what=self._what)
        return found

    def save(self, value: T) -> None:
        """Write it, or write it anew.

        Raises:
            RecordError: The disk is full or gone.
        """
        self.write(dumps(value))

    def write(self, content: bytes) -> None:
        """Write its bytes, and their hash into the journal.

        The line goes out first: a crash between the two leaves the file that an earlier line told
        of.

        Raises:
            RecordError: The disk is full or gone.
        """
        seal(self._journal, Seal.WRITTEN, file=self._path.name, sha256=bytes_sha256(content))
        write_atomically(self._path, content)


def read_json(kind: Any, path: Path, *, what: str) -> Any:
    """Read a JSON file as a kind of value.

    Args:
        kind: What it holds.
        path: The file.
        what: What it is, for the message.

    Raises:
        RecordError: It is missing or damaged; names file and field.
    """
    return from_json(kind, loads(read_bytes(path, what=what), source=str(path)), source=str(path))
