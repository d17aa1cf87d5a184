"""Reads triangles from STL (binary or text) and OBJ files, in double precision and file units."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from sim.arrays import FloatArray, IntArray
from tacauchy_rig.errors import ConfigError

_HEADER = 84
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_EXPORT = "export the part again, as binary STL"


def read_triangles(path: Path) -> tuple[FloatArray, IntArray]:
    """Read a file of triangles; polygons of an OBJ are cut into fans.

    Returns:
        Vertices in the file's own unit, shape [vertex_count, 3], corners of neighbouring triangles
        not merged; and faces, shape [face_count, 3].

    Raises:
        ConfigError: The file is missing, damaged, empty, or of another kind.
    """
    kind = path.suffix.lower()
    if kind not in (".stl", ".obj"):
        raise ConfigError(
            f"{path}: {kind or 'a file without an ending'} is no kind of triangle file known here",
            remedy="give an .stl or .obj file",
        )
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError(
            f"{path} cannot be read: {error.strerror}", remedy="check the path"
        ) from error
    vertices, faces = _read_obj(data, path) if kind == ".obj" else _read_stl(data, path)
    if not len(faces):
        raise ConfigError(f"{path} holds no triangle", remedy=_EXPORT)
    if not np.isfinite(vertices).all():
        raise ConfigError(f"{path} has coordinates that are not finite", remedy=_EXPORT)
    return vertices, faces


def _read_stl(data: bytes, path: Path) -> tuple[FloatArray, IntArray]:
    # Binary files may start with "solid" too, so the length decides before the first word does.
    stated = int.from_bytes(data[_HEADER - 4 : _HEADER], "little") if len(data) >= _HEADER else 0
    if stated and len(data) == _HEADER + stated * _RECORD.itemsize:
        corners = np.frombuffer(data, dtype=_RECORD, offset=_HEADER)["corners"]
    elif data.lstrip()[:5].lower() == b"solid" and b"facet" in data:
        corners = _read_text_stl(data, path)
    else:
        raise ConfigError(
            f"{path} is no whole STL file: {len(data)} bytes, where its header states {stated} "
            f"triangles, {_HEADER + stated * _RECORD.itemsize} bytes",
            remedy=_EXPORT,
        )
    vertices = corners.reshape(-1, 3).astype(np.float64)
    return vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)


def _read_text_stl(data: bytes, path: Path) -> FloatArray:
    numbers = []
    for count, line in enumerate(data.decode("ascii", "replace").splitlines(), start=1):
        words = line.split()
        if words and words[0].lower() == "vertex":
            numbers.append(_coordinates(words[1:], path, count))
    if len(numbers) % 3 or not data.rstrip().splitlines()[-1].lower().startswith(b"endsolid"):
        raise ConfigError(
            f"{path} ends after {len(numbers)} corners, in the middle of its solid", remedy=_EXPORT
        )
    return np.array(numbers, dtype=np.float64)


def _read_obj(data: bytes, path: Path) -> tuple[FloatArray, IntArray]:
    vertices: list[tuple[float, ...]] = []
    faces: list[tuple[int, int, int]] = []
    for count, line in enumerate(data.decode("utf-8", "replace").splitlines(), start=1):
        words = line.split("#")[0].split()
        if words and words[0] == "v":
            vertices.append(_coordinates(words[1:4], path, count))
        elif words and words[0] == "f":
            corners = [_index(word, len(vertices), path, count) for word in words[1:]]
            faces += [(corners[0], b, c) for b, c in pairwise(corners[1:])]
    return (
        np.array(vertices, dtype=np.float64).reshape(-1, 3),
        np.array(faces, dtype=np.int32).reshape(-1, 3),
    )


def _coordinates(words: list[str], path: Path, line: int) -> tuple[float, ...]:
    try:
        found = tuple(float(word) for word in words)
    except ValueError:
        found = ()
    if len(found) != 3:
        raise ConfigError(
            f"{path}, line {line}: {' '.join(words)!r} are not three coordinates", remedy=_EXPORT
        )
    return found


def _index(word: str, vertex_count: int, path: Path, line: int) -> int:
    """Return the vertex that one corner of an OBJ face names; negative counts from the end."""
    text = word.split("/", maxsplit=1)[0]
    number = int(text) if text.lstrip("-").isdigit() else 0
    index = number - 1 if number > 0 else vertex_count + number
    if number == 0 or not 0 <= index < vertex_count:
        raise ConfigError(
            f"{path}, line {line}: corner {word!r} names none of the {vertex_count} vertices "
            "before it",
            remedy=_EXPORT,
        )
    return index
