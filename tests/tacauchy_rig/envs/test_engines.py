"""A ball on a gel in newton and in MuJoCo: it rests, momentum is kept, and nothing tunnels."""

import sys
from typing import Any

import mujoco
import newton
import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from sim.batch.force_bias import press_alone
from sim.coupling.rigid_body_contact import UNMOVED, GelContact
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.pad import BoxPad
from sim.scene.scene import ContactMode, Target
from sim.sensor.sensor import load_sensor
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.envs.gym_imperfections import Imperfections
from tacauchy_rig.envs.gym_tasks import PressToForce
from tacauchy_rig.envs.mujoco import ball_on_pad
from tacauchy_rig.envs.newton import TactileSensor, balls_on_pads

wp.config.enable_backward = False  # of newton's kernels, which nobody differentiates here
STEP_S, MASS_KG, GRAVITY = 1e-3, 0.02, 9.81
_FRICTION = {"contact": ContactMode.FRICTION, "friction": 0.5}


def _go(model: Any, sensor: TactileSensor, count: int, state: Any = None) -> tuple[Any, np.ndarray]:
    """Step, and return the state and the impulse on the balls along z [N s], [count]."""
    solver, after = newton.solvers.SolverSemiImplicit(model), model.state()
    state, impulse = state or model.state(), 0.0
    for _ in range(count):
        state.clear_forces()
        sensor.update(state)
        sensor.apply(state, STEP_S)
        impulse = impulse + state.body_f.numpy()[1::2, 2] * STEP_S
        solver.step(state, after, None, None, STEP_S)
        state, after = after, state
    return state, np.asarray(impulse)


@pytest.mark.slow
def test_balls_rest_on_gels_in_newton_with_their_weight_as_wrench() -> None:
    """Both rest within 1 % of their weight; the impulse is what stopped gravity's; none sinks."""
    model, sensor = balls_on_pads(2, device="cpu", mass_kg=MASS_KG)
    state, impulse = _go(model, sensor, 120)
    weight_n = MASS_KG * GRAVITY
    np.testing.assert_allclose(sensor.contact.wrench.numpy()[:, 2], weight_n, rtol=0.01)
    assert sensor.contact.is_valid.numpy().all()
    gained = MASS_KG * state.body_qd.numpy()[1::2, 2]
    np.testing.assert_allclose(impulse - 120 * STEP_S * weight_n, gained, atol=0.01 * impulse.max())


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_ball_beside_the_middle_that_falls_at_50_mm_s_stays() -> None:
    """After 1,000 steps it rests where it fell, within 1 % of its weight."""
    model, sensor = balls_on_pads(1, device="cpu", mass_kg=MASS_KG)
    state = model.state()
    poses, speeds = state.body_q.numpy(), state.body_qd.numpy()
    poses[1, :2], speeds[1, 2] = [0.7e-3, -0.4e-3], -0.05
    state.body_q.assign(poses)
    state.body_qd.assign(speeds)
    state, _impulse = _go(model, sensor, 1000, state)
    assert sensor.contact.wrench.numpy()[0, 2] == pytest.approx(MASS_KG * GRAVITY, rel=0.01)
    assert np.abs(state.body_qd.numpy()[1, :3]).max() < 5e-4
    assert np.abs(state.body_q.numpy()[1, :2] - poses[1, :2]).max() < 0.5e-3
    assert sensor.contact.is_valid.numpy().all()


@pytest.mark.slow
def test_a_fast_ball_comes_back_from_the_gel_in_newton() -> None:
    """At 50 mm/s, without loss, it keeps its energy within a tenth, and does not go through."""
    model, sensor = balls_on_pads(
        1, device="cpu", mass_kg=MASS_KG, fall_m=2e-4, loss_s=0.0, friction=0.0
    )
    state, top_m = model.state(), sensor.contact.batch.model.height_m
    speeds = state.body_qd.numpy()
    speeds[1, 2] = -0.05
    state.body_qd.assign(speeds)
    heights, energies = [], []
    for _ in range(24):
        # The solver's speeds are half a step late: in free fall they become current like this.
        speed = float(state.body_qd.numpy()[1, 2]) - 0.5 * STEP_S * GRAVITY
        heights.append(float(state.body_q.numpy()[1, 2]) - top_m)
        energies.append(0.5 * speed**2 + GRAVITY * heights[-1])
        state, _impulse = _go(model, sensor, 1, state)
    assert -0.6e-3 < min(heights) < -0.4e-3
    assert heights[-1] > 0.0
    assert energies[-1] == pytest.approx(energies[0], rel=0.1)


