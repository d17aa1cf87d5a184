"""The files of a run: where they lie, and the one place that opens them, whoever wrote them.

A run holds folders and plain files. A link could lead out of it, a pipe or a device would hold up
whoever opens it, and a file without bound would fill the memory.
"""

import errno
import hashlib
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tacauchy_rig.core.errors import RecordError

MAX_DEPTH = 8
"""Folders below a run's own; the program makes five."""
MAX_ENTRIES = 200_000
MAX_BYTES = 256 << 20
"""Of a file that is read into memory."""
MAX_HOLE_BYTES = 64 << 20
"""Of a recording: what a power cut leaves of its end is far less."""
_MAX_EXTENTS = 10_000
_WRITTEN_IN_PLACE = (".lock", "journal.jsonl")
"""All other files are written anew beside the old one."""
_OPEN = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC
_FOREIGN = "remove it, or ask where the folder comes from: this program never makes such a one"


def check_tree(root: Path) -> None:
    """Refuse a run's folder that holds more than folders and plain files with readable names.

    What it lets pass can be written to as well: no path below ``root`` leads out of it. A live
    emulator has its sockets and the link to its serial port in a folder of its own.

    Raises:
        RecordError: Names what is in the way.
    """
    waiting, count = [(root, 0)], 0
    while waiting:
        folder, depth = waiting.pop()
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    count += 1
                    if count > MAX_ENTRIES:
                        raise _refused(root, f"holds more than {MAX_ENTRIES} files")
                    if _is_folder(root, entry):
                        waiting.append((Path(entry.path), depth + 1))
        except OSError as error:
            raise read_error(folder, error, what="a folder of the run") from error
        if depth > MAX_DEPTH:
            raise _refused(folder, f"lies more than {MAX_DEPTH} folders deep")


def is_inside(file: str) -> bool:
    """Return whether a path that a file of the run names stays in the folder it starts from."""
    parts = Path(file).parts
    return bool(parts) and not Path(file).is_absolute() and ".." not in parts and is_text(file)


def is_text(name: str) -> bool:
    """Return whether a name is valid, printable text."""
    return name.isprintable() and not any("\ud800" <= letter <= "\udfff" for letter in name)


def _is_folder(root: Path, entry: os.DirEntry[str]) -> bool:
    """Return whether an entry is a folder; refuse what is neither a folder nor a plain file."""
    path = Path(entry.path)
    if not is_text(entry.name):
        raise _refused(path, "its name is not valid text")
    found = entry.stat(follow_symlinks=False)
    mode = found.st_mode
    if path.parent == root and entry.name in _WRITTEN_IN_PLACE and found.st_nlink > 1:
        raise _refused(path, "has a second name (a hard link), under which it would change too")
    if not (stat.S_ISDIR(mode) or stat.S_ISREG(mode) or _is_emulators(root, path, mode)):
        raise _refused(path, f"is {_kind(mode)}")
    return stat.S_ISDIR(mode)


def _is_emulators(root: Path, path: Path, mode: int) -> bool:
    if path.parent != root / "emulation":
        return False
    is_port = stat.S_ISLNK(mode) and path.name == "force_sensor.port"
    return stat.S_ISSOCK(mode) or (is_port and str(path.readlink()).startswith("/dev/pts/"))


def _kind(mode: int) -> str:
    kinds = {"l": "a link", "p": "a pipe", "s": "a socket", "d": "a folder"}
    return kinds.get(stat.filemode(mode)[0], "a device")


def _refused(path: Path, what: str) -> RecordError:
    return RecordError(f"{ascii_path(path)}: {what}; a run is not opened with it", remedy=_FOREIGN)


def ascii_path(path: Path) -> str:
    """Return a path that can be printed whatever bytes its names hold."""
    return "".join(letter if is_text(letter) else ascii(letter)[1:-1] for letter in str(path))


@contextmanager
def open_file(
    path: Path, *, what: str, max_bytes: int | None = None, links: bool = False
) -> Iterator[int]:
    """Open a plain file for reading and yield its descriptor.

    Args:
        what: What it is, for the message: ``"the run's description"``.
        max_bytes: More than so many are refused.
        links: Follow links, of a file that is no part of a run.

    Raises:
        RecordError: It is missing, a link, a pipe or a device, may not be read, or is too large.
    """
    try:
        descriptor = os.open(path, _OPEN | (0 if links else os.O_NOFOLLOW))
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENXIO):
            raise _refused(path, f"{what} is a link or a device") from error
        raise read_error(path, error, what=what) from error
    try:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode):
            raise _refused(path, f"{what} is {_kind(found.st_mode)}")
        if max_bytes is not None and found.st_size > max_bytes:
            size = f"{found.st_size / 1e6:.0f} MB, more than {max_bytes / 1e6:.0f} MB"
            raise _refused(path, f"{what} has {size}")
        if found.st_size > MAX_HOLE_BYTES and _hole_bytes(descriptor, found) > MAX_HOLE_BYTES:
            raise _refused(path, f"{what} claims {found.st_size / 1e6:.0f} MB and has holes")
        yield descriptor
    except OSError as error:
        raise read_error(path, error, what=what) from error
    finally:
        os.close(descriptor)


def _hole_bytes(descriptor: int, found: os.stat_result) -> int:
    """Return how much of a file was never written [bytes]."""
    data = position = 0
    for _ in range(_MAX_EXTENTS):
        try:
            start = os.lseek(descriptor, position, os.SEEK_DATA)
        except OSError:  # nothing but a hole is left
            break
        position = os.lseek(descriptor, start, os.SEEK_HOLE)
        data += position - start
    os.lseek(descriptor, 0, os.SEEK_SET)
    return found.st_size - data


