"""Meshes that are fine under a footprint, and their refinement."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.effects.effect_choice import plan_effects
from sim.effects.mesh_choice import MeshKind, footprint_mesh, mesh_choice
from sim.effects.presets import build_model, mesh_for
from sim.mesh.brick_refinement import bisected, with_rim_fitted, with_top_fitted
from sim.mesh.cached_tet_mesh import TetMesh, smallest_dihedral_deg, tet_volumes
from sim.mesh.elements import boundary_faces
from sim.mesh.footprint_sizing import footprint
from sim.mesh.mirror_symmetry import MirrorSymmetry
from sim.mesh.revolved_mesh import Grading, revolved_mesh
from sim.press_arguments import scene_from
from sim.scene.indenter import (
    Cylinder,
    Indenter,
    Plane,
    Sphere,
    TurnedIndenter,
    cylinder_triangles,
    mesh_indenter,
    tilted,
)
from sim.scene.material import Layer
from sim.scene.pad import BoxPad
from sim.scene.scene import Effect, Motion, Preset, Target, TetWildOptions
from sim.sensor.sensor import load_sensor
from sim.solve.loading_path import LoadingPath
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.registry import Kind, names

PAD = BoxPad(size_x_m=12e-3, size_y_m=12e-3, height_m=4e-3)
PUNCH = Cylinder(diameter_m=5e-3)
BALL = Sphere(diameter_m=8e-3)
UPRIGHT = np.eye(3)
SCENE = scene_from(
    "--pad box:12x12x4mm --young 0.4MPa --poisson 0.48 --indenter cylinder:diameter=5mm "
    "--depth 0.4mm --preset fast"
)


def stl_punch() -> Indenter:
    """Return the punch as triangles."""
    return mesh_indenter(*cylinder_triangles(PUNCH), name="punch")


def lopsided() -> Indenter:
    """Return a wedge that only the plane across y mirrors."""
    corners = 1e-3 * np.array([[2.0, -1.0], [2.0, 1.0], [-1.0, 0.0]])
    vertices = np.concatenate([np.column_stack([corners, np.full(3, z)]) for z in (0.0, 3e-3)])
    vertices[:, 0] -= 0.5e-3
    faces = [[0, 2, 1], [3, 4, 5], [0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5]]
    return mesh_indenter(vertices, np.array(faces, dtype=np.int32), name="wedge")


def upright(indenter: Indenter) -> TurnedIndenter:
    """Return an indenter that is not turned."""
    return TurnedIndenter(indenter=indenter, rotation=UPRIGHT)


@pytest.mark.parametrize("name", names(Kind.SENSOR))
def test_built_in_sensors_bring_their_coarse_mesh(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A footprint mesh on a built-in sensor's pad asks nothing of fTetWild."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    sensor = load_sensor(name)
    scene = replace(
        SCENE, pad=sensor.pad, layers=sensor.layers, tetwild=sensor.tetwild, sensor=name
    )
    mesh = footprint_mesh(scene)
    assert len(mesh.tets) > 500
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("indenter", [PUNCH, stl_punch()])
def test_edge_of_a_punch_is_its_rim(indenter: Indenter) -> None:
    """On a circle of the punch's radius, whether it is a formula or triangles."""
    found = footprint(PAD, upright(indenter), centre_m=(1e-3, -0.5e-3), depth_m=0.3e-3)
    away = np.hypot(found.rim[:, 0] - 1e-3, found.rim[:, 1] + 0.5e-3)
    np.testing.assert_allclose(away, PUNCH.radius_m, rtol=2e-4)
    np.testing.assert_allclose(found.rim[:, 2], PAD.height_m)
    assert found.radius_m == pytest.approx(PUNCH.radius_m, rel=0.01)


def test_ball_has_no_sharp_edge() -> None:
    """It is touched within sqrt(1.5 R d), and there is no rim."""
    found = footprint(PAD, upright(BALL), centre_m=(0.0, 0.0), depth_m=0.3e-3)
    assert not len(found.edge)
    assert not len(found.rim)
    assert found.radius_m == pytest.approx(math.sqrt(1.5 * 4e-3 * 0.3e-3), rel=0.04)


def test_pads_own_edge_is_no_rim() -> None:
    """Half off the pad only the half of the rim over the gel counts."""
    found = footprint(PAD, upright(PUNCH), centre_m=(6e-3, 0.0), depth_m=0.3e-3)
    assert found.rim[:, 0].max() <= 6e-3
    np.testing.assert_allclose(
        np.hypot(found.rim[:, 0] - 6e-3, found.rim[:, 1]), PUNCH.radius_m, rtol=1e-6
    )
    assert found.area_m2 == pytest.approx(0.5 * math.pi * PUNCH.radius_m**2, rel=0.02)


