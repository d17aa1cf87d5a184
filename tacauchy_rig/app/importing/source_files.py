"""The folder that is imported: files and arrays of it, bounded, hashed, never unpickled."""

import io
import os
import stat
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from tacauchy_rig.core.arrays import AnyArray
from tacauchy_rig.core.errors import RecordError, RigError, whole
from tacauchy_rig.core.store.run_files import file_sha256, read_error

MIB = 2**20
IMAGE_BYTES = 64 * MIB
"""Of an image's file: 40 megapixels as PNG, noise and all, are less."""
IMAGE_PIXELS = 40_000_000
"""More than any tactile camera has; a file of a few kilobytes can claim a thousand times that."""
TABLE_BYTES = 256 * MIB
"""Of a table or a log: a kilohertz for half an hour, seven numbers a line."""
LARGE_BYTES = 8192 * MIB
"""Of a bag, a video or an archive, which is read piece by piece."""
ARRAY_BYTES = 1024 * MIB
"""Of arrays in memory: a thousand frames of 640 x 480 px in colour."""
MEMBERS_MOST = 10_000
"""Of an archive; a wheel has some dozens."""
SHOWN = 20
"""Lines that are told of one kind of problem; the rest is counted."""


class Problems:
    """Errors that were met while reading went on, each once; all are told at the end."""

    def __init__(self) -> None:
        self._found: dict[str, RigError] = {}

    def add(self, message: str, *, remedy: str) -> None:
        """Note a problem."""
        self.note(RecordError(message, remedy=remedy))

    def note(self, error: RigError) -> None:
        """Note an error."""
        self._found.setdefault(str(error), error)

    @contextmanager
    def noting(self) -> Iterator[None]:
        """Note an error of what is done within, and go on after it."""
        try:
            yield
        except RigError as error:
            self.note(error)

    @contextmanager
    def ending(self) -> Iterator[None]:
        """Note an error of what is done within, and raise it together with all others."""
        try:
            yield
        except RigError as error:
            self.note(error)
            self.refuse()

    def refuse(self) -> None:
        """Raise what was noted: the only problem, or one that lists all, by their remedies."""
        errors = list(self._found.values())
        if len(errors) == 1:
            raise errors[0]
        if not errors:
            return
        told = [
            f"{shown([each.message for each in same])}\n  -> {remedy}"
            for remedy, same in groupby(errors, key=lambda each: each.remedy)
        ]
        message, _, remedy = "\n".join([f"{len(errors)} problems", *told]).rpartition("\n  -> ")
        raise RecordError(message, remedy=remedy)


def shown(lines: Sequence[str]) -> str:
    """Return lines as one text, and how many more there are."""
    more = [f"and {len(lines) - SHOWN} more"] if len(lines) > SHOWN else []
    return "\n".join([*lines[:SHOWN], *more])


