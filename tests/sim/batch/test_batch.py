"""Unlike presses on one sensor's mesh: forces, wrenches and poses against single presses."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from sim.batch.batch import Batch
from sim.batch.motion_steps import BatchOptions
from sim.batch.sensor_model import sensor_model
from sim.contact.surface_and_grip import ContactOptions
from sim.device import Device, on_host, replaced
from sim.fields.stress import StressProjection, surface_stress
from sim.material.elasticity_kernels import GelArrays
from sim.material.laws.law_and_lame import law
from sim.mesh.brick_refinement import sensor_mesh
from sim.mesh.elements import ElementOrder
from sim.mesh.mirror_symmetry import MirrorSymmetry
from sim.scene.indenter import Cylinder, Sphere, mesh_indenter, tilted
from sim.scene.material import LawName, Layer, Material
from sim.scene.pad import BoxPad
from sim.solve.loading_path import Hold, LoadingPath
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
EXACT = BatchOptions(residual_relative=1e-6)


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
    batch = Batch(stiff, [BALL, PUNCH], [0, 1, 0], options=EXACT)
    poses = np.array([_pose(1e-3, 0, 0.4e-3), _pose(-1e-3, 1e-3, 0.3e-3), _pose(0, -1e-3, 0.2e-3)])
    found = batch.step(poses)
    assert found.valid.all()
    single = [
        _single_n(stiff, body, *pose[:2], PAD.height_m - pose[2])
        for body, pose in zip((BALL, PUNCH, BALL), poses.tolist(), strict=True)
    ]
    np.testing.assert_allclose(found.raw_wrench[:, 2], single, rtol=1e-4)
    assert found.residual.max() <= 1e-6
    # The bias is not known of a model that was made otherwise.
    np.testing.assert_array_equal(found.wrench, found.raw_wrench)
    assert np.isnan(found.force_error).all()


def test_a_load_is_met(stiff: Model) -> None:
    """A pushed indenter sinks to the depth of that force; a load that was not met is forgotten."""
    batch = Batch(stiff, [BALL, PUNCH], [0, 1], options=EXACT)
    poses = np.array([_pose(0, 0, 0.1e-3), _pose(0, 0, 0.1e-3)])
    found = batch.step(poses, loads_n=np.array([0.2, 0.4]))
    assert found.valid.all()
    np.testing.assert_allclose(found.wrench[:, 2], [0.2, 0.4], rtol=1e-3)
    depth = PAD.height_m - batch.tips_m[:, 2]
    single = [_single_n(stiff, body, 0, 0, d) for body, d in zip((BALL, PUNCH), depth, strict=True)]
    np.testing.assert_allclose(single, found.raw_wrench[:, 2], rtol=1e-3)
    hasty, fresh = (Batch(stiff, [BALL], [0]) for _ in range(2))
    assert not hasty.step(poses[:1], loads_n=np.array([1e4])).valid.any()
    hasty.reset()
    np.testing.assert_allclose(
        hasty.step(poses[:1]).wrench, fresh.step(poses[:1]).wrench, rtol=1e-6
    )


def test_contact_is_lost_and_made_elsewhere(smooth: Model) -> None:
    """Without friction the gel forgets: a ball that was elsewhere feels what a new one does."""
    batch = Batch(smooth, [BALL], [0, 0], options=EXACT)
    there = np.array([_pose(1e-3, 0, 0.3e-3), _pose(-1e-3, -1e-3, 0.2e-3)])
    first = batch.step(there)
    away = batch.step(there + np.array([0, 0, 1e-3, 0, 0, 0, 0]))
    assert away.valid.all()
    assert np.abs(away.wrench).max() < 1e-9
    assert np.isfinite(away.force_error).all()
    swapped = batch.step(there[::-1])
    np.testing.assert_allclose(swapped.wrench[:, 2], first.wrench[::-1, 2], rtol=1e-4)
    batch.reset(np.array([True, False]))
    again = batch.step(there[::-1])
    np.testing.assert_allclose(again.wrench[:, 2], swapped.wrench[:, 2], rtol=1e-4)


def test_a_body_thinner_than_its_press_is_deep_comes_from_above(smooth: Model) -> None:
    """A plate that would lie below the resting surface presses like a block of its outline."""
    thin = mesh_indenter(_CORNERS * [1.0, 1.0, 0.3], np.array(_FACES, dtype=np.int32), name="thin")
    batch = Batch(smooth, [thin, BLOCK], [0, 1])
    found = batch.step(np.array([_pose(0.0, 0.0, 1.0e-3)] * 2))
    assert found.valid.all()
    np.testing.assert_allclose(found.wrench[0, 2], found.wrench[1, 2], rtol=0.05)


def test_a_trajectory_is_its_frames_one_by_one(rough: Model) -> None:
    """Down, sideways and round, held and pushed: nobody waits, and each finds the same."""
    frames = np.arange(1, 6)
    poses = np.array([[_pose(0.0, 0.0, 0.05e-3 * k)] * 3 for k in frames])
    poses[3:, 1, 0] = [0.05e-3, 0.1e-3]
    poses[3:, 2, 3:] = Rotation.from_rotvec([[0.0, 0.0, 0.02], [0.0, 0.0, 0.04]]).as_quat()
    for loads_n in (None, np.linspace(0.05, 0.2, 5)[:, None] * np.array([1.0, 0.8, 1.2])):
        batch = Batch(rough, [BALL, PUNCH], [0, 0, 1], options=EXACT)
        together = batch.follow(poses, loads_n=loads_n)
        assert together.valid.all()
        batch.reset()
        for k, pose in enumerate(poses):
            single = batch.step(pose, loads_n=None if loads_n is None else loads_n[k])
            apart = np.abs(single.wrench[:, :3] - together[k].wrench[:, :3]).max()
            assert apart <= 1e-9 * np.abs(single.wrench[:, 2]).max()
        if loads_n is not None:
            # The bias goes with the area in contact, which points enter and leave one by one.
            np.testing.assert_allclose(together.wrench[..., 2], loads_n, rtol=1e-2)


def test_who_does_not_arrive_has_no_numbers(smooth: Model) -> None:
    """One step is not enough: that frame and those behind it are not numbers, others' are."""
    hasty = replace(EXACT, steps_max=1, halvings_max=1)
    poses = np.array([[_pose(0, 0, -0.5e-3), _pose(0, 0, -0.1e-3 * k)] for k in (-3, -4)])
    found = Batch(smooth, [BALL], [0, 0], options=hasty).follow(poses)
    np.testing.assert_array_equal(found.valid, [[True, False]] * 2)
    np.testing.assert_array_equal(np.isnan(found.wrench[..., 2]), ~found.valid)


