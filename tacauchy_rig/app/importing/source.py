"""The folder that is imported: files and arrays of it, bounded, hashed, never unpickled."""

from __future__ import annotations

import io
import math
import os
import stat
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from tacauchy_rig.app.importing.problems import Problems
from tacauchy_rig.core.errors import RecordError
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


class Source:
    """A folder of somebody else's files.

    Attributes:
        root: Where it lies, links resolved.
        hashes: SHA-256 of what was read of it, by name.
        problems: What is wrong with it, as far as it was looked at.
        notes: What was made of it, a sentence each.
    """

    def __init__(self, root: Path) -> None:
        if not root.is_dir():
            raise RecordError(
                f"{root}: no such folder to import", remedy="give the folder that import.toml is in"
            )
        self.root = root.resolve()
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
                remedy="look at the file: it is empty, or of another kind than is said",
            )
        if name not in self.hashes:
            self.hashes[name] = file_sha256(path, what="a file of the source", links=True)
        return path

    def folder(self, name: str, *, field: str) -> Path:
        """Return where a folder of the source lies, itself included.

        Raises:
            RecordError: It leads out of the source, or is no folder.
        """
        path = self._inside(name, field)
        if not path.is_dir():
            raise RecordError(
                f"{field}: {name!r} is no folder of {self.root}", remedy="correct the name"
            )
        return path

    def read(self, name: str, *, field: str, most_bytes: int) -> bytes:
        """Return a file's bytes; what is raised is as for ``path``."""
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


ARRAY_BYTES = 1024 * MIB
"""Of an array in memory: a thousand frames of 640 x 480 px in colour."""
MEMBERS_MOST = 10_000
"""Of an archive; a wheel has some dozens."""
_BROKEN = (zipfile.BadZipFile, OSError, NotImplementedError, RuntimeError, ValueError, EOFError)


def read_member(archive: bytes | IO[bytes], member: str, *, name: str) -> bytes:
    """Return one file of a zip archive, no larger than an array may be.

    Args:
        archive: Its bytes or its open file.
        member: The file wanted.
        name: Of the archive, for messages.

    Raises:
        RecordError: It is no archive, lacks the file, or the file is damaged or too large.
    """
    with _archive(archive, name) as found:
        if member not in found.namelist():
            raise RecordError(
                f"{name}: has no {member}", remedy="look at the archive: it is another than is said"
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


def members(archive: bytes | IO[bytes], *, name: str) -> list[str]:
    """Return the names of an archive's files; raises as ``read_member``."""
    with _archive(archive, name) as found:
        return found.namelist()


@contextmanager
def _archive(archive: bytes | IO[bytes], name: str) -> Iterator[zipfile.ZipFile]:
    """Open an archive of at most ``MEMBERS_MOST`` files; damage within ends in a RecordError."""
    stream = io.BytesIO(archive) if isinstance(archive, bytes) else archive
    try:
        with zipfile.ZipFile(stream) as found:
            if (count := len(found.filelist)) > MEMBERS_MOST:
                raise RecordError(
                    f"{name}: an archive of {count} files; at most {MEMBERS_MOST} are read",
                    remedy="unpack what is needed",
                )
            yield found
    except _BROKEN as error:
        raise RecordError(
            f"{name}: no whole zip archive: {str(error)[:200]}",
            remedy="copy it anew from its source",
        ) from error


def read_npz(data: bytes, wanted: Mapping[str, str], *, name: str) -> dict[str, NDArray[Any]]:
    """Return arrays of an ``.npz``.

    Args:
        wanted: What each array is that is needed, by its name.
        name: Of the file, for messages.

    Raises:
        RecordError: It is no such archive; an array is missing, damaged, too large or of objects.
    """
    there = members(data, name=name)
    for array, what in wanted.items():
        if f"{array}.npy" not in there:
            raise RecordError(
                f"{name}: has no array {array} ({what})",
                remedy=f"it holds: {', '.join(there)[:200] or 'nothing'}",
            )
    return {
        array: read_npy(read_member(data, f"{array}.npy", name=name), name=f"{name}: {array}")
        for array in wanted
    }


def read_npy(data: bytes, *, name: str) -> NDArray[Any]:
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
    except (ValueError, EOFError, SyntaxError, TypeError, MemoryError, RecursionError) as error:
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