def test_a_ball_far_away_costs_nothing_and_has_no_wrench() -> None:
    """Beside and above the gel nothing is computed; the image is the untouched one."""
    model, sensor = balls_on_pads(1, device="cpu", fall_m=5e-3)
    bare = sensor.contact.images().numpy().copy()
    _go(model, sensor, 2)
    assert not sensor.contact.wrench.numpy().any()
    assert sensor.contact.is_valid.numpy().all()
    assert not sensor.contact.is_near.numpy().any()
    np.testing.assert_array_equal(sensor.contact.images().numpy(), bare)


def test_a_peg_that_lies_on_the_gel_is_felt_though_its_end_is_far_beside() -> None:
    """A cylinder reaches as far as its axis, not as far as it is thick."""
    contact = GelContact(Cylinder(diameter_m=4e-3, fillet_m=1e-3), count=1, edge_m=3e-3)
    pad = load_sensor("gelsight-mini").pad
    assert isinstance(pad, BoxPad)
    lying = Rotation.from_euler("y", 90.0, degrees=True).as_quat()
    end = [-0.5 * pad.size_x_m - 8e-3, 0.0, pad.height_m + 2e-3 - 0.3e-3, *lying]
    contact.pads.frames.assign([UNMOVED])
    contact.objects.frames.assign([end])
    contact.press()
    assert contact.is_valid.numpy().all()
    assert contact.wrench.numpy()[0, 2] > 0.1


