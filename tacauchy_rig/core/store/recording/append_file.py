"""A file that grows by whole commits: either all bytes of one are with the kernel, or none."""

from __future__ import annotations

import fcntl
import hashlib
import logging
import os
import threading
from pathlib import Path

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.durable import sync_folder, write_error

logger = logging.getLogger(__name__)

SYNC_PERIOD_S = 1.0


class AppendFile:
    """What ``mcap.writer.Writer`` writes to: ``write`` gathers, ``commit`` hands to the kernel.

    A thread brings the file to the disk every ``SYNC_PERIOD_S``. The file is locked, so that
    nobody repairs it while it is written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._parts: list[bytes] = []
        self._pending = 0
        self._committed = 0
        self._hash = hashlib.sha256()
        self._failure: RecordError | None = None
        self._was_reported = False
        self._ended = threading.Event()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
            self._descriptor = os.open(path, flags, 0o644)
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            sync_folder(path.parent)
        except OSError as error:
            raise write_error(path, error) from error
        self._syncer = threading.Thread(
            target=self._sync_often, name=f"sync {path.name}", daemon=True
        )
        self._syncer.start()

    @property
    def is_closed(self) -> bool:
        """True after ``close``."""
        return self._ended.is_set()

    @property
    def has_failed(self) -> bool:
        """True once bytes could not be written; nothing is written after that."""
        return self._failure is not None

    @property
    def sha256(self) -> str | None:
        """Of all that was committed; None once bytes could not be written."""
        return None if self.has_failed else self._hash.hexdigest()

    def write(self, data: bytes) -> int:
        """Gather bytes for the next commit."""
        self._parts.append(data)
        self._pending += len(data)
        return len(data)

    def tell(self) -> int:
        """Return the offset [bytes] that the next written byte will have."""
        return self._committed + self._pending

    def flush(self) -> None:
        """Do nothing: only ``commit`` hands bytes over."""

    def commit(self) -> None:
        """Hand all gathered bytes to the kernel; on failure take back what went out of them.

        Raises:
            RecordError: The disk is full or gone, now or since the last call.
        """
        if self._failure is not None:
            self._was_reported = True
            raise self._failure
        data = b"".join(self._parts)
        self._parts.clear()
        self._pending = 0
        try:
            view = memoryview(data)
            while view:
                view = view[os.write(self._descriptor, view) :]
        except OSError as error:
            self._failure = write_error(self.path, error)
            self._was_reported = True
            self._take_back()
            raise self._failure from error
        self._committed += len(data)
        self._hash.update(data)

    def close(self) -> None:
        """Bring the file to the disk and close it; safe to call twice.

        Raises:
            RecordError: The disk refused, and no earlier call has said so.
        """
        if self.is_closed:
            return
        self._ended.set()
        self._syncer.join()
        try:
            self._sync()
        finally:
            os.close(self._descriptor)
        if self._failure is not None and not self._was_reported:
            raise self._failure

    def _take_back(self) -> None:
        try:
            os.ftruncate(self._descriptor, self._committed)
        except OSError as error:
            logger.warning("%s: a torn message stays at the end: %s", self.path, error)

    def _sync_often(self) -> None:
        while not self._ended.wait(SYNC_PERIOD_S):
            self._sync()

    def _sync(self) -> None:
        try:
            os.fdatasync(self._descriptor)
        except OSError as error:
            if self._failure is None:
                self._failure = write_error(self.path, error)
