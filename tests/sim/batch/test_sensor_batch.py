"""Unlike presses on one sensor's mesh: forces, wrenches and poses against single presses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.batch.sensor_batch import PoseOptions, SensorBatch, sensor_model
from sim.contact.state import ContactOptions
from sim.material.laws.tangent import law
from sim.mesh.elements import ElementOrder, quarter_hats
from sim.mesh.refinement import sensor_mesh
from sim.mesh.symmetry import MirrorSymmetry
from sim.scene.indenter import Cylinder, Sphere, mesh_indenter, tilted
from sim.scene.material import LawName, Material
from sim.scene.pad import BoxPad
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

PAD = BoxPad(size_x_m=9e-3, size_y_m=8e-3, height_m=3e-3)
GEL = Material(young_pa=0.15e6, poisson=0.45)
BALL, PUNCH = Sphere(diameter_m=6e-3), Cylinder(diameter_m=3e-3, fillet_m=1e-3)
_CORNERS = np.array([[x, y, z] for z in (0, 3) for y in (-1, 1) for x in (-1, 1)]) * 1e-3
_FACES = [[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4]]
_FACES += [[2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5]]
BLOCK = mesh_indenter(_CORNERS, np.array(_FACES, dtype=np.int32), name="block")
EXACT = PoseOptions(residual_relative=1e-6)


@pytest.fixture(scope="module")
def smooth() -> Model:
    """The pad without friction."""
    return sensor_model(PAD, GEL, edge_m=2e-3)


@pytest.fixture(scope="module")
def stiff() -> Model:
    """The pad with contact that hardly gives way, as single presses have it."""
    return Model(
        sensor_mesh(PAD, edge_m=2e-3),
        order=ElementOrder.P2,
        law=law(LawName.STABLE_NEO_HOOKEAN),
        young_pa=GEL.young_pa,
        poisson=GEL.poisson,
        contact_options=ContactOptions(distance_m=3e-5, extension=1.0),
    )


@pytest.fixture(scope="module")
def rough() -> Model:
    """The pad with friction."""
    return sensor_model(PAD, GEL, edge_m=2e-3, friction=0.5)


def _pose(x: float, y: float, depth: float, rotation: FloatArray | None = None) -> list[float]:
    turned = np.eye(3) if rotation is None else rotation
    return [x, y, PAD.height_m - depth, *Rotation.from_matrix(turned).as_quat()]


def _single_n(model: Model, indenter: Sphere | Cylinder, x: float, y: float, depth: float) -> float:
    path = LoadingPath(model, indenter, (x, y))
    # Depths count from where the gap is the contact distance; a batch counts from the body.
    first = path.touch_m - model.contact_options.distance_m - PAD.height_m
    return float(path.advance(depth + first).force_n[2])


def test_every_environment_feels_what_a_single_press_does(stiff: Model) -> None:
    """Unlike bodies at unlike places, in one batch, against the solver that factors each state."""
    batch = SensorBatch(stiff, [BALL, PUNCH], [0, 1, 0], options=EXACT)
    poses = np.array([_pose(1e-3, 0, 0.4e-3), _pose(-1e-3, 1e-3, 0.3e-3), _pose(0, -1e-3, 0.2e-3)])
    felt = batch.step(poses)
    assert felt.valid.all()
    single = [
        _single_n(stiff, body, *pose[:2], PAD.height_m - pose[2])
        for body, pose in zip((BALL, PUNCH, BALL), poses.tolist(), strict=True)
    ]
    np.testing.assert_allclose(felt.raw_wrench[:, 2], single, rtol=1e-4)
    assert felt.residual.max() <= 1e-6
    # The bias is not known of a model that was made otherwise.
    np.testing.assert_array_equal(felt.wrench, felt.raw_wrench)
    assert np.isnan(felt.force_error).all()


def test_a_load_is_met(stiff: Model) -> None:
    """A pushed indenter sinks until it is pushed back as much, at the depth of that force."""
    batch = SensorBatch(stiff, [BALL, PUNCH], [0, 1], options=EXACT)
    poses = np.array([_pose(0, 0, 0.1e-3), _pose(0, 0, 0.1e-3)])
    felt = batch.step(poses, loads_n=np.array([0.2, 0.4]))
    assert felt.valid.all()
    np.testing.assert_allclose(felt.wrench[:, 2], [0.2, 0.4], rtol=1e-3)
    depth = PAD.height_m - batch.tips_m[:, 2]
    single = [_single_n(stiff, body, 0, 0, d) for body, d in zip((BALL, PUNCH), depth, strict=True)]
    np.testing.assert_allclose(single, felt.raw_wrench[:, 2], rtol=1e-3)


def test_contact_is_lost_and_made_elsewhere(smooth: Model) -> None:
    """Without friction the gel forgets: a ball that was elsewhere feels what a new one does."""
    batch = SensorBatch(smooth, [BALL], [0, 0], options=EXACT)
    there = np.array([_pose(1e-3, 0, 0.3e-3), _pose(-1e-3, -1e-3, 0.2e-3)])
    first = batch.step(there)
    away = batch.step(there + np.array([0, 0, 1e-3, 0, 0, 0, 0]))
    assert away.valid.all()
    assert np.abs(away.wrench).max() < 1e-9
    swapped = batch.step(there[::-1])
    np.testing.assert_allclose(swapped.wrench[:, 2], first.wrench[::-1, 2], rtol=1e-4)
    batch.reset(np.array([True, False]))
    again = batch.step(there[::-1])
    np.testing.assert_allclose(again.wrench[:, 2], swapped.wrench[:, 2], rtol=1e-4)


def test_tractions_sum_to_the_wrench(rough: Model) -> None:
    """Pressure and shear at the nodes carry what the indenter feels, and nothing pulls."""
    batch = SensorBatch(rough, [BALL], [0], friction=np.array([0.5]))
    batch.step(np.array([_pose(0, 0, 0.3e-3)]))
    felt = batch.step(np.array([_pose(0.1e-3, 0, 0.3e-3)]))
    pressure, shear = (array.numpy()[0] for array in batch.tractions())
    hats = quarter_hats(rough.reference.face_points)
    areas = np.zeros(len(rough.nodes))
    np.add.at(areas, rough.faces, np.einsum("fq,qk->fk", rough.surface.areas, hats))
    force = felt.raw_wrench[0, :3]
    assert pressure.min() >= 0.0
    assert pressure @ areas == pytest.approx(np.linalg.norm(force), rel=0.1)
    assert 0.0 < felt.force_error[0] < 1.0
    assert areas @ shear[:, 0] == pytest.approx(-force[0], rel=0.1)


def test_friction_holds_a_ball_back(rough: Model) -> None:
    """Each environment's own friction bounds what it feels along the surface."""
    batch = SensorBatch(rough, [BALL], [0, 0], friction=np.array([0.1, 0.9]))
    batch.step(np.array([_pose(0, 0, 0.3e-3)] * 2))
    felt = batch.step(np.array([_pose(0.3e-3, 0, 0.3e-3)] * 2))
    shear = -felt.wrench[:, 0] / felt.wrench[:, 2]
    assert felt.valid.all()
    assert shear[0] == pytest.approx(0.1, abs=0.02)
    assert shear[0] < shear[1] <= 0.9


