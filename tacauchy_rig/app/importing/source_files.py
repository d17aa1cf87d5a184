"""The folder that is imported: files and arrays of it, bounded, hashed, never unpickled."""

import io
import math
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
from tacauchy_rig.core.errors import RecordError, RigError
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
"""Of an array in memory: a thousand frames of 640 x 480 px in colour."""
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
        with self.noting():
            raise RecordError(message, remedy=remedy)

    @contextmanager
    def noting(self) -> Iterator[None]:
        """Note an error of what is done within, and go on after it."""
        try:
            yield
        except RigError as error:
            self._found.setdefault(str(error), error)

    def refuse(self) -> None:
        """Raise what was noted, if anything was."""
        if self._found:
            raise self.all_in_one

    @property
    def all_in_one(self) -> RigError:
        """The only problem as it was, or one that lists all, those of one remedy together."""
        errors = list(self._found.values())
        if len(errors) == 1:
            return errors[0]
        told = [
            f"{shown([each.message for each in same])}\n  -> {remedy}"
            for remedy, same in groupby(errors, key=lambda each: each.remedy)
        ]
        message, _, remedy = "\n".join([f"{len(errors)} problems", *told]).rpartition("\n  -> ")
        return RecordError(message, remedy=remedy)


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

    def folder(self, name: str, *, field: str) -> Path:
        """Return where a folder lies, the source's own included; raises as ``path``."""
        path = self._inside(name, field)
        if not path.is_dir():
            raise RecordError(
                f"{field}: {name!r} is no folder of {self.root}", remedy="correct the name"
            )
        return path

    def prefix(self, name: str, *, field: str) -> str:
        """Return what the names of a folder's files begin with; raises as ``path``."""
        folder = self.folder(name, field=field)
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


@contextmanager
def _archive(data: bytes, name: str) -> Iterator[zipfile.ZipFile]:
    """Open a zip archive of at most ``MEMBERS_MOST`` files; damage ends in a RecordError."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as found:
            if (count := len(found.filelist)) > MEMBERS_MOST:
                raise RecordError(
                    f"{name}: an archive of {count} files; at most {MEMBERS_MOST} are read",
                    remedy="unpack what is needed",
                )
            yield found
    except RigError:
        raise
    except Exception as error:
        raise RecordError(
            f"{name}: no whole zip archive: {str(error)[:200]}",
            remedy="copy it anew from its source",
        ) from error


def members(data: bytes, *, name: str) -> list[str]:
    """Return the names of the files in an archive of that name."""
    with _archive(data, name) as found:
        return found.namelist()


def read_member(data: bytes, member: str, *, name: str) -> bytes:
    """Return one file of a zip archive, no larger than an array may be.

    Raises:
        RecordError: It is no archive, lacks the file, or the file is damaged or too large.
    """
    with _archive(data, name) as found:
        if member not in found.namelist():
            raise RecordError(
                f"{name}: has no {member}",
                remedy=f"it holds: {', '.join(found.namelist())[:200] or 'nothing'}",
            )
        info = found.getinfo(member)
        if info.file_size > ARRAY_BYTES:
            raise RecordError(
                f"{name}: {member[:80]} unpacks to {info.file_size} bytes; at most {ARRAY_BYTES} "
                "are read",
                remedy="split it",
            )
        with found.open(info) as file:
            return file.read(info.file_size)


def array_names(data: bytes, *, name: str) -> list[str]:
    """Return the names of an ``.npz``'s arrays."""
    return [each.removesuffix(".npy") for each in members(data, name=name)]


def read_npz(data: bytes, arrays: Iterable[str], *, name: str) -> dict[str, AnyArray]:
    """Return arrays of an ``.npz`` of a name; raises as ``read_member`` and ``read_npy``."""
    return {
        array: read_npy(read_member(data, f"{array}.npy", name=name), name=f"{name}: {array}")
        for array in arrays
    }


def read_npy(data: bytes, *, name: str) -> AnyArray:
    """Return the array of an ``.npy``'s bytes.

    Its head is read first: an array of objects is a pickle, which is never loaded, and one that
    says to be larger than its bytes is never made room for.

    Raises:
        RecordError: It is damaged, or of objects.
    """
    stream = io.BytesIO(data)
    try:
        version = npy.read_magic(stream)
        read_head = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, _, dtype = read_head(stream)
    except Exception as error:
        raise RecordError(
            f"{name}: no array of NumPy's ({len(data)} bytes): {str(error)[:200]}",
            remedy="save it anew with numpy.save",
        ) from error
    if dtype.hasobject:
        raise RecordError(
            f"{name}: an array of Python objects, which is a pickle; pickles are never loaded",
            remedy="save plain numbers or images: numpy.save(..., allow_pickle=False)",
        )
    stated_bytes = math.prod(shape) * dtype.itemsize
    if min(shape, default=0) < 0 or stated_bytes != len(data) - stream.tell():
        raise RecordError(
            f"{name}: says that it is {shape} of {dtype}, {stated_bytes} bytes, and has "
            f"{len(data) - stream.tell()}",
            remedy="the file was cut off or edited: copy it anew from its source",
        )
    stream.seek(0)
    return np.asarray(npy.read_array(stream, allow_pickle=False))
