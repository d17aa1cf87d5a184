"""VTK's unstructured grid files (XML, base64, uncompressed), for ParaView and PyVista."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray, IntArray

TRIANGLE = 5
QUADRATIC_TRIANGLE = 22

_TYPES = {"float64": "Float64", "int64": "Int64", "uint8": "UInt8"}


def vtu_bytes(
    points: FloatArray,
    cells: IntArray,
    cell_type: int,
    *,
    point_data: Mapping[str, FloatArray],
    cell_data: Mapping[str, FloatArray],
) -> bytes:
    """Return a .vtu file of cells of one VTK type.

    Args:
        points: Positions [m], shape [point_count, 3].
        cells: Shape [cell_count, nodes of a cell].
        cell_type: VTK's number of the cell.
        point_data: Arrays with one row a point.
        cell_data: Arrays with one row a cell.
    """
    count, width = cells.shape
    connectivity = {
        "connectivity": cells.astype(np.int64).reshape(-1),
        "offsets": np.arange(1, count + 1, dtype=np.int64) * width,
        "types": np.full(count, cell_type, dtype=np.uint8),
    }
    sections = [
        _section("PointData", point_data),
        _section("CellData", cell_data),
        _section("Points", {"Points": points}),
        _section("Cells", connectivity),
    ]
    piece = f'<Piece NumberOfPoints="{len(points)}" NumberOfCells="{count}">'
    text = (
        '<?xml version="1.0"?>\n'
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
        f'header_type="UInt64"><UnstructuredGrid>{piece}\n'
        + "\n".join(sections)
        + "\n</Piece></UnstructuredGrid></VTKFile>\n"
    )
    return text.encode("ascii")


def _section(tag: str, arrays: Mapping[str, NDArray[Any]]) -> str:
    return (
        f"<{tag}>" + "".join(_array(name, values) for name, values in arrays.items()) + f"</{tag}>"
    )


def _array(name: str, values: NDArray[Any]) -> str:
    components = values.shape[1] if values.ndim == 2 else 1
    data = np.ascontiguousarray(values).tobytes()
    header = np.array([len(data)], dtype=np.uint64).tobytes()
    encoded = base64.b64encode(header).decode() + base64.b64encode(data).decode()
    return (
        f'<DataArray type="{_TYPES[values.dtype.name]}" Name="{name}" '
        f'NumberOfComponents="{components}" format="binary">{encoded}</DataArray>'
    )
