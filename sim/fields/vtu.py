"""Files for ParaView: the gel's surface, the whole gel with its Cauchy stress, the indenter."""

from __future__ import annotations

import importlib
from collections.abc import Mapping

import numpy as np

from sim.fields.stress import cauchy_stress, components
from sim.fields.surface import SurfaceState
from sim.mesh.symmetry import WholeSurface
from sim.scene.indenter import MeshIndenter, ring_walls
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from tacauchy_rig.core.arrays import FloatArray, IntArray

# VTK's names of cells by their nodes: faces and tetrahedra, linear and quadratic.
_CELLS = {3: "TRIANGLE", 6: "QUADRATIC_TRIANGLE", 4: "TETRA", 10: "QUADRATIC_TETRA"}
# An analytic indenter's underside is drawn with so many rings and sectors.
_RINGS, _SECTORS = 60, 96
# Just inside a rim, beside which there is no underside.
_INSIDE = 1.0 - 1e-9
# Of the gel's largest coordinate: so wide a plate is drawn.
_PLATE_SHARE = 0.8


def vtu(
    cells: IntArray,
    points: FloatArray,
    on_points: Mapping[str, FloatArray],
    on_cells: Mapping[str, FloatArray],
) -> bytes:
    """Return a .vtu file of faces or tetrahedra.

    Args:
        cells: Shape [cell_count, node_count].
        points: Shape [point_count, 3] [m].
    """
    # Here, since importing it takes a second, and a press alone writes no file.
    pyvista = importlib.import_module("pyvista")
    kind = getattr(pyvista.CellType, _CELLS[cells.shape[1]])
    grid = pyvista.UnstructuredGrid({kind: cells}, points)
    grid.point_data.update(on_points)
    grid.cell_data.update(on_cells)
    writer = importlib.import_module("vtkmodules.vtkIOXML").vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetDataModeToBinary()
    writer.WriteToOutputStringOn()
    writer.Write()
    return str(writer.GetOutputString()).encode("ascii")


def gel_vtu(model: Model, point: PathPoint) -> bytes:
    """Return the whole deformed gel with its Cauchy stress at nodes and in cells, and its error."""
    stress = cauchy_stress(model, point.state.positions)
    whole = WholeSurface(model.mesh.symmetry, model.nodes)
    on_points = {
        "displacement_m": whole.at_nodes(point.state.positions - model.nodes),
        "cauchy_stress_pa": components(whole.at_nodes(stress.nodes_pa)),
    }
    on_cells = {
        "cauchy_stress_pa": components(whole.at_faces(stress.cells_pa)),
        "cauchy_stress_error_pa": whole.at_faces(stress.errors_pa),
    }
    return vtu(
        whole.faces(model.elements), whole.at_nodes(point.state.positions), on_points, on_cells
    )


def indenter_vtu(surface: SurfaceState) -> bytes:
    """Return the indenter's surface where it stands: of an analytic body the side that presses."""
    indenter = surface.indenter
    if isinstance(indenter, MeshIndenter):
        points, faces = indenter.surface.vertices, indenter.surface.faces
    else:
        widest = getattr(indenter, "radius_m", _PLATE_SHARE * np.abs(surface.positions).max())
        radii = widest * np.sin(0.5 * np.pi * np.arange(_RINGS + 1) / _RINGS)
        angles = 2.0 * np.pi * np.arange(_SECTORS) / _SECTORS
        x, y = (np.outer(radii, each).reshape(-1) for each in (np.cos(angles), np.sin(angles)))
        points = np.column_stack([x, y, indenter.lower_surface(x * _INSIDE, y * _INSIDE)])
        faces = ring_walls(np.arange(len(points), dtype=np.int32).reshape(-1, _SECTORS))
    placed = points @ surface.indenter_rotation.T + surface.indenter_position
    return vtu(np.asarray(faces, dtype=np.int32), placed, {}, {})
