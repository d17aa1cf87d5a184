"""Height maps, and rings that are drawn round."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sim.effects.effect_choice import plan_effects
from sim.effects.press_with_effects import path_for
from sim.fields.saved_press import SurfaceState, seen_surface, surface_state
from sim.mesh.elements import FACE_EDGES, doubled_areas, linear_facets, quadratic_nodes
from sim.optics.height.height_map import cut_face, cut_tables, height_maps
from sim.scene.indenter import Cylinder, Indenter, Plane, Sphere
from sim.scene.material import Material
from sim.scene.pad import BoxPad, DiscPad
from sim.scene.scene import Preset, Scene, Target
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.arrays import FloatArray
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


def test_quadratic_surface_is_exact() -> None:
    """A quadratic height is exact at every pixel on an irregular mesh of quadratic faces."""
    points, faces = quadratic_nodes(*irregular_mesh(1.5e-3), edges=FACE_EDGES)

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
    for edge in (16e-4, 8e-4):
        points, triangles = quadratic_nodes(*irregular_mesh(edge), edges=FACE_EDGES)
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
    assert np.isfinite(maps.loaded).all()
    assert (maps.loaded <= _underside(surface, *camera().pad_grid()) + 1e-12).all()


def _underside(surface: SurfaceState, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the height of a tilted indenter's end over the pad [m], by iteration along z."""
    turn, place = surface.indenter_rotation, np.stack([x, y, np.zeros_like(x)], axis=-1)
    place[..., :2] -= surface.indenter_position[:2]
    for _ in range(40):
        local = place @ turn
        off = surface.indenter.lower_surface(local[..., 0], local[..., 1]) - local[..., 2]
        place[..., 2] += np.where(np.isfinite(off), off, -local[..., 2]) / turn[2, 2]
    return np.where(np.isfinite(off), place[..., 2] + surface.indenter_position[2], np.inf)


def test_a_pixel_beside_the_gel_has_the_height_of_the_nearest_one_of_its_column() -> None:
    """A camera may see more than the gel; where a whole column does, its row's nearest counts."""
    points, faces = irregular_mesh(5e-4)
    wide = camera(160, 120, 2e-4)
    plane = APEX_M + 1e-2 * wide.pad_grid()[0] + 7e-5 * wide.pad_grid()[1]
    seen = _unloaded(np.c_[points, APEX_M + points @ [1e-2, 7e-5]], faces, wide)
    bare = np.abs(seen - plane) > 1e-9
    assert 0.5 < bare.mean() < 0.8
    columns = np.flatnonzero(~bare.all(axis=0))
    for column in columns:
        covered = np.flatnonzero(~bare[:, column])
        rows = np.arange(120).clip(covered[0], covered[-1])
        np.testing.assert_array_equal(seen[:, column], seen[rows, column])
    beside = np.arange(160).clip(columns[0], columns[-1])
    np.testing.assert_array_equal(seen, seen[:, beside])


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


_DEPTH_M = 0.4e-3
_RADIUS_M = 2e-3
_PIXEL_M = 10e-6


@cache
def _punched(hand_over=surface_state, **changes):  # type: ignore[no-untyped-def]
    """Press a cylinder into a disc, which leaves no direction out; 20 sectors."""
    scene = Scene(
        pad=DiscPad(radius_m=8e-3, height_m=4e-3),
        material=Material(young_pa=0.4e6, poisson=0.45),
        indenter=Cylinder(diameter_m=2.0 * _RADIUS_M, fillet_m=0.1e-3),
        target=Target(depth_m=_DEPTH_M),
        **{"preset": Preset.BALANCED, **changes},
    )
    path = path_for(scene, plan_effects(scene))
    return hand_over(path, path.advance(_DEPTH_M))


def _camera(*, half_width_m: float, pixel_m: float = _PIXEL_M) -> CameraGeometry:
    count = round(2.0 * half_width_m / pixel_m) + 1
    return camera(count, count, pixel_m)


def _wall_radii(surface: SurfaceState) -> FloatArray:
    """Return how far from the axis the wall is as high as the fillet and a fifth, all around."""
    geometry = _camera(half_width_m=1.25 * _RADIUS_M)
    loaded = height_maps(surface, geometry).loaded
    level = loaded.min() + 0.12e-3
    radius = np.linspace(0.9, 1.2, 1201) * _RADIUS_M
    angle = np.radians(np.arange(0.0, 90.0, 0.9))
    column = (radius * np.cos(angle)[:, None]) / _PIXEL_M + geometry.centre_x_px
    row = (radius * np.sin(angle)[:, None]) / _PIXEL_M + geometry.centre_y_px
    i, j = row.astype(int), column.astype(int)
    v, u = row - i, column - j
    height = (1.0 - v) * ((1.0 - u) * loaded[i, j] + u * loaded[i, j + 1])
    height += v * ((1.0 - u) * loaded[i + 1, j] + u * loaded[i + 1, j + 1])
    return np.asarray(radius[np.argmax(height > level, axis=1)])


