"""Arrays of a folder: one value a pixel of the scored image. Pickles are never loaded."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Collection

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from tacauchy_rig.errors import RecordError
from tacauchy_rig.importing.source import MIB, Source

FloatArray = NDArray[np.float64]
ARRAY_BYTES = 512 * MIB
"""Of a file: 40 megapixels in double precision, and more."""
HEAD_BYTES = 4096  # in which shape and type of an array stand


def read_npy(source: Source, name: str, shape: tuple[int, int]) -> FloatArray:
    """Read an array of finite numbers of a shape.

    Raises:
        RecordError: It is none, or of another shape.
    """
    data = source.read(name, field="an array", most_bytes=ARRAY_BYTES)
    return _array(data, shape, where=name)


def read_npz(
    source: Source, name: str, shape: tuple[int, int], *, known: Collection[str]
) -> dict[str, FloatArray]:
    """Read the arrays of an archive, each as by ``read_npy``.

    Args:
        known: Names that have to be in it, and no others.

    Raises:
        RecordError: It is no archive of such arrays.
    """
    data = source.read(name, field="an archive", most_bytes=ARRAY_BYTES)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {each.filename.removesuffix(".npy"): each for each in archive.infolist()}
            for member in members.values():
                _check_size(member, name)
            if set(members) != set(known):
                raise RecordError(
                    f"{name}: holds {', '.join(sorted(members))[:200] or 'nothing'}",
                    remedy=f"what is judged, and has to be there: {', '.join(known)}",
                )
            return {
                key: _array(archive.read(member), shape, where=f"{name}, {key}")
                for key, member in members.items()
            }
    except (zipfile.BadZipFile, EOFError, NotImplementedError, OSError) as error:
        raise RecordError(
            f"{name}: no readable archive: {error}", remedy="write it with numpy.savez"
        ) from error


def _check_size(member: zipfile.ZipInfo, name: str) -> None:
    if member.file_size > ARRAY_BYTES:
        raise RecordError(
            f"{name}: {member.filename[:80]} unpacks to {member.file_size} bytes; at most "
            f"{ARRAY_BYTES} are read",
            remedy="give one value a pixel of the scored image",
        )


def _array(data: bytes, shape: tuple[int, int], *, where: str) -> FloatArray:
    """Return an array; its head is looked at before anything is made of it."""
    found, kind = _head(data, where)
    if kind.hasobject:
        raise RecordError(
            f"{where}: holds Python objects (a pickle), which are never loaded",
            remedy="save plain numbers: numpy.save(file, array.astype(float), allow_pickle=False)",
        )
    if kind.kind not in "fiu":
        raise RecordError(
            f"{where}: is of type {kind}, not of numbers", remedy="save it as float64 or float32"
        )
    if found != shape:
        raise RecordError(
            f"{where}: has the shape {list(found)}; the scored image is {list(shape)} "
            "[height, width]",
            remedy="give one value a pixel of the scored image",
        )
    try:
        array = np.load(io.BytesIO(data), allow_pickle=False).astype(np.float64)
    except (ValueError, EOFError, OSError) as error:
        raise RecordError(f"{where}: damaged: {error}", remedy="write the file again") from error
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        row, column = bad[0].tolist()
        raise RecordError(
            f"{where}: {len(bad)} of its values are no finite numbers, the first "
            f"{array[row, column]} in row {row}, column {column}",
            remedy="give every pixel a number: gel that is not touched has height 0, pressure 0",
        )
    return np.asarray(array)


def _head(data: bytes, where: str) -> tuple[tuple[int, ...], np.dtype[np.generic]]:
    """Return shape and type that an array's head states."""
    head = io.BytesIO(data[:HEAD_BYTES])
    try:
        version = npy.read_magic(head)
        read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, _, kind = read(head)
    except (ValueError, EOFError, OSError) as error:
        raise RecordError(
            f"{where}: no array of NumPy: {error}", remedy="write it with numpy.save"
        ) from error
    return shape, kind
