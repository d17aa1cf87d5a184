"""A batch gives what presses one by one give, whatever its environments differ in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.batch.batch import Batch
from sim.batch.environment import BatchOptions, Environment, Trajectory
from sim.batch.pilot import Pilot, batch_model
from sim.batch.steps import Steps
from sim.device import on_host
from sim.effects.plan import plan_effects
from sim.effects.scene_path import follow, path_for
from sim.fields.stress import surface_stress
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.material import Layer, Material
from sim.scene.pad import DiscPad
from sim.scene.scene import ContactMode, Motion, Preset, Scene, Target
from sim.solve.descent_state import Status
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.studies.bench.press import scaled, trajectory_of
from sim.studies.objects.shapes import OBJECTS
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

_YOUNG, _POISSON = 0.3e6, 0.47
_SCENE = Scene(
    pad=DiscPad(radius_m=7e-3, height_m=3.5e-3),
    material=Material(young_pa=_YOUNG, poisson=_POISSON),
    indenter=Cylinder(diameter_m=4e-3, fillet_m=0.4e-3),
    target=Target(depth_m=0.4e-3),
)
_DEPTHS = 0.4e-3 * np.arange(1, 7) / 6
_TRAJECTORY = Trajectory(depths_m=_DEPTHS)
_NEAR = Trajectory(depths_m=np.array([0.05e-3, 0.1e-3, 0.15e-3]))
_EXACT = BatchOptions(residual_relative=1e-7)
_BALL = replace(_SCENE, indenter=Sphere(diameter_m=6e-3), target=Target(depth_m=0.3e-3))


@pytest.fixture(scope="module")
def model() -> Model:
    """A quarter of a disc under a punch."""
    return batch_model(_SCENE, refinement=0.6)


@pytest.fixture(scope="module")
def pilot(model: Model) -> Pilot:
    """A pilot to 0.4 mm."""
    return Pilot(model, _SCENE.indenter, _TRAJECTORY, count=3)


def _gel(young_pa: float = _YOUNG, poisson: float = _POISSON) -> Environment:
    return Environment(materials=(Material(young_pa=young_pa, poisson=poisson),))


def _single(model: Model, indenter: Indenter, depths_m: FloatArray) -> FloatArray:
    path = LoadingPath(model, indenter)
    return np.array([path.advance(float(depth)).force_n[2] for depth in depths_m])


def test_one_environment_is_a_press(pilot: Pilot) -> None:
    """Every frame's force is that of a press on the same mesh, and is balanced by the base."""
    found = Batch(pilot, [Environment()], options=_EXACT).press(_TRAJECTORY)
    assert found.force_n[:, 0, 2] == pytest.approx(
        _single(pilot.model, _SCENE.indenter, _DEPTHS), rel=1e-6
    )
    assert np.abs(found.imbalance).max() <= 1e-7
    assert found.gap_m.min() > 0.0
    assert not found.failed.any()


def test_neighbours_do_not_matter(pilot: Pilot) -> None:
    """Unlike gels and depths side by side give what each gives alone."""
    environments = [_gel(), _gel(young_pa=0.5e6), _gel(poisson=0.42), _gel()]
    trajectories = [_TRAJECTORY] * 3 + [scaled(_TRAJECTORY, 0.8)]
    together = Batch(pilot, environments, options=_EXACT).press(trajectories)
    for number, (environment, trajectory) in enumerate(
        zip(environments, trajectories, strict=True)
    ):
        alone = Batch(pilot, [environment], options=_EXACT).press(trajectory)
        assert together.force_n[:, number] == pytest.approx(alone.force_n[:, 0], rel=1e-6, abs=1e-9)


def test_force_goes_with_the_modulus(pilot: Pilot) -> None:
    """Contact stiffness goes with E too, so that all forces of a stiffer gel are in proportion."""
    found = Batch(pilot, [_gel(), _gel(young_pa=3.0 * _YOUNG)], options=_EXACT).press(_TRAJECTORY)
    assert found.force_n[:, 1, 2] == pytest.approx(3.0 * found.force_n[:, 0, 2], rel=1e-6)