def test_a_residual_that_is_accepted_ends_a_step_after_as_many_iterations(smooth: Model) -> None:
    """Three steps leave a residual that is stated, for less work, and the next call mends it."""
    few = BatchOptions(residual_relative=1e-6, steps_max=3, accepts_residual=True)
    batch, pose = Batch(smooth, [BALL], [0], options=few), np.array([_pose(0, 0, 0.3e-3)])
    exact = Batch(smooth, [BALL], [0], options=EXACT).step(pose)
    found = batch.step(pose)
    assert found.valid.all()
    assert found.evaluations[0] < exact.evaluations[0]
    assert EXACT.residual_relative < found.residual[0] < 1.0
    for _ in range(12):
        found = batch.step(pose)
    np.testing.assert_allclose(found.wrench[0, 2], exact.wrench[0, 2], rtol=1e-3)


def test_a_long_step_is_gone_in_more_parts(smooth: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames in one part each would fail; halved they lead to the same force."""
    poses = np.array([[_pose(0.3e-3, 0, 0.1e-3)], [_pose(0, 0, 0.9e-3)]])
    wanted = Batch(smooth, [BALL], [0], options=EXACT).follow(poses)
    monkeypatch.setattr("sim.batch.batch._STEP_SHARES", (1.0, 1.0))
    batch = Batch(smooth, [BALL], [0], options=replace(EXACT, steps_max=25, halvings_max=6))
    found = batch.follow(poses)
    assert found.valid.all()
    np.testing.assert_allclose(found.wrench[..., 2], wanted.wrench[..., 2], rtol=1e-4)


def test_layers_and_gels_are_each_environments_own() -> None:
    """A stiff skin and gels of their own: as a single press on the same mesh, and in proportion."""
    soft, skin = GEL, replace(GEL, young_pa=4.0 * GEL.young_pa)
    layers = (Layer(share=0.8, material=soft), Layer(share=0.2, material=skin))
    model = sensor_model(PAD, skin, layers=layers, edge_m=2e-3)
    height = model.mesh.vertices[model.mesh.tets[model.mesh.layers == 1], 2].min()
    assert height == pytest.approx(0.8 * PAD.height_m)
    stiffer = [replace(each, young_pa=1.5 * each.young_pa) for each in (soft, skin)]
    batch = Batch(model, [BALL], [0, 0], materials=[(soft, skin), tuple(stiffer)], options=EXACT)
    found = batch.step(np.array([_pose(0, 0, 0.3e-3)] * 2))
    assert found.wrench[1] == pytest.approx(1.5 * found.wrench[0], rel=1e-3, abs=1e-6)
    assert found.raw_wrench[0, 2] == pytest.approx(_single_n(model, BALL, 0, 0, 0.3e-3), rel=1e-4)


def test_bonded_points_hold_on(stiff: Model) -> None:
    """A bonded ball that is drawn sideways pulls the gel along: as a single press's, and back."""
    options = replace(stiff.contact_options, bonded=True)
    model = Model(
        stiff.mesh,
        order=stiff.reference.order,
        law=stiff.law,
        young_pa=GEL.young_pa,
        poisson=GEL.poisson,
        contact_options=options,
    )
    batch = Batch(model, [BALL], [0], options=EXACT)
    batch.step(np.array([_pose(0, 0, 0.1e-3)]))
    found = batch.step(np.array([_pose(0.1e-3, 0, 0.1e-3)]))
    path = LoadingPath(model, BALL)
    path.advance(0.1e-3 + path.touch_m - options.distance_m - PAD.height_m)
    wanted = path.carry(shift_m=(0.1e-3, 0.0), twist_rad=0.0, hold=Hold.DEPTH).force_n
    assert found.raw_wrench[0, :3] == pytest.approx(wanted, rel=2e-2, abs=1e-4)
    assert found.raw_wrench[0, 0] < -0.01


def test_the_surface_is_stressed_as_in_a_press(smooth: Model) -> None:
    """Algorithm 1 on the batch's positions is Algorithm 1 on the same displacements."""
    batch = Batch(smooth, [BALL], [0, 0])
    batch.step(np.array([_pose(0, 0, 0.3e-3), _pose(1e-3, 0, 0.2e-3)]))
    stress = StressProjection(smooth, batch.positions, gel=batch.gel)
    stress.launch()
    for number, found in enumerate(stress.fetch()):
        wanted = surface_stress(smooth, on_host(batch.positions)[number])
        size = np.abs(wanted.traction_pa).max()
        assert size > 0.1 * GEL.young_pa
        np.testing.assert_allclose(found.traction_pa, wanted.traction_pa, atol=1e-9 * size)
        np.testing.assert_allclose(found.areas_m2, wanted.areas_m2, rtol=1e-12)


def test_tractions_sum_to_the_wrench(rough: Model) -> None:
    """Pressure and shear at the nodes carry what the indenter feels, and nothing pulls."""
    batch = Batch(rough, [BALL], [0], friction=np.array([0.5]))
    batch.step(np.array([_pose(0, 0, 0.3e-3)]))
    found = batch.step(np.array([_pose(0.1e-3, 0, 0.3e-3)]))
    pressure, shear = (array.numpy()[0] for array in batch.tractions())
    areas, force = batch.areas_m2, found.raw_wrench[0, :3]
    assert areas.sum() == pytest.approx(rough.surface.areas.sum())
    assert pressure.min() >= 0.0
    assert pressure @ areas == pytest.approx(np.linalg.norm(force), rel=0.1)
    assert 0.0 < found.force_error[0] < 1.0
    assert areas @ shear[:, 0] == pytest.approx(-force[0], rel=0.1)


def test_friction_holds_a_ball_back(rough: Model) -> None:
    """Each environment's own friction bounds what it feels along the surface."""
    batch = Batch(rough, [BALL], [0, 0], friction=np.array([0.1, 0.9]))
    batch.step(np.array([_pose(0, 0, 0.3e-3)] * 2))
    found = batch.step(np.array([_pose(0.3e-3, 0, 0.3e-3)] * 2))
    shear = -found.wrench[:, 0] / found.wrench[:, 2]
    assert found.valid.all()
    assert shear[0] == pytest.approx(0.1, abs=0.02)
    assert shear[0] < shear[1] <= 0.9


def test_a_tilted_block_is_turned_back(smooth: Model) -> None:
    """The moment of a tilted body turns it upright, and mirrored poses feel mirrored wrenches."""
    batch = Batch(smooth, [BLOCK], [0, 0], options=EXACT)
    poses = [_pose(0, 0, 0.3e-3, tilted(0.0, sign * 0.1)) for sign in (1, -1)]
    found = batch.step(np.array(poses))
    assert found.valid.all()
    assert found.wrench[0, 4] < 0.0 < found.wrench[1, 4]
    assert abs(found.wrench[0, 2] / found.wrench[1, 2] - 1.0) < 0.05


def test_who_takes_no_part_stays(smooth: Model) -> None:
    """An environment that is not active keeps its nodes to the bit."""
    batch = Batch(smooth, [BALL], [0, 0])
    batch.step(np.array([_pose(0, 0, 0.2e-3)] * 2))
    before = batch.positions.numpy()[1].copy()
    batch.step(np.array([_pose(0, 0, 0.3e-3)] * 2), active=np.array([True, False]))
    np.testing.assert_array_equal(batch.positions.numpy()[1], before)


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def test_a_repetition_is_the_same_to_the_bit(device: str) -> None:
    """Wrenches and nodes of presses that slide, from two batches, and after a reset."""
    model = sensor_model(PAD, GEL, edge_m=2e-3, friction=0.5, device=device)
    poses = np.array([[_pose(x, 0, 0.4e-3) for x in (-0.1e-3, 0, 0.3e-3)]] * 2)
    poses[1, :, 1] = 0.2e-3
    found = []
    for _ in range(2):
        batch = Batch(model, [BALL, BLOCK], [0, 1, 0])
        found.append((batch.follow(poses).raw_wrench, on_host(batch.positions).copy()))
    batch.reset()
    found.append((batch.follow(poses).raw_wrench, on_host(batch.positions).copy()))
    for first, *others in zip(*found, strict=True):
        for other in others:
            np.testing.assert_array_equal(first, other)


def test_forces_sum_to_the_same_in_any_order(smooth: Model) -> None:
    """Elements that are added backwards change no bit of the forces, but do if not rounded."""
    rng, device, wanted = np.random.default_rng(6), Device("cpu"), wp.array([1], dtype=wp.int32)
    at = device.array(smooth.nodes[None] + 1e-5 * rng.normal(size=smooth.nodes.shape), wp.vec3d)
    for shift in (0.0, 1.5 * 2.0**11):
        own, forces = smooth.gel.of([(GEL.young_pa, GEL.poisson)]), []
        gel = replaced(GelArrays, own, shift=shift)
        arrays = {name: getattr(gel, name) for name in ("nodes", "inverse_jacobians", "weights")}
        turned = {name: device.array(a.numpy()[::-1], a.dtype) for name, a in arrays.items()}
        for each in (gel, replaced(GelArrays, gel, **turned)):
            buffers = smooth.gel.buffers(1)
            smooth.gel.recorded(wanted, at, buffers, gel=each).launch()
            forces.append(buffers[0].numpy())
        assert np.array_equal(*forces) == (shift > 0.0)
        np.testing.assert_allclose(forces[0][0], smooth.gel.gradient(at.numpy()[0]), atol=1e-11)


def test_poses_that_are_none_are_refused(smooth: Model) -> None:
    """The message names what was given and what is wanted."""
    batch = Batch(smooth, [BALL], [0])
    for poses, named in ((np.full((1, 7), np.nan), "finite"), (np.zeros((1, 7)), "quaternion")):
        with pytest.raises(ConfigError, match=named):
            batch.step(poses)
    with pytest.raises(ConfigError, match=r"shape \(1, 2, 7\)"):
        batch.step(np.zeros((2, 7)))


def test_loads_that_do_not_fit_are_refused(smooth: Model) -> None:
    """Their shape is named; who takes part is the caller's own and stays as it was."""
    batch, poses = Batch(smooth, [BALL], [0, 0]), np.array([_pose(0, 0, 0.1e-3)] * 2)
    with pytest.raises(ConfigError, match=r"loads_n of shape \(1, 1\)"):
        batch.step(poses, loads_n=np.array([0.1]))
    hasty = Batch(smooth, [BALL], [0, 0], options=replace(EXACT, steps_max=1, halvings_max=1))
    active = np.array([True, True])
    found = hasty.step(poses, loads_n=np.array([0.1, 0.1]), active=active)
    assert active.all()
    assert not found.valid.any()
    for numbers in (found.wrench, found.force_error, found.tips_m):
        assert np.isnan(numbers).all()


def test_arguments_that_do_not_fit_are_refused(smooth: Model) -> None:
    """Edges in millimetres, a body that is not there, friction without a model, half a pad."""
    with pytest.raises(ConfigError, match="edge_m is 2 m"):
        sensor_model(PAD, GEL, edge_m=2.0)
    with pytest.raises(ConfigError, match="which"):
        Batch(smooth, [BALL], [1])
    with pytest.raises(ConfigError, match="friction"):
        Batch(smooth, [BALL], [0], friction=np.array([0.5]))
    half = replace(smooth.mesh, symmetry=MirrorSymmetry(mirror_x=True))
    model = Model(half, order=smooth.reference.order, law=smooth.law, young_pa=1e5, poisson=0.45)
    with pytest.raises(ConfigError, match="whole pad"):
        Batch(model, [BALL], [0])


def test_the_mesh_is_fine_all_over_its_surface() -> None:
    """Edges on a domed top are as short as asked, on the dome on average; those below longer."""
    pad = replace(PAD, dome_radius_x_m=30e-3)
    mesh = sensor_mesh(pad, edge_m=1e-3)
    ends = np.concatenate([mesh.tets[:, [a, b]] for a in range(4) for b in range(a)])
    lengths = np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1)
    top = mesh.vertices[:, 2] > pad.height_at(*mesh.vertices[:, :2].T)
    middles = mesh.vertices[ends[top[ends].all(axis=1)]].mean(axis=1)
    assert abs((middles[:, 2] - pad.height_at(*middles[:, :2].T)).mean()) < 1e-6
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
        batch = Batch(model, [BALL, PUNCH, BLOCK], [0, 1, 2], options=EXACT)
        found.append(batch.step(poses).wrench)
    size = found[0][:, 2:3] * np.array([1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3])
    assert np.abs((found[1] - found[0]) / size).max() < 1e-3