def test_the_wall_of_a_round_punch_is_round() -> None:
    """In all directions the wall lies within 0.5 um of a circle; a star without the rings."""
    radii = _wall_radii(_punched())
    assert np.ptp(radii) <= 1e-6
    star = _wall_radii(replace(_punched(), mesh_axis_m=None))
    assert np.ptp(star) > 6e-6
    assert radii.mean() < star.mean()


def test_no_pixel_of_a_wall_lies_below_its_foot() -> None:
    """Slopes at nodes that all but stand over one another led 0.7 mm below: spikes with shadows."""
    surface = _punched()
    nodes = surface.positions_rest.copy()
    off = (radius := np.hypot(*nodes[:, :2].T)) - _RADIUS_M
    nodes[:, 2] -= 3e-4 / (1.0 + np.exp(off / 2e-5))
    closer = 0.95 * off * np.exp(-((off / 4e-5) ** 2)) / np.maximum(radius, 1e-9)
    nodes[:, :2] *= 1.0 - closer[:, None]
    shaped = replace(surface, positions=nodes, indenter_position=np.array([0.0, 0.0, 1.0]))
    loaded = height_maps(shaped, _camera(half_width_m=1.05 * _RADIUS_M, pixel_m=5e-6)).loaded
    assert loaded.min() > loaded[len(loaded) // 2, len(loaded) // 2] - 1e-7


def test_no_pixel_of_a_press_lies_above_the_indenter() -> None:
    """The map stays below the body itself, not only below what bounds the gel."""
    surface, geometry = _punched(), _camera(half_width_m=7e-3, pixel_m=50e-6)
    assert surface.standoff_m > 0.0
    loaded = height_maps(surface, geometry).loaded
    assert (loaded <= surface.indenter_height(*geometry.pad_grid())).all()


def test_a_wide_barrier_moves_no_wall() -> None:
    """The map is half as far from that of a narrow barrier as the surface as it was found."""
    geometry, ways = _camera(half_width_m=4e-3), (surface_state, surface_state, seen_surface)
    narrow, found, seen = (
        height_maps(_punched(way, preset=Preset.FAST, barrier_m=barrier_m), geometry).loaded
        for way, barrier_m in zip(ways, (5e-6, None, None), strict=True)
    )
    assert np.std(seen - narrow) < 0.5 * np.std(found - narrow)


def test_depth_counts_from_where_the_gel_touches() -> None:
    """In the contact the map is as deep as the press, with no step of the solver's gap around."""
    maps = height_maps(_punched(), _camera(half_width_m=3e-3))
    assert maps.rest.max() - maps.loaded.min() == pytest.approx(_DEPTH_M, abs=0.2e-6)


def test_rings_that_are_round_already_stay() -> None:
    """A turned and carried smooth deformation is drawn where it is."""
    surface = _punched()
    radius = np.hypot(*surface.positions_rest[:, :2].T)
    angle = np.arctan2(surface.positions_rest[:, 1], surface.positions_rest[:, 0])
    smooth = surface.positions_rest.copy()
    smooth[:, 2] += 1e-4 * np.exp(-(radius**2) / (2e-3) ** 2) * np.cos(2.0 * angle)
    smooth[:, :2] += 1e-4 * np.exp(-(radius**2) / (4e-3) ** 2)[:, None] * (0.6, 0.8)
    shaped = replace(surface, positions=smooth, indenter_position=np.array([0.0, 0.0, 1.0]))
    geometry = _camera(half_width_m=2.4e-3, pixel_m=50e-6)
    drawn = height_maps(shaped, geometry).loaded
    as_is = height_maps(replace(shaped, mesh_axis_m=None), geometry).loaded
    # The arc's height over a chord of 18 degrees is 1.2 % of the radius, the slope up to 0.05.
    assert np.abs(drawn - as_is).max() < 2e-6


def test_cut_faces_keep_the_surface() -> None:
    """The parts of faces cover what the faces covered, and neighbours share the nodes on edges."""
    surface = _punched()
    faces = surface.faces
    cut = cut_tables(faces, len(surface.positions))
    added, places = cut["parts"][len(faces) :], cut_face()[2]
    at = surface.positions[faces]
    bends = 0.125 * (at[:, :3] + np.roll(at[:, :3], -1, axis=1) - 2.0 * at[:, 3:])
    at_border = np.where(cut["across"][..., None] < 0, bends, 0.0)
    on_faces = cut["values"] @ at + cut["straight"] @ at_border
    nodes = np.concatenate([surface.positions, on_faces[cut["face"], cut["place"]]])
    parts = added.reshape(len(faces), -1)
    np.testing.assert_allclose(nodes[parts], on_faces[:, places.reshape(-1)], atol=1e-17)
    assert np.abs(bends).max() > 1e-6
    seen = [
        doubled_areas(*each)[:, 2].sum()
        for each in ((nodes, linear_facets(added)), (surface.positions, linear_facets(faces)))
    ]
    assert seen[0] == pytest.approx(seen[1], rel=1e-9)
