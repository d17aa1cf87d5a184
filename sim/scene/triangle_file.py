"""Reads triangles from STL (binary or text) and OBJ files."""

from __future__ import annotations

import importlib
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError

_EXPORT = "export the part again, as binary STL"


class MeshUnit(StrEnum):
    """Unit of a mesh file's coordinates; the files themselves name none."""

    MICROMETRE = "um"
    MILLIMETRE = "mm"
    CENTIMETRE = "cm"
    METRE = "m"
    INCH = "in"

    @property
    def metres(self) -> float:
        """Length of the unit [m]."""
        return {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 25.4e-3}[self.value]


def read_triangles(path: Path, unit: MeshUnit) -> tuple[FloatArray, IntArray]:
    """Read vertices [m] and faces from a file of triangles; polygons of an OBJ are cut into them.

    Coordinates of an STL are of single precision, as its binary form has them. Corners of
    neighbouring triangles are not merged.

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
        path.open("rb").close()
    except OSError as error:
        raise ConfigError(
            f"{path} cannot be read: {error.strerror}", remedy="check the path"
        ) from error
    vertices, faces = _read(path)
    if not len(faces):
        raise ConfigError(f"{path} holds no triangle", remedy=_EXPORT)
    if not np.isfinite(vertices).all():
        raise ConfigError(f"{path} has coordinates that are not finite", remedy=_EXPORT)
    return vertices * unit.metres, faces


def _read(path: Path) -> tuple[FloatArray, IntArray]:
    # Here, since importing it takes a second that most presses need not spend.
    pyvista = importlib.import_module("pyvista")
    reader = pyvista.get_reader(str(path)).reader
    if path.suffix.lower() == ".stl":
        reader.MergingOff()
    complaints: list[str] = []

    def note(_source: Any, _event: str, text: str) -> None:
        complaints.append(text)

    note.CallDataType = "string0"  # type: ignore[attr-defined]
    # Unobserved, VTK prints what is wrong with a file and goes on.
    for source in (reader, reader.GetExecutive()):
        source.AddObserver("ErrorEvent", note)
    reader.AddObserver("WarningEvent", lambda *_: None)
    reader.Update()
    if complaints:
        # "ERROR: In FILE, line N", then "vtkSTLReader (0x...): what is wrong".
        why = complaints[0].strip().split("): ", maxsplit=1)[-1].rstrip(".")
        raise ConfigError(
            f"{path} of {path.stat().st_size} bytes is damaged or no "
            f"{path.suffix[1:].upper()} file: {why}",
            remedy=_EXPORT,
        )
    found = reader.GetOutput()
    corners, count = found.GetPolys().GetConnectivityArray(), found.GetNumberOfPoints()
    if corners.GetNumberOfValues() and corners.GetRange()[1] >= count:
        raise ConfigError(
            f"{path}: a corner names vertex {corners.GetRange()[1] + 1:g} of {count}",
            remedy=_EXPORT,
        )
    mesh = pyvista.wrap(found)
    if not mesh.is_all_triangles:
        mesh = mesh.triangulate()
    faces = mesh.faces.reshape(-1, 4)[:, 1:]
    return np.array(mesh.points, dtype=np.float64), faces.astype(np.int32)