def test_loads_and_depths_agree(model: Model, pilot: Pilot) -> None:
    """Pushed with the forces of a press to given depths, the indenter goes to those depths."""
    displaced = Batch(pilot, [Environment()], options=_EXACT).press(_TRAJECTORY)
    trajectory = Trajectory(loads_n=displaced.force_n[:, 0, 2])
    pushed = Batch(
        Pilot(model, _SCENE.indenter, trajectory, count=3), [Environment()], options=_EXACT
    ).press(trajectory)
    assert pushed.depth_m[:, 0] == pytest.approx(_DEPTHS, rel=1e-5)
    assert pushed.force_n[:, 0, 2] == pytest.approx(displaced.force_n[:, 0, 2], rel=1e-6)


def test_an_indenter_beside_the_pilots_place() -> None:
    """A ball 0.5 mm off to either side feels the same, and what a press there feels."""
    model = batch_model(_BALL, refinement=0.5, symmetric=False)
    trajectory = Trajectory(depths_m=np.array([0.1e-3, 0.2e-3, 0.3e-3]))
    pilot = Pilot(model, _BALL.indenter, trajectory, count=2)
    found = Batch(
        pilot,
        [Environment(offset_m=(x, 0.0)) for x in (0.5e-3, -0.5e-3)],
        options=BatchOptions(residual_relative=1e-8),
    ).press(trajectory)
    path = LoadingPath(model, _BALL.indenter, centre_m=(0.5e-3, 0.0))
    assert found.force_n[-1, 0] == pytest.approx(path.advance(0.3e-3).force_n, rel=1e-6, abs=1e-8)
    assert found.force_n[-1, 0, 2] == pytest.approx(found.force_n[-1, 1, 2], rel=1e-3)
    assert found.force_n[-1, 0, 0] == pytest.approx(-found.force_n[-1, 1, 0], rel=5e-2)


def test_a_step_far_beside_the_pilots_path_does_not_start_with_its_motion() -> None:
    """Neither the path there, which the pilot never took, nor a press where it never was."""
    model = batch_model(_BALL, refinement=0.5, symmetric=False)
    trajectory = Trajectory(depths_m=np.array([0.1e-3, 0.2e-3, 0.3e-3]))
    batch = Batch(
        Pilot(model, _BALL.indenter, trajectory, count=3), [Environment()], options=_EXACT
    )
    follows = []
    for depth_m, x_m in ((0.1e-3, 0.0), (0.1e-3, 0.5e-3), (0.2e-3, 0.5e-3)):
        assert batch.step(depths_m=np.array([depth_m]), shifts_m=np.array([[x_m, 0.0]])).all()
        follows.append(int(batch._arrays.history.follows.numpy()[0]))
    assert follows == [1, 0, 0]


def test_a_pilot_that_slides_at_less_force_too() -> None:
    """Its branch leaves the way down early enough, and who slides there finds the same."""
    scene = replace(_BALL, target=Target(force_n=0.2), friction=0.5)
    model = batch_model(scene, refinement=0.5, symmetric=False)
    down, beside = np.minimum(1.0, [0.5, 1.0, 1.0, 1.0]), np.array([0.0, 0.0, 0.05e-3, 0.1e-3])
    trajectory = Trajectory(loads_n=0.2 * down, shifts_m=np.column_stack([beside, 0.0 * beside]))
    found = []
    for shares in ((), (0.8,)):
        pilot = Pilot(model, scene.indenter, trajectory, count=4, shares=shares)
        batch = Batch(pilot, [Environment()], options=_EXACT)
        found.append(batch.press(replace(trajectory, loads_n=0.16 * down)).force_n[:, 0])
    assert found[1] == pytest.approx(found[0], rel=1e-4, abs=1e-6)
    branch = next(each for each in pilot.points if each.goal[0] == pytest.approx(0.16))
    assert pilot.points[branch.before - 1].goal[0] < 0.16
    assert [each.frame for each in pilot.states] == [0, 1, 2, 3, 2, 3]
    assert pilot.points[-1].goal == pytest.approx([0.16, 0.1e-3, 0.0, 0.0])
    with pytest.raises(ConfigError, match=r"shares \(93,\)"):
        Pilot(model, scene.indenter, trajectory, shares=(93,))