def read_bytes(path: Path, *, what: str) -> bytes:
    """Read a file that has to be there; arguments and errors as for ``open_file``."""
    with open_file(path, what=what, max_bytes=MAX_BYTES) as descriptor:
        return os.fdopen(descriptor, "rb", closefd=False).read(MAX_BYTES)


def file_sha256(path: Path, *, what: str, links: bool = False) -> str:
    """Return the SHA-256 of a file that has to be there; arguments as for ``open_file``."""
    with open_file(path, what=what, links=links) as descriptor:
        file = os.fdopen(descriptor, "rb", closefd=False)
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_error(path: Path, error: OSError, *, what: str) -> RecordError:
    """Return the error for the operator after ``path`` could not be read."""
    if isinstance(error, FileNotFoundError):
        return RecordError(
            f"{path}: {what} is missing",
            remedy=f"check the path; `ls {path.parent}` shows what is there",
        )
    if isinstance(error, PermissionError):
        return RecordError(
            f"{path}: no permission to read {what}: {error.strerror}",
            remedy=f"ask the owner of the file for permission (ls -l {path} shows it)",
        )
    return RecordError(
        f"{path}: {what} cannot be read: {error.strerror or error}",
        remedy="check the path and the disk (dmesg)",
    )


RESULT_NAME = "result.json"
SPILL_PATTERN = "unacknowledged-*.mcap"

_TRIAL = re.compile(r"0[1-9]|[1-9][0-9]{1,8}")
_ATTEMPT = re.compile(r"attempt-([1-9][0-9]{0,8})")


class RunPaths:
    """Names of a run folder's files. Trials and attempts count from 1."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.run_json = root / "run.json"  # what the run is: configuration, versions, devices
        self.rig_toml = root / "rig.toml"  # the configuration as it was written
        self.journal = root / "journal.jsonl"  # one line for each change of state
        self.force_check = root / "force_check.json"  # how the cell read a known weight
        self.expected = root / "expected.json"  # what its presses should give
        self.imported = root / "imported.json"  # what others recorded; imported runs only
        self.optics_json = root / "optics.json"  # what a calibration of the optics gave
        self.optics = root / "optics"  # folder of that calibration
        self.calibration = self.optics / "calibration.npz"
        # Each press next to its rendering by a model that was fitted without it.
        self.calibration_picture = self.optics / "calibration_held_out.png"
        self.truth = root / "truth.json"  # what the emulated world was; dry runs only
        self.emulation = root / "emulation"  # folder of the emulators
        self.twin = root / "twin.jsonl"  # what the twin showed, a line a frame; nothing needs it
        self.watch = root / "watch.html"  # the recorded run beside a twin, with a time slider
        self.lock = root / ".lock"  # locked while a program works on this run
        self.trials = root / "trials"
        self.replays = root / "replay"
        self.report = root / "report"

    def trial(self, trial: int) -> Path:
        """Return the folder of a trial."""
        return self.trials / f"{trial:02d}"

    def attempt(self, trial: int, attempt: int) -> Path:
        """Return the folder of one attempt at a trial."""
        return self.trial(trial) / f"attempt-{attempt}"

    def recording(self, trial: int, attempt: int) -> Path:
        """Return the recording of an attempt."""
        return self.attempt(trial, attempt) / "recording.mcap"

    def result(self, trial: int, attempt: int) -> Path:
        """Return the verdict of an attempt."""
        return self.attempt(trial, attempt) / RESULT_NAME

    def spills(self, trial: int, attempt: int) -> list[Path]:
        """Return the messages that a fault kept from the recording, if any."""
        return sorted(self.attempt(trial, attempt).glob(SPILL_PATTERN))

    def spill(self, trial: int, attempt: int, source: str) -> Path:
        """Return where ``source`` (a process) writes what its recorder never acknowledged."""
        return self.attempt(trial, attempt) / SPILL_PATTERN.replace("*", source)

    def attempts(self) -> list[tuple[int, int]]:
        """Return (trial, attempt) of every attempt that has a folder, ascending."""
        names = (path.name for path in self.trials.glob("*") if path.is_dir())
        trials = sorted(int(name) for name in names if _TRIAL.fullmatch(name))
        return [(trial, attempt) for trial in trials for attempt in self.attempt_indices(trial)]

    def attempt_indices(self, trial: int) -> list[int]:
        """Return the attempts at a trial that have a folder, ascending."""
        matches = (_ATTEMPT.fullmatch(path.name) for path in self.trial(trial).glob("attempt-*"))
        return sorted(int(match.group(1)) for match in matches if match)

    def replay_json(self, name: str) -> Path:
        """Return the summary of a replay."""
        return self.replays / name / "replay.json"

    def replay_part(self, name: str, trial: int) -> Path:
        """Return what is kept of a finished part of a replay, by its first trial."""
        return self.replays / name / "parts" / f"{trial:02d}.json"

    def replay_trial(self, name: str, trial: int) -> Path:
        """Return the folder of one replayed trial: fields, surface, image, height."""
        return self.replays / name / "trials" / f"{trial:02d}"


def run_root_of(path: Path) -> Path:
    """Return the run folder that ``path`` lies in, or its own folder when it lies in none."""
    for folder in path.absolute().parents:
        if (folder / "run.json").is_file():
            return folder
    return path.parent


def run_folder(root: Path) -> RunPaths:
    """Return the places in a run's folder, which holds nothing but folders and plain files."""
    paths = RunPaths(root)
    if not any(path.is_file() for path in (paths.run_json, root / "run.json.previous")):
        raise RecordError(
            f"{root}: not a run folder: it has no run.json",
            remedy="give a folder that `tacauchy-rig run` or `dry-run` made, "
            "such as runs/20250131-101500-NAME",
        )
    check_tree(root)
    return paths