def test_a_tilted_block_is_turned_back(smooth: Model) -> None:
    """The moment of a tilted body turns it upright, and mirrored poses feel mirrored wrenches."""
    batch = SensorBatch(smooth, [BLOCK], [0, 0], options=EXACT)
    poses = [_pose(0, 0, 0.3e-3, tilted(0.0, sign * 0.1)) for sign in (1, -1)]
    felt = batch.step(np.array(poses))
    assert felt.valid.all()
    assert felt.wrench[0, 4] < 0.0 < felt.wrench[1, 4]
    assert abs(felt.wrench[0, 2] / felt.wrench[1, 2] - 1.0) < 0.05


def test_who_takes_no_part_stays(smooth: Model) -> None:
    """An environment that is not active keeps its nodes to the bit."""
    batch = SensorBatch(smooth, [BALL], [0, 0])
    batch.step(np.array([_pose(0, 0, 0.2e-3)] * 2))
    before = batch.positions.numpy()[1].copy()
    batch.step(np.array([_pose(0, 0, 0.3e-3)] * 2), active=np.array([True, False]))
    np.testing.assert_array_equal(batch.positions.numpy()[1], before)


@pytest.mark.parametrize(
    ("poses", "named"),
    [
        (np.zeros((2, 7)), "(1, 7)"),
        (np.full((1, 7), np.nan), "finite"),
        (np.zeros((1, 7)), "quaternion"),
    ],
)
def test_poses_that_are_none_are_refused(smooth: Model, poses: FloatArray, named: str) -> None:
    """The message names what was given and what is wanted."""
    with pytest.raises(ConfigError, match=r".") as caught:
        SensorBatch(smooth, [BALL], [0]).step(poses)
    assert named in f"{caught.value.message} {caught.value.remedy}"


def test_arguments_that_do_not_fit_are_refused(smooth: Model) -> None:
    """A body that is not there, friction without a model of it, half a pad."""
    with pytest.raises(ConfigError, match="which"):
        SensorBatch(smooth, [BALL], [1])
    with pytest.raises(ConfigError, match="friction"):
        SensorBatch(smooth, [BALL], [0], friction=np.array([0.5]))
    half = replace(smooth.mesh, symmetry=MirrorSymmetry(mirror_x=True))
    model = Model(half, order=smooth.reference.order, law=smooth.law, young_pa=1e5, poisson=0.45)
    with pytest.raises(ConfigError, match="whole pad"):
        SensorBatch(model, [BALL], [0])


def test_the_mesh_is_fine_all_over_its_surface() -> None:
    """Edges on a domed top are as short as asked, its vertices on the dome, those below longer."""
    pad = replace(PAD, dome_radius_x_m=30e-3)
    mesh = sensor_mesh(pad, edge_m=1e-3)
    ends = np.concatenate([mesh.tets[:, [a, b]] for a in range(4) for b in range(a)])
    lengths = np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1)
    top = np.abs(mesh.vertices[:, 2] - pad.height_at(*mesh.vertices[:, :2].T)) < 1e-9
    # An edge is halved from three halves of what is asked at its middle, with the dome taken out.
    assert lengths[top[ends].all(axis=1)].max() <= 1.55e-3
    assert lengths[(mesh.vertices[ends, 2] < 1e-3).all(axis=1)].mean() > 1.3e-3


@pytest.mark.gpu
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_gpu_feels_what_a_processor_does(friction: float) -> None:
    """The dense inverse and the blocks of threads lead to the same equilibria.

    With friction the steps' order decides which points slide by how little.
    """
    poses = np.array([_pose(1e-3, 0, 0.4e-3), _pose(-1e-3, 0, 0.3e-3), _pose(0, 1e-3, 0.2e-3)])
    found = []
    for device in ("cpu", "cuda:0"):
        model = sensor_model(PAD, GEL, edge_m=2e-3, friction=friction, device=device)
        batch = SensorBatch(model, [BALL, PUNCH, BLOCK], [0, 1, 2], options=EXACT)
        found.append(batch.step(poses).wrench)
    size = found[0][:, 2:3] * np.array([1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3])
    assert np.abs((found[1] - found[0]) / size).max() < 1e-3
