"""A plane cut through the deformed gel, with its Cauchy stress."""

from __future__ import annotations

import importlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim.fields.stress_field import recovered_stress
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray, IntArray

# Just beside the plane, so that no node lies on it.
_BESIDE_SHARE = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaneCut:
    """Triangles of the plane y = const.

    Attributes:
        points_m: x and z [m], shape [point_count, 2].
        triangles: Shape [triangle_count, 3].
        stress_pa: sigma [Pa], recovered in each layer, shape [point_count, 3, 3].
        layers: Of each triangle, shape [triangle_count].
    """

    points_m: FloatArray
    triangles: IntArray
    stress_pa: FloatArray
    layers: IntArray

    def without_slivers(self, thickness_m: float) -> PlaneCut:
        """Leave out what is thinner than that [m]: hairlines in a picture.

        Tetrahedra that meet the plane in no more than an edge give such triangles.
        """
        corners = self.points_m[self.triangles]
        sides = corners - np.roll(corners, 1, axis=1)
        doubled = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
        kept = doubled > thickness_m * np.linalg.norm(sides, axis=2).max(axis=1)
        return replace(self, triangles=self.triangles[kept], layers=self.layers[kept])


def cut(model: Model, positions: FloatArray, *, y_m: float = 0.0) -> PlaneCut:
    """Cut the deformed pad by a plane across y; edges count as straight."""
    layers = model.mesh.layers
    labels = np.zeros(len(model.elements), dtype=np.int32) if layers is None else layers
    points: list[FloatArray] = []
    triangles, values, found = [], [], []
    for layer in range(int(labels.max()) + 1):
        own = labels == layer
        plane_m = y_m + _BESIDE_SHARE * model.height_m
        stress = recovered_stress(model, positions, own)
        surface = _cut_layer(positions, model.elements[own, :4], stress, plane_m)
        faces = surface.faces.reshape(-1, 4)[:, 1:] + sum(len(each) for each in points)
        points.append(np.asarray(surface.points[:, [0, 2]], dtype=np.float64))
        triangles.append(faces.astype(np.int32))
        values.append(np.asarray(surface.point_data["stress"]).reshape(-1, 3, 3))
        found.append(np.full(len(faces), layer, dtype=np.int32))
    return PlaneCut(
        points_m=np.concatenate(points),
        triangles=np.concatenate(triangles),
        stress_pa=np.concatenate(values),
        layers=np.concatenate(found),
    )


def _cut_layer(positions: FloatArray, tets: IntArray, stress: FloatArray, y_m: float) -> Any:
    """Return VTK's cut through one layer, with the stress at its vertices."""
    pyvista = importlib.import_module("pyvista")
    nodes, corners = np.unique(tets, return_inverse=True)
    cells = {pyvista.CellType.TETRA: corners.reshape(tets.shape)}
    grid = pyvista.UnstructuredGrid(cells, positions[nodes])
    grid.point_data["stress"] = stress[nodes].reshape(-1, 9)
    return grid.slice(normal="y", origin=(0.0, y_m, 0.0), generate_triangles=True)
