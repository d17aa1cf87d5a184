"""One program at a time works on a run."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.durable import write_error


@contextmanager
def run_lock(path: Path) -> Iterator[None]:
    """Hold the lock file ``path``; the kernel lets go of it when this process ends.

    Raises:
        RecordError: Another program holds it; the message names its process.
    """
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise write_error(path, error) from error
    try:
        _take(path, descriptor)
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        os.close(descriptor)


def _take(path: Path, descriptor: int) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        holder = os.pread(descriptor, 32, 0).decode(errors="replace").strip() or "unknown"
        raise RecordError(
            f"{path.parent}: process {holder} is working on this run",
            remedy="wait until it ends, or stop it (Ctrl-C in its terminal)",
        ) from error