class Source:
    """A folder of somebody else's files.

    Attributes:
        root: Where it lies, links resolved.
        name: Of what is imported: the folder, or one file of it.
        hashes: SHA-256 of what was read of it, by name.
        problems: What is wrong with it, as far as it was looked at.
        notes: What was made of it, a sentence each.
    """

    def __init__(self, root: Path) -> None:
        if not root.is_dir():
            raise RecordError(f"{root}: no such folder", remedy="check the path")
        self.root = root.resolve()
        self.name = self.root.name
        self.hashes: dict[str, str] = {}
        self.problems = Problems()
        self.notes: list[str] = []

    def path(self, name: str, *, field: str, most_bytes: int) -> Path:
        """Return where a file lies, its hash noted.

        Args:
            name: Relative to the folder, as the source says it.
            field: Where it says so, for messages.
            most_bytes: That it may have.

        Raises:
            RecordError: It leads out of the folder, is missing, no plain file, empty or too large.
        """
        path = self._inside(name, field)
        try:
            found = path.lstat()
        except OSError as error:
            raise RecordError(
                f"{field}: {name!r} cannot be found in {self.root}: {error.strerror}",
                remedy="correct the name, or put the file there",
            ) from error
        if not stat.S_ISREG(found.st_mode):
            raise RecordError(f"{field}: {name!r} is no plain file", remedy="name a file")
        if not 0 < found.st_size <= most_bytes:
            raise RecordError(
                f"{field}: {name!r} has {found.st_size} bytes; 1 to {most_bytes} are read",
                remedy="check the file: it is empty or of another kind",
            )
        if name not in self.hashes:
            self.hashes[name] = file_sha256(path, what="a file of the source", links=True)
        return path

    def prefix(self, name: str, *, field: str) -> str:
        """Return what the names of a folder's files begin with; raises as ``path``."""
        folder = self._inside(name, field)
        if not folder.is_dir():
            raise RecordError(
                f"{field}: {name!r} is no folder of {self.root}", remedy="correct the name"
            )
        return "" if folder == self.root else f"{folder.relative_to(self.root)}/"

    def read(self, name: str, *, field: str, most_bytes: int) -> bytes:
        """Return a file's bytes; raises as ``path``."""
        path = self.path(name, field=field, most_bytes=most_bytes)
        try:
            return path.read_bytes()
        except OSError as error:
            raise read_error(path, error, what="a file of the source") from error

    def _inside(self, name: str, field: str) -> Path:
        """Return the path of a name within the folder; links out of it are resolved and refused."""
        remedy = f"import reads nothing outside of {self.root}: put the file there"
        if not name or "\0" in name or Path(name).is_absolute():
            raise RecordError(f"{field}: {name!r} is no name within the folder", remedy=remedy)
        path = Path(os.path.realpath(self.root / name))
        if "\\" in name and not path.exists():  # written under Windows
            path = Path(os.path.realpath(self.root / name.replace("\\", "/")))
        if not path.is_relative_to(self.root):
            raise RecordError(f"{field}: {name!r} leads out of the folder", remedy=remedy)
        return path


def at_most(most: int, found: int, told: str, *, remedy: str = "split it") -> None:
    """Refuse more than is read; the message begins with what was found."""
    if found > most:
        raise RecordError(f"{told}; at most {most} are read", remedy=remedy)


@contextmanager
def archive(data: bytes, *, name: str) -> Iterator[zipfile.ZipFile]:
    """Open a zip archive that is neither damaged nor larger than it may be."""
    with whole(name, "zip archive"), zipfile.ZipFile(io.BytesIO(data)) as found:
        count, size = len(found.filelist), sum(each.file_size for each in found.filelist)
        at_most(MEMBERS_MOST, count, f"{name}: an archive of {count} files")
        at_most(ARRAY_BYTES, size, f"{name}: unpacks to {size} bytes")
        yield found


def read_member(found: zipfile.ZipFile, member: str, *, name: str) -> bytes:
    """Return one file of an archive, no longer than it states. RecordError: It lacks the file."""
    if member not in found.namelist():
        raise RecordError(
            f"{name}: has no {member}",
            remedy=f"it holds: {', '.join(found.namelist())[:200] or 'nothing'}",
        )
    with found.open(member) as file:
        return file.read(found.getinfo(member).file_size)


def read_npz(data: bytes, *, name: str, wanted: Iterable[str] = ()) -> dict[str, AnyArray]:
    """Return some arrays of an ``.npz``, or all; raises as the functions above and below."""
    with archive(data, name=name) as found:
        arrays = wanted or [each.removesuffix(".npy") for each in found.namelist()]
        return {
            each: read_npy(read_member(found, f"{each}.npy", name=name), name=f"{name}: {each}")
            for each in arrays
        }


def read_npy(data: bytes, *, name: str) -> AnyArray:
    """Return the array of an ``.npy``'s bytes.

    Raises:
        RecordError: It is damaged, has bytes beyond its array, or is a pickle of objects.
    """
    remedy = "copy it anew, or save plain numbers or images: "
    remedy += "docs/reference/file-formats.md converts pickles"
    with whole(name, "NumPy array (pickles are never loaded)", remedy=remedy):
        stream = io.BytesIO(data)
        found = np.asarray(npy.read_array(stream, allow_pickle=False))
        if left := len(data) - stream.tell():
            raise ValueError(f"{left} bytes beyond {found.shape} of {found.dtype}")
        return found
