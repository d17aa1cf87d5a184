"""The stress on a batch's surface under a uniform deformation, whose every number is known."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from sim.batch.kernels.element_forces import batch_gel
from sim.batch.kernels.surface_stress import StressExtraction
from sim.device import Device
from sim.mesh.elements import ElementOrder
from tests.sim.batch.kernels.small_pad import block, rows_of

# Nothing moves at the clamped base: u = z a.
LEAN = np.array([0.1, -0.05, -0.2])
F = np.eye(3) + np.outer(LEAN, [0.0, 0.0, 1.0])


@pytest.mark.parametrize("order", list(ElementOrder))
def test_traction_is_the_laws_stress_on_faces_that_went_along(order: ElementOrder) -> None:
    """Areas and normals by Nanson's formula, tractions sigma n, twice that at twice E."""
    model, device = block(order), Device("cpu")
    numbered, values = rows_of(model, model.nodes[:, 2:] * LEAN)
    pad, young = model.discretisation, model.young_pa
    materials = [(young, model.poisson), (2.0 * young, model.poisson)]
    extraction = StressExtraction(
        pad,
        numbered,
        model.law,
        batch_gel(pad, numbered, model.law, materials, device),
        device.array(np.stack([values, values]), wp.float64),
        environment_count=2,
        device=device,
    )
    extraction.launch()
    corners = model.nodes[pad.faces[:, :3]]
    rest = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    vectors = np.linalg.det(F) * rest @ np.linalg.inv(F)
    areas = np.linalg.norm(vectors, axis=1)
    normals = vectors / areas[:, None]
    sigma = model.gel.cauchy_stress(model.nodes @ F.T)[0, 0]
    for stiffer, found in zip((1.0, 2.0), extraction.fetch(), strict=True):
        traction = stiffer * normals @ sigma
        size = np.abs(traction).max()
        along = np.einsum("fi,fi->f", traction, normals)
        np.testing.assert_allclose(found.areas_m2, areas, rtol=1e-9)
        np.testing.assert_allclose(found.normals, normals, atol=1e-9)
        np.testing.assert_allclose(found.traction_pa, traction, atol=1e-9 * size)
        np.testing.assert_allclose(found.normal_pa, along, atol=1e-9 * size)
        np.testing.assert_allclose(
            found.tangential_pa, traction - along[:, None] * normals, atol=1e-9 * size
        )