def test_who_need_not_wait_finds_the_same(pilot: Pilot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each at its own pace, environments arrive where they do in step with each other."""
    shares = np.linspace(0.7, 1.0, 5)
    soft = [replace(_SCENE.material, young_pa=share * _SCENE.material.young_pa) for share in shares]
    batch = Batch(pilot, [Environment(materials=(each,)) for each in soft], options=_EXACT)
    trajectories = [scaled(_TRAJECTORY, float(share)) for share in shares]
    together = batch.press(trajectories)
    monkeypatch.setattr(Steps, "paced", True)
    again = Batch(pilot, batch.environments, options=_EXACT).press(trajectories)
    assert not again.failed.any()
    assert again.force_n == pytest.approx(together.force_n, rel=1e-6, abs=1e-9)
    assert again.depth_m == pytest.approx(together.depth_m, rel=1e-12)


_KINDS = {
    "friction": replace(_BALL, contact=ContactMode.FRICTION, friction=0.8),
    "slide": replace(
        _BALL,
        contact=ContactMode.FRICTION,
        friction=0.5,
        target=Target(force_n=0.3),
        motion=Motion(shift_m=(0.1e-3, 0.0)),
    ),
    "twist": replace(
        _SCENE,
        contact=ContactMode.FRICTION,
        friction=0.5,
        target=Target(depth_m=0.1e-3),
        motion=Motion(twist_rad=0.03),
    ),
    "bonded": replace(_BALL, contact=ContactMode.BONDED, target=Target(depth_m=0.1e-3)),
    "layers": replace(
        _BALL,
        layers=(
            Layer(share=0.7, material=Material(young_pa=0.2e6, poisson=0.47)),
            Layer(share=0.3, material=Material(young_pa=0.6e6, poisson=0.47)),
        ),
    ),
    "triangles": replace(_BALL, target=Target(depth_m=0.1e-3)),
}


@pytest.mark.parametrize("kind", list(_KINDS))
def test_whatever_a_press_does_a_batch_does(kind: str) -> None:
    """Friction, a slide under load, a twist, bond, layers and triangles: the press's own force."""
    _as_a_press(kind, device="cpu")


@pytest.mark.gpu
@pytest.mark.parametrize("kind", list(_KINDS))
def test_whatever_a_press_does_a_gpu_does(kind: str) -> None:
    """The same, on a GPU."""
    _as_a_press(kind, device="cuda:0")


def _as_a_press(kind: str, *, device: str) -> None:
    scene = replace(_KINDS[kind], preset=Preset.FAST, refinement=0.7)
    model = path_for(scene, plan_effects(scene)).model
    if kind == "triangles":  # on the mesh of a ball, which is small
        scene = replace(scene, indenter=OBJECTS["hexagon"]())
    path = LoadingPath(model, scene.indenter)
    trajectory = trajectory_of(scene, frame_count=8)
    pilot = Pilot(model, scene.indenter, trajectory, count=4)
    stiffer = tuple(replace(each, young_pa=1.1 * each.young_pa) for each in scene.materials)
    environments = [Environment(), Environment(materials=stiffer)]
    batch = Batch(
        pilot, environments, options=replace(_EXACT, residual_relative=1e-6), device=device
    )
    found = batch.press(trajectory)
    single = follow(scene, path)
    assert not found.failed.any()
    size = float(np.linalg.norm(single.force_n))
    # Where points stick or slide, the force depends a little on how many steps led there.
    apart = np.abs(found.force_n[-1, 0] - single.force_n).max() / size
    assert apart <= (1e-2 if model.contact_options.is_tangential else 1e-4)
    if scene.target.force_n is None:
        assert found.force_n[-1, 1] == pytest.approx(
            1.1 * found.force_n[-1, 0], rel=1e-3, abs=1e-4 * size
        )


def test_who_does_not_arrive_goes_on_in_parts(pilot: Pilot) -> None:
    """A last frame far from the others is reached in parts, from where it was."""
    far = Trajectory(depths_m=np.array([0.05e-3, 0.1e-3, 0.4e-3]))
    found = Batch(pilot, [Environment(), Environment()], options=_EXACT).press([far, _NEAR])
    assert not found.failed.any()
    wanted = _single(pilot.model, _SCENE.indenter, far.along)
    assert found.force_n[:, 0, 2] == pytest.approx(wanted, rel=1e-6)


def test_who_needs_fewer_parts_is_not_lost(pilot: Pilot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two fail in a frame; one arrives in two parts, the other in four: both have numbers."""
    batch = Batch(pilot, [Environment(), Environment()], options=_EXACT)
    batch.step(depths_m=np.full(2, _DEPTHS[0]))
    attempt, tried = batch._attempt, list[NDArray[np.bool_]]()

    def hindered(goal: FloatArray, taking: NDArray[np.bool_]) -> NDArray[np.bool_]:
        tried.append(taking.copy())
        away = goal[:, 0] - batch._at[:, 0]
        may = away <= np.array([0.51, 0.26]) * (_DEPTHS[1] - _DEPTHS[0])
        return attempt(goal, taking & may)

    results = batch.prepare(2).results()
    results["status"][0] = Status.DONE
    monkeypatch.setattr(batch, "_attempt", hindered)
    trajectory = np.zeros((2, 2, 4))
    trajectory[:, :, 0] = _DEPTHS[:2, None]
    batch._go_on(1, trajectory, results)
    assert len(tried) > 4
    assert (results["status"][1] == Status.DONE).all()
    single = _single(pilot.model, _SCENE.indenter, _DEPTHS[:2])
    assert 4.0 * results["push"][1, :, 2] == pytest.approx([single[1]] * 2, rel=1e-6)


def test_a_step_goes_on_from_a_press(pilot: Pilot) -> None:
    """After a press, parts of a step that is too long begin where the press ended."""
    batch = Batch(pilot, [Environment()], options=_EXACT)
    batch.press(_NEAR)
    assert batch.step(depths_m=np.array([0.4e-3])).all()
    force = 4.0 * batch.prepare(1).results()["push"][0, 0, 2]
    wanted = _single(pilot.model, _SCENE.indenter, np.append(_NEAR.along, 0.4e-3))[-1]
    assert force == pytest.approx(wanted, rel=1e-6)


@pytest.mark.gpu
@pytest.mark.parametrize("count", [1, 9, 70, 300])
def test_a_gpu_gives_what_the_cpu_gives(pilot: Pilot, count: int) -> None:
    """In one block of the inverse's product, in a half full one and in more."""
    environments = [_gel(young_pa=(1.0 + 0.001 * k) * _YOUNG) for k in range(count)]
    host = Batch(pilot, environments[:9], options=_EXACT).press(_TRAJECTORY)
    found = Batch(pilot, environments, options=_EXACT, device="cuda:0").press(_TRAJECTORY)
    assert not found.failed.any()
    assert found.force_n[:, :9] == pytest.approx(host.force_n, rel=1e-6, abs=1e-9)


def test_a_batch_can_be_pressed_again(pilot: Pilot) -> None:
    """Nothing of the first press is left in the second."""
    batch = Batch(pilot, [Environment()], options=_EXACT)
    assert np.array_equal(batch.press(_TRAJECTORY).force_n, batch.press(_TRAJECTORY).force_n)


def test_steps_are_a_callers_own(pilot: Pilot) -> None:
    """Step by step, one environment put back meanwhile, is what a press gives."""
    batch = Batch(pilot, [Environment(), Environment()], options=_EXACT)
    for depth in _DEPTHS[:3]:
        assert batch.step(depths_m=np.full(2, depth)).all()
    batch.reset([1])
    assert batch.step(depths_m=np.array([_DEPTHS[3], _DEPTHS[0]])).all()
    forces = batch.prepare(1).results()["push"][0, :, 2]
    alone = Batch(pilot, [Environment()], options=_EXACT).press(_TRAJECTORY).force_n[:, 0, 2]
    assert 4.0 * forces == pytest.approx([alone[3], alone[0]], rel=1e-5)
    still = _moved(batch)[0].copy()
    batch.step(depths_m=np.array([0.0, _DEPTHS[1]]), active=np.array([False, True]))
    assert np.array_equal(_moved(batch)[0], still)


def _moved(batch: Batch) -> FloatArray:
    """Return the last frames' nodal displacements [m], shape [environment_count, node_count, 3]."""
    return on_host(batch.positions) - batch.pilot.model.nodes


def test_the_surface_is_stressed_as_in_a_press(model: Model, pilot: Pilot) -> None:
    """Algorithm 1 of every environment is Algorithm 1 on the same displacements."""
    _stressed(model, pilot, device="cpu")


@pytest.mark.gpu
def test_a_gpu_finds_the_same_stress(model: Model, pilot: Pilot) -> None:
    """Algorithm 1 on a GPU is Algorithm 1 on the host."""
    _stressed(model, pilot, device="cuda:0")


def _stressed(model: Model, pilot: Pilot, *, device: str) -> None:
    batch = Batch(pilot, [_gel(), _gel(young_pa=2.0 * _YOUNG)], options=_EXACT, device=device)
    batch.press(_TRAJECTORY)
    moved = _moved(batch)
    batch.stress.launch()
    for number, found in enumerate(batch.stress.fetch()):
        wanted = surface_stress(model, model.nodes + moved[number])
        stiffer = 1.0 + number
        size = np.abs(wanted.traction_pa).max()
        assert size > 0.1 * _YOUNG
        parts = found.normal_pa[:, None] * found.normals + found.tangential_pa
        for here in (found.traction_pa, parts):
            np.testing.assert_allclose(here / stiffer, wanted.traction_pa, atol=1e-9 * size)
        np.testing.assert_allclose(found.areas_m2, wanted.areas_m2, rtol=1e-12)


def test_displacements_are_those_of_a_press(pilot: Pilot) -> None:
    """The last frame's nodes lie where a press leaves them."""
    batch = Batch(pilot, [Environment()], options=_EXACT)
    batch.press(_TRAJECTORY)
    path = LoadingPath(pilot.model, _SCENE.indenter)
    for depth in _DEPTHS:
        point = path.advance(float(depth))
    moved = point.state.positions - pilot.model.nodes
    assert np.abs(_moved(batch)[0] - moved).max() <= 1e-9


@pytest.mark.parametrize(
    ("environments", "told"),
    [
        ([], "without environments"),
        ([Environment(offset_m=(1e-3, 0.0))], "symmetry lets only a quarter"),
        ([Environment(friction=0.3)], "environment 0 has a friction of 0.3"),
    ],
)
def test_what_does_not_fit_is_refused(
    pilot: Pilot, environments: list[Environment], told: str
) -> None:
    """The error says which environment and what to do."""
    with pytest.raises(ConfigError, match=told) as caught:
        Batch(pilot, environments)
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("trajectories", "told"),
    [
        ([_TRAJECTORY], "1 trajectories of 6 frames for 2 environments"),
        ([_TRAJECTORY, Trajectory(depths_m=_DEPTHS[:3])], "trajectories of 3, 6 frames"),
        ([Trajectory(loads_n=_DEPTHS)] * 2, "environment 0 has loads"),
    ],
)
def test_courses_that_do_not_fit_are_refused(
    pilot: Pilot, trajectories: list[Trajectory], told: str
) -> None:
    """As many as environments, alike in length, and as the pilot's."""
    with pytest.raises(ConfigError, match=told) as caught:
        Batch(pilot, [Environment(), Environment()]).press(trajectories)
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({}, "both depths and loads, or neither"),
        ({"depths_m": np.array([])}, "no frames"),
        ({"depths_m": np.array([np.nan])}, "not finite"),
        ({"depths_m": _DEPTHS, "turns_rad": np.zeros(2)}, "turns_rad: 2 of them for 6 frames"),
    ],
)
def test_a_course_is_whole(given: dict[str, FloatArray], told: str) -> None:
    """Depths or loads, frame by frame, and as many of the rest."""
    with pytest.raises(ConfigError, match=told):
        Trajectory(**given)


def test_a_press_that_fails_is_told_from_those_that_do_not(pilot: Pilot) -> None:
    """One step is not enough: the frames that were not reached are not numbers."""
    hasty = replace(_EXACT, steps_max=1, parts_max=2)
    found = Batch(pilot, [Environment()], options=hasty).press(_TRAJECTORY)
    assert found.failed.all()
    assert np.isnan(found.depth_m[-1, 0])
