"""Height maps: smooth, bounded by the indenter, where the material is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sim.mesh.elements import FACE_EDGES, quadratic_nodes
from sim.optics.height.height_map import height_maps
from sim.optics.height.node_kernel import indenter_height
from sim.scene.indenter import Cylinder, Indenter, Plane, Sphere
from sim.scene.pad import BoxPad
from tacauchy_rig.core.errors import ConfigError
from tests.sim.optics.analytic_surface import (
    APEX_M,
    ball_press,
    camera,
    irregular_mesh,
    pressed_surface,
)


def _unloaded(nodes, faces, geometry=None):  # type: ignore[no-untyped-def]
    """Return the height map of a surface that nothing touches [m]."""
    surface = replace(
        pressed_surface(lambda x, _: x), positions_rest=nodes, positions=nodes, faces=faces
    )
    return height_maps(surface, geometry or camera()).rest


@pytest.mark.parametrize("quadratic", [False, True])
def test_quadratic_surface_is_exact(quadratic: bool) -> None:
    """A quadratic height is exact at every pixel on an irregular mesh of either kind of faces."""
    points, faces = irregular_mesh(1.5e-3 if quadratic else 5e-4)
    if quadratic:
        points, faces = quadratic_nodes(points, faces, edges=FACE_EDGES)

    def height(x, y):  # type: ignore[no-untyped-def]
        return APEX_M + 3.0 * x * x - 5.0 * x * y + y * y + 0.1 * x

    z = _unloaded(np.c_[points, height(points[:, 0], points[:, 1])], faces)
    np.testing.assert_allclose(z, height(*camera().pad_grid()), atol=1e-9)


@pytest.mark.parametrize("edge", [2e-4, 5e-4])
def test_no_dip_at_a_sharp_rim(edge: float) -> None:
    """Around a flat punch the gel rises from the rim at once: no pixel falls below the punch."""
    radius, tip = 2.5e-3, APEX_M - 8e-4

    def punched(x, y):  # type: ignore[no-untyped-def]
        beyond = np.maximum(np.hypot(x, y) - radius, 0.0)
        return tip + 8e-4 * (1.0 - np.exp(-np.sqrt(beyond / 3e-4)))

    surface = pressed_surface(
        punched, indenter=Cylinder(diameter_m=2 * radius), tip=(0.0, 0.0, tip), edge_m=edge
    )
    loaded = height_maps(surface, camera()).loaded
    assert loaded.min() > tip - 1e-9
    r = np.hypot(*camera().pad_grid())
    np.testing.assert_allclose(loaded[r < radius - edge], tip, atol=2e-5)


def test_error_falls_with_the_third_power_of_the_edge() -> None:
    """Halving the edge divides the error on a bump by at least six."""

    def height(x, y):  # type: ignore[no-untyped-def]
        return APEX_M - 1e-3 * np.exp(-(x**2 + y**2) / (2 * 2e-3**2))

    errors = []
    for edge in (8e-4, 4e-4):
        points, triangles = irregular_mesh(edge)
        nodes = np.c_[points, height(points[:, 0], points[:, 1])]
        z = _unloaded(nodes, triangles)
        errors.append(np.sqrt(np.mean((z - height(*camera().pad_grid())) ** 2)))
    assert errors[1] < errors[0] / 6.0
    assert errors[0] < 3e-6


def test_slope_is_continuous_across_edges() -> None:
    """Second differences stay far below the jumps of slope that linear facets show."""

    def height(x, y):  # type: ignore[no-untyped-def]
        return APEX_M + 2e-4 * np.sin(x / 1e-3) * np.cos(y / 1e-3)

    points, triangles = irregular_mesh(8e-4)
    nodes = np.c_[points, height(points[:, 0], points[:, 1])]
    fine = camera(400, 40, 2e-5)
    z = _unloaded(nodes, triangles, fine)
    curvature = np.diff(z, 2, axis=1) / fine.scale_x_m**2
    jump_of_linear_facets = 200.0 * 8e-4 / fine.scale_x_m
    assert np.abs(curvature).max() < 0.2 * jump_of_linear_facets


indenters = st.one_of(
    st.builds(Sphere, diameter_m=st.floats(3e-3, 2e-2)),
    st.builds(Cylinder, diameter_m=st.floats(1e-3, 7e-3), fillet_m=st.floats(0.0, 5e-4)),
    st.just(Plane()),
)


@settings(max_examples=60, deadline=None)
@given(
    indenter=indenters,
    x=st.floats(-3e-3, 3e-3),
    y=st.floats(-3e-3, 3e-3),
    depth=st.floats(-2e-4, 1.5e-3),
    tilt=st.floats(-0.05, 0.05),
    bump=st.floats(-1e-3, 1e-3),
    contact_gap=st.floats(0.0, 5e-5),
)
def test_no_pixel_lies_above_the_indenter(
    indenter: Indenter,
    x: float,
    y: float,
    depth: float,
    tilt: float,
    bump: float,
    contact_gap: float,
) -> None:
    """Whatever the mesh does, the height map stays at or below the indenter and is finite."""
    surface = pressed_surface(
        lambda px, py: APEX_M + bump * np.sin(px / 7e-4) * np.cos(py / 9e-4),
        indenter=indenter,
        tip=(x, y, APEX_M - depth),
        rotation=Rotation.from_rotvec([tilt, 0.5 * tilt, 0.1]).as_matrix(),
        edge_m=8e-4,
    )
    maps = height_maps(surface, camera(), contact_gap_m=contact_gap)
    ceiling = indenter_height(surface, *camera().pad_grid())
    assert np.isfinite(maps.loaded).all()
    assert (maps.loaded <= ceiling).all()


@pytest.mark.parametrize("gap", [0.0, 8e-6])
def test_contact_patch_is_the_ball(gap: float) -> None:
    """Inside the contact the map is the ball's surface, a solver's gap included; outside, gel."""
    press = {"ball_radius_m": 2.35e-3, "contact_radius_m": 1.2e-3, "tip_z_m": APEX_M - 8e-4}
    surface = pressed_surface(
        lambda x, y: ball_press(x, y, **press) - gap,
        indenter=Sphere(diameter_m=4.7e-3),
        tip=(0.0, 0.0, APEX_M - 8e-4),
        edge_m=3e-4,
    )
    maps = height_maps(surface, camera(), contact_gap_m=1e-5)
    x, y = camera().pad_grid()
    r = np.hypot(x, y)
    expected = ball_press(x, y, **press)
    inside = r < 1.0e-3
    assert maps.contact[inside].all()
    np.testing.assert_allclose(maps.loaded[inside], expected[inside], atol=1e-12)
    assert not maps.contact[r > 1.5e-3].any()
    assert np.abs(maps.loaded - expected).max() < 2e-5


def test_material_that_slid_sideways_is_drawn_where_it_is() -> None:
    """A dent moved by lateral displacement of the nodes shows at the deformed place."""
    points, triangles = irregular_mesh(4e-4)

    def dent(x, y):  # type: ignore[no-untyped-def]
        return APEX_M - 5e-4 * np.exp(-(x**2 + y**2) / (2 * 1e-3**2))

    nodes = np.c_[points + np.array([1e-3, 0.0]), dent(points[:, 0], points[:, 1])]
    row, column = np.unravel_index(np.argmin(_unloaded(nodes, triangles)), (96, 128))
    assert camera().to_pad(np.array([column, row], dtype=float)) == pytest.approx(
        [1e-3, 0.0], abs=1e-4
    )


def test_rest_map_is_the_unloaded_gel() -> None:
    """The second map is the rest surface, untouched by the indenter."""
    surface = pressed_surface(
        lambda x, _: np.full_like(x, APEX_M - 1e-3), tip=(0.0, 0.0, APEX_M - 1e-3)
    )
    maps = height_maps(surface, camera())
    np.testing.assert_allclose(maps.rest, APEX_M, atol=1e-12)
    np.testing.assert_allclose(maps.loaded, APEX_M - 1e-3, atol=1e-12)
    assert maps.contact.all()


def test_pixels_beside_the_pad_take_the_nearest_height() -> None:
    """An image wider than the mesh is filled from its edge, without gaps."""
    points, triangles = irregular_mesh(8e-4)
    nodes = np.c_[points, np.full(len(points), APEX_M)]
    wide = camera(pixel_m=2e-4)
    np.testing.assert_allclose(_unloaded(nodes, triangles, wide), APEX_M, atol=1e-12)


def test_a_mesh_in_millimetres_is_refused() -> None:
    """A surface that covers no pixel names the likely mistake."""
    points, triangles = irregular_mesh(8e-4)
    nodes = np.c_[points * 1e3 + 1e3, np.full(len(points), 4.0)]
    with pytest.raises(ConfigError, match=r"covers none of the 128 x 96 pixels[\s\S]*in metres"):
        _unloaded(nodes, triangles)


def test_a_surface_without_numbers_is_refused() -> None:
    """A press that failed gives no height map."""
    surface = pressed_surface(lambda x, _: np.full_like(x, np.nan))
    with pytest.raises(ConfigError, match="deformed surface covers no pixel"):
        height_maps(surface, camera())


def test_nodes_on_chords_are_put_back_onto_a_dome() -> None:
    """Nodes in the middle of straight edges lie below a dome; the map does not show that."""
    pad = BoxPad(
        size_x_m=20e-3, size_y_m=16e-3, height_m=APEX_M, dome_radius_x_m=0.05, dome_radius_y_m=0.05
    )
    flat = pressed_surface(lambda x, _: np.full_like(x, APEX_M), edge_m=2e-3)
    plan = flat.positions_rest
    corners = plan.copy()
    corners[:, 2] = pad.height_at(plan[:, 0], plan[:, 1])
    points, faces = quadratic_nodes(corners, flat.faces, edges=FACE_EDGES)
    below = replace(flat, positions_rest=points, positions=points - (0.0, 0.0, 1e-4), faces=faces)
    x, y = camera().pad_grid()
    true = pad.height_at(x, y) - 1e-4
    on_chords = height_maps(below, camera()).loaded - true
    on_dome = height_maps(below, camera(), pad=pad).loaded - true
    assert np.abs(on_chords).max() > 5e-6
    assert np.abs(on_dome).max() < 5e-7
