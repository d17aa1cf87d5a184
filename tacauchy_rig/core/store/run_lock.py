"""Lock of a run's folder: one program at a time writes to it."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.atomic_write import writing


@contextmanager
def run_lock(path: Path) -> Iterator[None]:
    """Hold the lock file ``path``; the kernel lets go of it when this process ends."""
    with writing(path):
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            holder = os.pread(descriptor, 32, 0).decode(errors="replace").strip() or "unknown"
            raise RecordError(
                f"{path.parent}: process {holder} is working on this run",
                remedy="wait until it ends, or stop it (Ctrl-C in its terminal)",
            ) from error
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        os.close(descriptor)