def test_a_sliding_ball_feels_no_more_than_coulombs_force() -> None:
    """Loss adds to friction while the gel still gives way, not beyond the friction itself."""
    contact = GelContact(Sphere(diameter_m=8e-3), count=1, edge_m=3.5e-3, friction=0.3)
    pad = load_sensor("gelsight-mini").pad
    contact.pads.frames.assign([UNMOVED])
    contact.objects.velocities.assign([[0.2, 0.0, 0.0]])
    contact.objects.inverse_masses.assign([50.0])
    for x_m in (0.0, 0.3e-3, 0.6e-3):
        contact.objects.frames.assign([[x_m, 0.0, pad.height_m - 0.5e-3, *UNMOVED[3:]]])
        contact.press()
        contact.react(STEP_S)
        load = contact.on_objects.numpy()[0]
        assert load[0] < contact.wrench.numpy()[0, 0] + 1e-9
        assert np.hypot(*load[:2]) == pytest.approx(0.3 * load[2], rel=0.03)


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def test_no_array_goes_through_the_host(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the solver on a processor looks at arrays, which are its own; on a GPU nobody does."""
    model, sensor = balls_on_pads(2, device=device, fall_m=-1e-4)
    state, _impulse = _go(model, sensor, 2)
    callers = []

    def spied(name: str) -> None:
        original = getattr(wp.array, name)

        def call(array: Any, *args: Any, **settings: Any) -> Any:
            if name == "numpy" or args or settings.get("data") is not None:
                callers.append(sys._getframe(1).f_globals["__name__"])
            return original(array, *args, **settings)

        monkeypatch.setattr(wp.array, name, call)

    for name in ("numpy", "__init__"):
        spied(name)
    sensor.update(state)
    sensor.apply(state, STEP_S)
    solver = {"sim.solve.descents", "sim.batch.contact_inverse", "sim.batch.rest_inverse"}
    assert {*callers} <= (solver if device == "cpu" else set())
    monkeypatch.undo()
    assert sensor.contact.is_near.numpy().all()


@pytest.mark.gpu
def test_an_engines_graph_takes_the_sensor_along() -> None:
    """A captured step presses as one that is not, where the ball then is."""
    wrenches = []
    for is_captured in (False, True):
        model, sensor = balls_on_pads(2, device="cuda:0", fall_m=-1e-4)
        state, _impulse = _go(model, sensor, 1)
        graph = None
        if is_captured:
            with wp.ScopedCapture(device="cuda:0") as capture:
                sensor.update(state)
                sensor.apply(state, STEP_S)
            graph = capture.graph
        poses = state.body_q.numpy()
        poses[1::2, 2] -= 0.1e-3
        state.body_q.assign(poses)
        if graph is None:
            sensor.update(state)
        else:
            wp.capture_launch(graph)
        wrenches.append(sensor.contact.wrench.numpy())
    np.testing.assert_allclose(*wrenches, rtol=1e-6, atol=1e-9)
    assert wrenches[0][:, 2].min() > 0.1


def test_as_many_objects_as_pads_are_needed() -> None:
    """Labels that name nothing are refused."""
    model, _sensor = balls_on_pads(1, device="cpu")
    with pytest.raises(ConfigError, match="1 pads and 0 objects"):
        TactileSensor(model, "pad", "peg", Sphere(diameter_m=8e-3))


def test_a_ball_rests_on_a_gel_in_mujoco_with_its_weight_as_wrench() -> None:
    """The wrench is the weight within 1 %, and the pad's reaction is its opposite."""
    model, sensor = ball_on_pad(mass_kg=MASS_KG)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for _ in range(120):
        sensor.update(data)
        mujoco.mj_step(model, data)
    assert sensor.contact.wrench.numpy()[0, 2] == pytest.approx(MASS_KG * GRAVITY, rel=0.01)
    np.testing.assert_allclose(data.xfrc_applied[1, :3], -data.xfrc_applied[2, :3])


def _in_newton(**gel: Any) -> tuple[float, np.ndarray, dict[str, Any]]:
    """Return F_z on a ball of 2 N at rest [N], its lowest point [m], and the contact."""
    model, sensor = balls_on_pads(1, device="cpu", mass_kg=2.0 / GRAVITY, **gel)
    state = model.state()
    poses = state.body_q.numpy()
    poses[1, :3] += [1.3e-3, -2.1e-3, -0.9e-3]
    state.body_q.assign(poses)
    state, _impulse = _go(model, sensor, 300, state)
    sensor.update(state)
    return _felt(sensor), state.body_q.numpy()[1, :3], _FRICTION


def _in_mujoco(**gel: Any) -> tuple[float, np.ndarray, dict[str, Any]]:
    """Return the same; the ball is in the middle, since beside it it rolls."""
    model, sensor = ball_on_pad(mass_kg=2.0 / GRAVITY, fall_m=-0.8e-3, **gel)
    data = mujoco.MjData(model)
    for _ in range(200):
        sensor.update(data)
        mujoco.mj_step(model, data)
    sensor.update(data)
    return _felt(sensor), data.xipos[2] - [0.0, 0.0, 4e-3], _FRICTION


def _felt(sensor: Any) -> float:
    force_n = float(sensor.contact.wrench.numpy()[0, 2])
    assert force_n == pytest.approx(2.0, rel=0.01)
    return force_n


def _in_gymnasium(**gel: Any) -> tuple[float, np.ndarray, dict[str, Any]]:
    """Return what is observed of a press without friction, by an arm that holds its pose."""
    env = PressToForce(image=False, **gel)
    env.imperfections = Imperfections(stiffness=0.0)
    env.reset(seed=46)
    env.poses[0, :3] = [-2.0e-3, 3.1e-3, env.pad.height_at(-2.0e-3, 3.1e-3) + 0.1e-3]
    for _ in range(9):
        seen, *_ = env.advance(np.array([[0.0, 0.0, -1.0]]))
    return float(seen["force"][0, 2]), env.poses[0, :3], {}


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("engine", [_in_newton, _in_mujoco, _in_gymnasium])
def test_with_a_measured_bias_an_engines_press_is_that_of_press(engine: Any) -> None:
    """F_z is within 1 % of a press to the same depth, at the same place, on a mesh of its own."""
    force_n, tip_m, contact = engine(measures_bias=True)
    gel = load_sensor("gelsight-mini")
    assert isinstance(gel.pad, BoxPad)
    depth_m = float(gel.pad.height_at(*tip_m[:2, None])[0] - tip_m[2])
    scene = gel.scene(Sphere(diameter_m=8e-3), Target(depth_m=depth_m), **contact)
    alone_n, _pose = press_alone(scene, tip_m[:2], np.array(UNMOVED[3:]))
    assert force_n == pytest.approx(alone_n, rel=0.01)
