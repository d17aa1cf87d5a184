"""Arrays of others, alone or within archives: bounded, and never unpickled."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Mapping
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from tacauchy_rig.app.importing.source import MIB
from tacauchy_rig.core.errors import RecordError

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
    try:
        with _opened(archive, name) as found:
            return _member(found, member, name)
    except _BROKEN as error:
        raise _broken(name, error) from error


def members(archive: bytes | IO[bytes], *, name: str) -> list[str]:
    """Return the names of an archive's files.

    Raises:
        RecordError: It is no archive, or has too many.
    """
    try:
        with _opened(archive, name) as found:
            return found.namelist()
    except _BROKEN as error:
        raise _broken(name, error) from error


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
    bytes_said = math.prod(shape) * dtype.itemsize
    if min(shape, default=0) < 0 or bytes_said != len(data) - stream.tell():
        raise RecordError(
            f"{name}: says that it is {shape} of {dtype}, {bytes_said} bytes, and has "
            f"{len(data) - stream.tell()}",
            remedy="the file was cut off or edited: copy it anew from its source",
        )
    stream.seek(0)
    return np.asarray(npy.read_array(stream, allow_pickle=False))


def _opened(archive: bytes | IO[bytes], name: str) -> zipfile.ZipFile:
    found = zipfile.ZipFile(io.BytesIO(archive) if isinstance(archive, bytes) else archive)
    if len(found.filelist) > MEMBERS_MOST:
        found.close()
        raise RecordError(
            f"{name}: an archive of {len(found.filelist)} files; at most {MEMBERS_MOST} are read",
            remedy="unpack what is needed",
        )
    return found


def _member(archive: zipfile.ZipFile, member: str, name: str) -> bytes:
    try:
        info = archive.getinfo(member)
    except KeyError as error:
        raise RecordError(
            f"{name}: has no {member}", remedy="look at the archive: it is another than is said"
        ) from error
    if info.file_size > ARRAY_BYTES:
        raise RecordError(
            f"{name}: {member[:80]} unpacks to {info.file_size} bytes; at most {ARRAY_BYTES} are "
            "read",
            remedy="split it",
        )
    with archive.open(info) as file:
        return file.read(info.file_size)


def _broken(name: str, error: Exception) -> RecordError:
    return RecordError(
        f"{name}: no whole zip archive: {str(error)[:200]}", remedy="copy it anew from its source"
    )
