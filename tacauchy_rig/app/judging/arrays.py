"""Arrays of a folder: one value a pixel of the scored image."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from tacauchy_rig.app.importing.archive import ARRAY_BYTES, members, read_member, read_npy
from tacauchy_rig.app.importing.source import Source
from tacauchy_rig.core.arrays import AnyArray, FloatArray
from tacauchy_rig.core.errors import RecordError

NPY = ".npy"


def read_pixels(source: Source, name: str, shape: tuple[int, int]) -> FloatArray:
    """Read an array of finite numbers, one a pixel.

    Raises:
        RecordError: It is none, or of another shape.
    """
    data = source.read(name, field="an array", most_bytes=ARRAY_BYTES)
    return _pixels(read_npy(data, name=name), shape, where=name)


def read_fields(
    source: Source, name: str, shape: tuple[int, int], *, known: Collection[str]
) -> dict[str, FloatArray]:
    """Read the arrays of an archive, each as by ``read_pixels``.

    Args:
        known: Names that may be in it, and no others.

    Raises:
        RecordError: It is no archive of such arrays.
    """
    data = source.read(name, field="an archive", most_bytes=ARRAY_BYTES)
    there = sorted(each.removesuffix(NPY) for each in members(data, name=name))
    if not there or not set(there) <= set(known):
        raise RecordError(
            f"{name}: holds {', '.join(there)[:200] or 'nothing'}",
            remedy=f"what is judged: {', '.join(known)}",
        )
    found: dict[str, FloatArray] = {}
    for key in there:
        where = f"{name}, {key}"
        member = read_member(data, f"{key}{NPY}", name=name)
        found[key] = _pixels(read_npy(member, name=where), shape, where=where)
    return found


def _pixels(array: AnyArray, shape: tuple[int, int], *, where: str) -> FloatArray:
    if array.dtype.kind not in "fiu":
        raise RecordError(
            f"{where}: is of type {array.dtype}, not of numbers",
            remedy="save it as float64 or float32",
        )
    if array.shape != shape:
        raise RecordError(
            f"{where}: has the shape {list(array.shape)}; the scored image is {list(shape)} "
            "[height, width]",
            remedy="give one value a pixel of the scored image",
        )
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        row, column = bad[0].tolist()
        raise RecordError(
            f"{where}: {len(bad)} of its values are no finite numbers, the first "
            f"{array[row, column]} in row {row}, column {column}",
            remedy="give every pixel a number: gel that is not touched has height 0, pressure 0",
        )
    return array.astype(np.float64)
