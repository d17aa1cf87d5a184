"""Writing files so that a crash leaves the old or the new one, by one program at a time."""

import contextlib
import errno
import fcntl
import hashlib
import logging
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tacauchy_rig.core.errors import RecordError

logger = logging.getLogger(__name__)

_ELSEWHERE = (
    "name another place with FOLDER, --out, --json or run.output_directory; for what is kept "
    "between commands, with the variable XDG_CACHE_HOME"
)
_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


def write_atomically(path: Path, data: bytes) -> None:
    """Replace ``path`` by ``data``; after a crash it holds the old or the new bytes.

    Raises:
        RecordError: The disk is full, or the folder cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        with contextlib.suppress(OSError):  # a read-only disk refuses this too, even of no file
            temporary.unlink(missing_ok=True)
        raise write_error(path, error) from error


def free_name(path: Path, suffix: str) -> Path:
    """Return a name beside ``path`` that nothing has: with the suffix, and a number if need be."""
    candidate, number = path.with_name(f"{path.name}.{suffix}"), 1
    while candidate.exists():
        number += 1
        candidate = path.with_name(f"{path.name}.{suffix}-{number}")
    return candidate


def set_aside(path: Path, suffix: str) -> Path:
    """Give a file another name, with a suffix that says why, and return it."""
    aside = free_name(path, suffix)
    with writing(path):
        path.rename(aside)
        sync_folder(path.parent)
    return aside


def give_second_name(path: Path, name: Path) -> Path:
    """Keep a file under a second name too; return that."""
    try:
        name.hardlink_to(path)
    except OSError as error:
        logger.info("%s: no hard links here (%s); copying", path, error.strerror)
        shutil.copy2(path, name)
    return name


def sync_folder(folder: Path) -> None:
    """Bring the names in ``folder`` to the disk."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def bytes_sha256(content: bytes) -> str:
    """Return the SHA-256 of some content."""
    return hashlib.sha256(content).hexdigest()


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Raise the operating system's errors as those of writing ``path``."""
    try:
        yield
    except OSError as error:
        raise write_error(path, error) from error


def write_error(path: Path, error: OSError) -> RecordError:
    """Return the error for the operator after ``path`` could not be written."""
    if isinstance(error, FileExistsError):
        return RecordError(
            f"{error.filename or path}: exists already, and nothing recorded is ever overwritten",
            remedy="name another place, start a new attempt or run, or move the old file away",
        )
    problem = f"cannot be written: {error.strerror or error}"
    remedy = "check the disk (dmesg, df -h)"
    if error.errno in _FULL:
        problem = f"no space left to write ({_space(path)}): {error.strerror}"
        remedy = "free some space"
    elif isinstance(error, PermissionError):
        problem = f"no permission to write: {error.strerror}"
        remedy = "give yourself write permission there (ls -ld shows it)"
    elif error.errno == errno.EROFS:
        problem = "its disk is read-only"
        remedy = "mount it for writing (`dmesg` says whether it failed)"
    return RecordError(f"{path}: {problem}", remedy=f"{remedy}, or {_ELSEWHERE}")


def existing_folder(path: Path) -> Path:
    """Return the folder that is there, of a path that need not be: the path or one above it."""
    path = path.absolute()
    return next((folder for folder in (path, *path.parents) if folder.is_dir()), path)


def free_bytes(path: Path) -> int:
    """Return the free space [bytes] where ``path`` is or will be; OSError if it is unreadable."""
    return shutil.disk_usage(existing_folder(path)).free


def _space(path: Path) -> str:
    try:
        return f"{free_bytes(path.parent) / 1e6:.1f} MB free"
    except OSError:
        return "free space unknown"


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
