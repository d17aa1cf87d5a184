"""The distance to a box of twelve triangles, against the formula of a box."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
import scipy.spatial
from scipy.spatial.transform import Rotation

from sim.contact.state import ContactOptions
from sim.mesh.elements import ElementOrder
from sim.scene.indenter import MeshIndenter, mesh_indenter
from sim.solve.model import Model
from sim.studies.hard_cases.pads import brick_mesh, pad_model
from tacauchy_rig.core.arrays import FloatArray

HALF_M = np.array([2e-3, 3e-3, 4e-3])
# A barrier that reaches all around: the direction of its force tells the gradient.
REACH_M = 50e-3


@pytest.fixture(scope="module")
def model() -> Model:
    """Return a block of 12 x 12 x 4 mm, whose surface is what is measured from."""
    options = ContactOptions(distance_m=REACH_M)
    return pad_model(brick_mesh((6, 6, 4)), order=ElementOrder.P1, contact_options=options)


@pytest.fixture(scope="module")
def box() -> MeshIndenter:
    """Return the box, its tip in the middle of its underside."""
    corners = np.array(list(product((-1.0, 1.0), repeat=3))) * HALF_M
    hull = scipy.spatial.ConvexHull(corners)
    a, b, c = (corners[hull.simplices[:, k]] for k in range(3))
    outward = np.einsum("ij,ij->i", hull.equations[:, :3], np.cross(b - a, c - a)) > 0.0
    faces = np.where(outward[:, None], hull.simplices, hull.simplices[:, ::-1])
    return mesh_indenter(corners, faces, name="box")


def formula(points: FloatArray) -> FloatArray:
    """Return the signed distance to the box, in its own frame [m]."""
    beyond = np.abs(points - np.array([0.0, 0.0, HALF_M[2]])) - HALF_M
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    return np.asarray(outside + np.minimum(beyond.max(axis=-1), 0.0))


@pytest.mark.parametrize("seed", range(4))
def test_distance_and_direction_are_those_of_a_box(
    model: Model, box: MeshIndenter, seed: int
) -> None:
    """In the block at any angle, points inside it and around it: sign, size, and the way out."""
    rotation = Rotation.random(random_state=seed).as_matrix()
    # The box's middle is that of the block's top.
    tip = np.array([0.0, 0.0, model.height_m]) - rotation[:, 2] * HALF_M[2]
    state = model.rest_state(tip=tip, rotation=rotation)
    found = model.surface.forces(model.nodes, box, state, curved=False)
    gaps = model.surface.gaps(model.nodes, box, state)
    points = (found.points - tip) @ rotation
    assert gaps.min() < -1e-3
    assert gaps.max() > 1e-3
    np.testing.assert_allclose(gaps, formula(points), atol=1e-15)
    normals = -found.forces / np.linalg.norm(found.forces, axis=-1, keepdims=True)
    on_the_box = points - gaps[..., None] * (normals @ rotation)
    np.testing.assert_allclose(formula(on_the_box), 0.0, atol=1e-12)
