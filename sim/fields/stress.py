"""Cauchy stress on the gel's surface (paper, Algorithm 1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from sim.device import Device, on_host
from sim.fields.projection_kernel import projection_kernel
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceStress:
    """Algorithm 1 on every face that is not clamped, shape [face_count, ...].

    Attributes:
        traction_pa: t = sigma n, sigma of the parent tetrahedron (mean over its points).
        normal_pa: p_n = t . n; negative is compression.
        tangential_pa: t - p_n n.
    """

    normals: FloatArray
    areas_m2: FloatArray
    traction_pa: FloatArray
    normal_pa: FloatArray
    tangential_pa: FloatArray


def surface_stress(model: Model, positions: FloatArray) -> SurfaceStress:
    """Project the elements' stress onto the surface (paper, Algorithm 1, Eq. 5-7)."""
    at = Device(model.device).array(positions[None], wp.vec3d)
    projection = StressProjection(model, at)
    projection.launch()
    return projection.fetch()[0]


class StressProjection:
    """Finds the stress on the surface of many environments where their nodes are on the device.

    Args:
        positions: Nodes [m], shape [environment_count, node_count], on the model's device.
        gel: Elements of the environments, as ``ElasticBody.of`` gives them; None is the model's.

    Attributes:
        found: On the device, shape [environment_count, face_count, 11]: normal, area [m^2],
            traction, its normal and its tangential part [Pa].
    """

    def __init__(self, model: Model, positions: Any, *, gel: Any = None) -> None:
        self._model, self._positions, self._gel = model, positions, gel
        device, count = Device(model.device), positions.shape[0]
        self.found = device.zeros((count, len(model.faces), 11), wp.float64)
        self._stress = model.gel.stress_room(count)
        weights = device.array(model.reference.weights, wp.float64)
        faces = device.array(model.faces, wp.int32), device.array(model.face_parents, wp.int32)
        kernel, shape = projection_kernel(model.reference.order), self.found.shape[:2]
        inputs = [*faces, weights, self._stress, positions]
        self._project = device.record(kernel, shape, [*inputs, self.found])

    def launch(self) -> None:
        """Find it where the nodes are now."""
        self._model.gel.find_stress(self._positions, self._stress, gel=self._gel)
        self._project.launch()

    def fetch(self) -> list[SurfaceStress]:
        """Return what the last launch found, environment by environment."""
        return [
            SurfaceStress(
                normals=each[:, :3],
                areas_m2=each[:, 3],
                traction_pa=each[:, 4:7],
                normal_pa=each[:, 7],
                tangential_pa=each[:, 8:],
            )
            for each in np.array(on_host(self.found))
        ]
