"""Distance to indenters: analytic, of triangles, and where they first touch a domed gel."""

import math
from itertools import product

import numpy as np
import pytest
import scipy.spatial
import warp as wp
from scipy.spatial.transform import Rotation

from sim.contact.barrier_and_friction_kernels import Seen
from sim.contact.first_touch import first_touch
from sim.contact.indenter_distance import poses_at
from sim.contact.surface_and_grip import ContactOptions
from sim.device import Device
from sim.mesh.elements import ElementOrder
from sim.scene.indenter import (
    Cylinder,
    Indenter,
    IndenterSet,
    MeshIndenter,
    Sphere,
    TurnedIndenter,
    cylinder_triangles,
    mesh_indenter,
    tilted,
)
from sim.scene.objects import OBJECTS
from sim.sensor.sensor import load_sensor
from sim.solve.model import Model
from sim.studies.hard_cases.small_pads import brick_mesh, pad_model
from sim.studies.verification.height_map import chisel
from tacauchy_rig.core.arrays import FloatArray

PUNCH = Cylinder(diameter_m=4e-3)
# The chord of one of 256 sides is farther in than the circle by r (1 - cos(pi / 256)).
SAGITTA_M = PUNCH.radius_m * (1.0 - np.cos(np.pi / 256))
# A barrier that reaches all around: within it gaps are exact, and the direction of its force tells
# the gradient.
REACH_M = 50e-3


@pytest.fixture(scope="module")
def model() -> Model:
    """Return a block whose surface is what is measured from."""
    options = ContactOptions(distance_m=REACH_M)
    return pad_model(brick_mesh((4, 4, 2)), order=ElementOrder.P1, contact_options=options)


@pytest.fixture(scope="module")
def triangles() -> Indenter:
    """Return the punch as triangles."""
    return mesh_indenter(*cylinder_triangles(PUNCH), name="punch")


def _gaps(model: Model, indenter: Indenter, tip: FloatArray, rotation: FloatArray) -> FloatArray:
    state = model.rest_state(tip=tip, rotation=rotation)
    return model.surface.gaps(model.nodes, indenter, state)


@pytest.mark.parametrize("depth_m", [-0.5e-3, 0.3e-3])
@pytest.mark.parametrize("tilt_rad", [(0.0, 0.0), (0.1, -0.2)])
def test_triangles_are_as_far_as_the_formula(
    model: Model, triangles: Indenter, depth_m: float, tilt_rad: tuple[float, float]
) -> None:
    """Above the pad and in it, upright and tilted, to the facets' distance from the circle."""
    tip, rotation = np.array([0.2e-3, 0.1e-3, model.height_m - depth_m]), tilted(*tilt_rad)
    exact = _gaps(model, PUNCH, tip, rotation)
    found = _gaps(model, triangles, tip, rotation)
    assert np.abs(found - exact).max() <= 1.01 * SAGITTA_M


def test_a_gap_is_one_away_from_its_body(model: Model, triangles: Indenter) -> None:
    """No two points' gaps differ by more than the points are apart, and lifting adds the lift."""
    high = np.array([0.0, 0.0, model.height_m + 1e-3])
    low_gaps = _gaps(model, triangles, high, np.eye(3))
    lifted = _gaps(model, triangles, high + np.array([0.0, 0.0, 1e-3]), np.eye(3))
    assert np.all(lifted - low_gaps <= 1e-3 * (1.0 + 1e-9))
    under = np.isclose(low_gaps, 1e-3, rtol=1e-9)
    assert under.any()
    np.testing.assert_allclose(lifted[under], 2e-3, rtol=1e-9)


HALF_M = np.array([2e-3, 3e-3, 4e-3])


@pytest.fixture(scope="module")
def wide_block() -> Model:
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
    wide_block: Model, box: MeshIndenter, seed: int
) -> None:
    """In the block at any angle, points inside it and around it: sign, size, and the way out."""
    rotation = Rotation.random(random_state=seed).as_matrix()
    # The box's middle is that of the block's top.
    tip = np.array([0.0, 0.0, wide_block.height_m]) - rotation[:, 2] * HALF_M[2]
    state = wide_block.rest_state(tip=tip, rotation=rotation)
    found = wide_block.surface.forces(wide_block.nodes, box, state)
    gaps = wide_block.surface.gaps(wide_block.nodes, box, state)
    points = (found.points - tip) @ rotation
    assert gaps.min() < -1e-3
    assert gaps.max() > 1e-3
    np.testing.assert_allclose(gaps, formula(points), atol=1e-15)
    normals = -found.forces / np.linalg.norm(found.forces, axis=-1, keepdims=True)
    on_the_box = points - gaps[..., None] * (normals @ rotation)
    np.testing.assert_allclose(formula(on_the_box), 0.0, atol=1e-12)


