"""A plane cut through the deformed gel, with its Cauchy stress."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.fields.stress import element_stress
from sim.solve.model import Model

# Just beside the plane, so that no node lies on it.
_BESIDE_SHARE = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """Triangles of the plane y = const, three points each.

    Attributes:
        points_m: x and z [m], shape [point_count, 2].
        triangles: Shape [triangle_count, 3].
        stress_pa: sigma [Pa], averaged at the nodes of each layer, shape [point_count, 3, 3].
        layers: Of each triangle, shape [triangle_count].
    """

    points_m: FloatArray
    triangles: IntArray
    stress_pa: FloatArray
    layers: IntArray

    def without_slivers(self, thickness_m: float) -> Section:
        """Leave out what is thinner than that [m]: hairlines in a picture.

        Tetrahedra that meet the plane in no more than an edge give such triangles.
        """
        corners = self.points_m[self.triangles]
        sides = corners - np.roll(corners, 1, axis=1)
        doubled = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
        kept = doubled > thickness_m * np.linalg.norm(sides, axis=2).max(axis=1)
        return replace(self, triangles=self.triangles[kept], layers=self.layers[kept])


def cut(model: Model, positions: FloatArray, *, y_m: float = 0.0) -> Section:
    """Cut the deformed pad by a plane across y; edges count as straight."""
    corners = model.elements[:, :4]
    places = positions[corners]
    values = _corner_stress(model, positions)
    height = places[..., 1] - y_m - _BESIDE_SHARE * model.height_m
    order = np.argsort(height, axis=1).astype(np.int32)
    places, height = (np.take_along_axis(a, _like(order, a), axis=1) for a in (places, height))
    values = np.take_along_axis(values, order[..., None, None], axis=1)
    below = np.count_nonzero(height < 0.0, axis=1)
    labels = _labels(model)
    shapes = {1: ((0, 1), (0, 2), (0, 3)), 3: ((0, 3), (1, 3), (2, 3))}
    quad = ((0, 2), (0, 3), (1, 3), (1, 2))
    pieces = [(below == count, edges) for count, edges in shapes.items()]
    pieces += [(below == 2, quad[:3]), (below == 2, (quad[0], quad[2], quad[3]))]
    points, stress, layers = [], [], []
    for chosen, edges in pieces:
        layers.append(labels[chosen])
        for a, b in edges:
            share = height[chosen, a] / (height[chosen, a] - height[chosen, b])
            points.append(_between(places[chosen], a, b, share))
            stress.append(_between(values[chosen], a, b, share))
    counts = [len(piece) for piece in layers]
    grouped = [_grouped(points, k) for k in range(len(counts))]
    at = np.concatenate(grouped).reshape(-1, 3)
    found = np.concatenate([_grouped(stress, k) for k in range(len(counts))]).reshape(-1, 3, 3)
    return Section(
        points_m=at[:, [0, 2]],
        triangles=np.arange(len(at), dtype=np.int32).reshape(-1, 3),
        stress_pa=found,
        layers=np.concatenate(layers),
    )


def _grouped(pieces: list[FloatArray], index: int) -> FloatArray:
    return np.stack(pieces[3 * index : 3 * index + 3], axis=1)


def _between(values: FloatArray, a: int, b: int, share: FloatArray) -> FloatArray:
    weight = share.reshape(-1, *[1] * (values.ndim - 2))
    return np.asarray(values[:, a] + weight * (values[:, b] - values[:, a]))


def _like(order: IntArray, values: FloatArray) -> IntArray:
    return order.reshape(*order.shape, *[1] * (values.ndim - 2))


def _labels(model: Model) -> IntArray:
    layers = model.mesh.layers
    return np.zeros(len(model.elements), dtype=np.int32) if layers is None else layers


def _corner_stress(model: Model, positions: FloatArray) -> FloatArray:
    """Return the mean over the elements of one layer that meet, shape [element_count, 4, 3, 3]."""
    stress = element_stress(model, positions)
    keys = model.elements[:, :4] + len(model.nodes) * _labels(model)[:, None]
    _, index = np.unique(keys, return_inverse=True)
    index = index.reshape(keys.shape)
    total = np.zeros((index.max() + 1, 3, 3))
    count = np.zeros(len(total))
    for k in range(4):
        np.add.at(total, index[:, k], stress)
        np.add.at(count, index[:, k], 1.0)
    return np.asarray((total / count[:, None, None])[index])