@settings(max_examples=10, deadline=None, derandomize=True)
@given(about_x=st.floats(-0.2, 0.2), about_y=st.floats(-0.2, 0.2))
def test_tilted_shapes_agree_with_their_triangles(about_x: float, about_y: float) -> None:
    """The tilted plane and ball are those of the formulas, turned point by point."""
    turn = tilted(about_x, about_y)
    x, y = np.meshgrid(np.linspace(-1e-3, 1e-3, 5), np.linspace(-1e-3, 1e-3, 5))
    plane = TurnedIndenter(indenter=Plane(), rotation=turn).lower_surface(x, y)
    points = np.stack([x, y, plane], axis=-1) @ turn
    np.testing.assert_allclose(points[..., 2], 0.0, atol=1e-15)
    ball = TurnedIndenter(indenter=BALL, rotation=turn).lower_surface(x, y)
    points = np.stack([x, y, ball], axis=-1) @ turn - [0.0, 0.0, BALL.radius_m]
    np.testing.assert_allclose(np.linalg.norm(points, axis=-1), BALL.radius_m, rtol=1e-9)


def test_tilted_punch_touches_on_one_side() -> None:
    """Tilted by 10 degrees about y, 0.2 mm deep, a narrow segment of the face touches."""
    turned = TurnedIndenter(indenter=PUNCH, rotation=tilted(0.0, math.radians(10.0)))
    found = footprint(PAD, turned, centre_m=(0.0, 0.0), depth_m=0.2e-3)
    assert found.inside[:, 0].min() > 1e-3
    assert found.area_m2 < 0.2 * math.pi * PUNCH.radius_m**2


@pytest.mark.parametrize(
    ("change", "kind"),
    [
        ({}, MeshKind.REVOLVED),
        ({"indenter": BALL, "centre_m": (1e-3, 2e-3)}, MeshKind.REVOLVED),
        ({"preset": Preset.PAPER, "centre_m": (6e-3, 0.0)}, MeshKind.PAPER),
        ({"centre_m": (4e-3, 0.0)}, MeshKind.FOOTPRINT),
        ({"indenter": stl_punch()}, MeshKind.FOOTPRINT),
        ({"motion": Motion(tilt_rad=(0.0, 0.1))}, MeshKind.REVOLVED),
        ({"motion": Motion(tilt_rad=(0.0, 0.2))}, MeshKind.FOOTPRINT),
        ({"indenter": Plane(), "motion": Motion(tilt_rad=(0.0, 0.1))}, MeshKind.FOOTPRINT),
        ({"indenter": BALL, "motion": Motion(tilt_rad=(0.0, 0.1))}, MeshKind.REVOLVED),
        ({"motion": Motion(shift_m=(4e-3, 0.0))}, MeshKind.FOOTPRINT),
    ],
)
def test_which_scene_gets_which_mesh(change: dict[str, object], kind: MeshKind) -> None:
    """Revolved where the indenter is round, upright and on the pad; else a footprint's."""
    scene = replace(SCENE, **change)
    found, reason = mesh_choice(scene)
    assert found is kind
    assert reason
    wild = replace(scene, layers=(Layer(share=1.0, material=scene.material),), refinement=1.6)
    fills = {MeshKind.FOOTPRINT: wild, MeshKind.PAPER: scene}
    assert kind not in fills or not plan_effects(fills[kind]).is_on(Effect.SYMMETRY)


@pytest.mark.parametrize(
    ("change", "copies"),
    [
        ({"indenter": stl_punch()}, 4),
        ({"indenter": stl_punch(), "motion": Motion(tilt_rad=(0.02, 0.0))}, 2),
        ({"indenter": BALL, "motion": Motion(tilt_rad=(0.02, 0.0))}, 2),
        ({"indenter": lopsided()}, 2),
        ({"centre_m": (4e-3, 0.0)}, 2),
        ({"centre_m": (4e-3, 1e-3)}, 1),
    ],
    ids=["round", "tilted", "tilted ball", "lopsided", "off the pad", "off both"],
)
def test_mirrored_parts_stand_for_the_pad(change: dict[str, object], copies: int) -> None:
    """Of a box of one material: as many copies of the part as mirrors make fill the pad."""
    mesh = mesh_for(replace(SCENE, **change))  # type: ignore[arg-type]
    assert mesh.symmetry.copies == copies
    volume = copies * float(volumes(mesh).sum())
    assert volume == pytest.approx(12e-3 * 12e-3 * 4e-3, rel=1e-9)


def test_footprint_mesh_has_nodes_on_the_rim() -> None:
    """Half off the pad: nodes on the rim, a good angle everywhere, the same mesh every time."""
    scene = replace(SCENE, centre_m=(6e-3, 0.0))
    mesh = mesh_for(scene)
    away = np.hypot(mesh.vertices[:, 0] - 6e-3, mesh.vertices[:, 1])
    on_rim = (np.abs(away - PUNCH.radius_m) < 1e-8) & (mesh.vertices[:, 2] == PAD.height_m)
    assert on_rim.sum() > 15
    assert smallest_dihedral_deg(mesh) > 5.0
    assert mesh.content_hash == mesh_for(scene).content_hash
    finer = mesh_for(scene, refinement=1.5)
    assert len(finer.tets) > 1.5 * len(mesh.tets)