@pytest.mark.parametrize("name", ["ring", "cross"])
def test_gaps_beyond_the_barrier_are_no_larger_than_they_are(wide_block: Model, name: str) -> None:
    """Within it and inside they are exact, in a hole and a corner too, and where they are kept."""
    usual = pad_model(brick_mesh((6, 6, 4)), order=ElementOrder.P1)
    body, rotation = OBJECTS[name]().with_edges(5e-5), tilted(0.1, 0.05)
    seen = wp.zeros((1, *usual.surface.areas.shape), dtype=Seen)
    for shift_m in (0.0, 1e-6, 1e-6, 4e-5, 3e-4, 3.2e-4):
        tip = np.array([0.3e-3 + shift_m, 0.1e-3, usual.height_m - 0.4e-3 - shift_m])
        pressed = usual.surface.pressed(usual.nodes, body, usual.rest_state(tip=tip))
        pressed.poses, pressed.seen = poses_at(tip[None], rotation[None], Device("cpu")), seen
        exact = _gaps(wide_block, body, tip, rotation)
        near = exact < usual.contact_options.distance_m
        assert near.any()
        assert not near.all()
        for found in (_gaps(usual, body, tip, rotation), usual.surface.forces_of(pressed).gaps):
            np.testing.assert_allclose(found[near], exact[near], atol=1e-15)
            assert np.all(found <= exact + 1e-9)
            assert found[~near].min() > usual.contact_options.distance_m


def test_round_edges_are_as_far_as_a_smaller_box_is(wide_block: Model, box: MeshIndenter) -> None:
    """Less the radius of the edges; faces stay, edges and corners are cylinders and spheres."""
    radius = 0.4e-3
    rotation = Rotation.random(random_state=9).as_matrix()
    tip = np.array([0.0, 0.0, wide_block.height_m]) - rotation[:, 2] * HALF_M[2]
    state = wide_block.rest_state(tip=tip, rotation=rotation)
    rounded = box.with_edges(radius)
    found = wide_block.surface.forces(wide_block.nodes, rounded, state)
    points = (found.points - tip) @ rotation
    beyond = np.abs(points - np.array([0.0, 0.0, HALF_M[2]])) - (HALF_M - radius)
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    expected = outside + np.minimum(beyond.max(axis=-1), 0.0) - radius
    np.testing.assert_allclose(found.gaps, expected, atol=1e-15)
    np.testing.assert_array_equal(rounded.with_edges(0.5 * radius).surface, rounded.surface)


def test_a_round_edge_is_met_from_below(box: MeshIndenter) -> None:
    """A box's underside ends in quarter circles; a ridge between slopes ends in an arc."""
    radius, slope = 0.4e-3, math.radians(30.0)
    inwards = np.linspace(0.05 * radius, 2.0 * radius, 9)
    arc = radius - np.sqrt(radius**2 - np.maximum(radius - inwards, 0.0) ** 2)
    under = box.with_edges(radius).lower_surface(HALF_M[0] - inwards, np.zeros(9))
    np.testing.assert_allclose(under, arc, atol=1e-9)
    assert np.isinf(box.with_edges(radius).lower_surface(HALF_M[:1] + 1e-6, np.zeros(1)))
    away = np.linspace(0.0, 1e-3, 21)
    ridge = chisel().with_edges(radius).lower_surface(np.zeros(21), away)
    lift = radius / math.cos(slope) - radius
    assert chisel().with_edges(radius).blunted_m == pytest.approx(lift)
    on_arc = lift + radius - np.sqrt(np.maximum(radius**2 - away**2, 0.0))
    is_arc = away < radius * math.sin(slope)
    expected = np.where(is_arc, on_arc, away * math.tan(slope))
    np.testing.assert_allclose(ridge, expected, atol=1e-9)


_CORNERS = 1e-3 * np.array([[0, 0, 0], [1, 1, 4], [-1, 1, 4], [-1, -1, 4], [1, -1, 4]])
_FACES = np.array([[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4], [1, 2, 3], [1, 3, 4]])
SPIKE = mesh_indenter(_CORNERS, _FACES, name="spike")
BODIES = (Sphere(diameter_m=6e-3), Cylinder(diameter_m=5e-3, fillet_m=1e-3), chisel(), SPIKE)


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.1, -0.15)])
def test_touch_is_where_no_point_of_the_underside_lies_deeper(tilt: tuple[float, float]) -> None:
    """Over a fine grid of the gel, the deepest point of the underside just touches."""
    pad, turn = load_sensor("gelsight-mini").pad, tilted(*tilt)
    places = np.array([[3e-3, -2e-3], [-6e-3, 4e-3], [0.0, 1e-3], [4.1e-3, -3.3e-3]])
    bodies = IndenterSet(bodies=BODIES, which=(0, 1, 2, 3))
    found = first_touch(pad, bodies, places, np.array([turn] * 4))
    for (x, y), height, body in zip(places, found, BODIES, strict=True):
        near = np.linspace(-3e-3, 3e-3, 1201)
        u, v = np.meshgrid(near, near)
        beneath = TurnedIndenter(indenter=body, rotation=turn).lower_surface(u, v)
        deepest = (pad.height_at(x + u, y + v) - beneath).max()
        # Fillets are arcs here and chords there; grids miss a corner by some micrometres.
        assert height == pytest.approx(deepest, abs=5e-6)