@pytest.mark.slow
def test_triangles_press_like_the_formula() -> None:
    """On one mesh a punch of 256 sides gives the round one's force within 0.5 %."""
    linear = ((Effect.LOCKING_FREE_ELEMENT, False),)
    scene = replace(SCENE, effects=linear, target=Target(depth_m=0.1e-3))
    mesh = footprint_mesh(scene)
    forces = [
        LoadingPath(build_model(scene, mesh=mesh), indenter).advance(0.1e-3).force_n[2]
        for indenter in (PUNCH, stl_punch())
    ]
    assert forces[1] == pytest.approx(forces[0], rel=5e-3)


def test_least_angle_is_held_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A mesh that misses the angle asked for is refused, not pressed."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(ConfigError, match="less than the 35 deg"):
        footprint_mesh(replace(SCENE, tetwild=TetWildOptions(dihedral_min_rad=math.radians(35.0))))


DOME = BoxPad(
    size_x_m=10e-3, size_y_m=8e-3, height_m=2e-3, dome_radius_x_m=0.05, dome_radius_y_m=0.05
)
_OFF_M = 2e-5


def coarse() -> TetMesh:
    """Return the whole pad."""
    grading = Grading(start_m=1e-3, end_m=1e-3, size_m=0.5e-3)
    return revolved_mesh(
        DOME, grading, centre_m=(0.0, 0.0), sector_count=12, name="box", symmetry=MirrorSymmetry()
    )


def volumes(mesh: TetMesh) -> FloatArray:
    """Return the tetrahedra's volumes [m^3]."""
    return tet_volumes(mesh.vertices, mesh.tets)


def test_a_rough_top_is_laid_onto_the_pad() -> None:
    """Vertices that stray by less than the reach come back; the rest stays where it was."""
    mesh = coarse()
    heights = DOME.height_at(mesh.vertices[:, 0], mesh.vertices[:, 1])
    top = np.abs(mesh.vertices[:, 2] - heights) < 1e-9
    rough = mesh.vertices.copy()
    rough[top, 2] += np.random.default_rng(1).uniform(-_OFF_M, _OFF_M, int(top.sum()))
    fitted = with_top_fitted(replace(mesh, vertices=rough), DOME, reach_m=2.0 * _OFF_M)
    np.testing.assert_allclose(fitted.vertices[top, 2], heights[top], atol=1e-12)
    np.testing.assert_array_equal(fitted.vertices[~top], mesh.vertices[~top])


def test_a_rim_gets_nodes_and_no_element_is_flattened() -> None:
    """A circle between two rings of nodes: the near ones move onto it, volumes stay positive."""
    mesh, radius = coarse(), 1.1e-3
    angle = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)
    plan = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    rim = np.column_stack([plan, DOME.height_at(plan[:, 0], plan[:, 1])])
    fitted = with_rim_fitted(mesh, DOME, rim, reach_m=0.15e-3)
    moved = np.any(fitted.vertices != mesh.vertices, axis=1)
    assert moved.sum() >= 12
    at = np.hypot(fitted.vertices[moved, 0], fitted.vertices[moved, 1])
    np.testing.assert_allclose(at, radius, rtol=1e-5)
    assert np.all(volumes(fitted) >= 0.2 * volumes(mesh))
    assert with_rim_fitted(mesh, DOME, np.empty((0, 3)), reach_m=1e-3) is mesh


def test_halving_keeps_the_pad_and_meets_the_field() -> None:
    """Same volume, no hanging node, every edge short enough, nothing changed where it was."""

    def size_at(points: np.ndarray) -> np.ndarray:
        return np.asarray(0.4e-3 + 0.5 * np.linalg.norm(points - [2e-3, 1e-3, 2e-3], axis=1))

    before, mesh = coarse(), bisected(coarse(), size_at)
    assert volumes(mesh).min() > 0.0
    assert volumes(mesh).sum() == pytest.approx(volumes(before).sum(), rel=1e-12)
    areas = []
    for m in (before, mesh):
        a, b, c = (m.vertices[boundary_faces(m.tets)[0]][:, k] for k in range(3))
        areas.append(float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()))
    assert areas[1] == pytest.approx(areas[0], rel=1e-12)
    pairs = mesh.tets[:, [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]].reshape(-1, 2)
    ends = mesh.vertices[pairs]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    assert np.all(lengths <= 1.5 * size_at(ends.mean(axis=1)))
    assert mesh.content_hash == bisected(coarse(), size_at).content_hash


@pytest.mark.parametrize(("sectors", "mu", "count"), [(3, 0.0, 48), (3, 0.5, 12), (4, 0.0, 12)])
def test_gel_that_slides_past_an_acute_corner_has_many_contact_points(
    sectors: int, mu: float, count: int
) -> None:
    """Twelve a face let the corner of a triangle cut it; a square's does not."""
    triangles = cylinder_triangles(Cylinder(diameter_m=2e-3), sectors=sectors)
    body = mesh_indenter(*triangles, name="prism")
    scene = replace(SCENE, indenter=body, preset=Preset.BALANCED, contact="friction", friction=mu)
    assert build_model(scene, refinement=0.5).surface.areas.shape[1] == count
