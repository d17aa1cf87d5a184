"""A batch gives what presses one by one give, whatever its environments differ in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from sim.arrays import FloatArray
from sim.batch import iteration
from sim.batch.batch import Batch
from sim.batch.environment import BatchOptions, Environment
from sim.batch.kernels.gathering import Layout
from sim.batch.pilot import FactoredStiffness, Pilot, batch_model
from sim.device import Device
from sim.fields.stress import surface_stress
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Scene, Target
from sim.solve.load_steps.path import LoadingPath
from sim.solve.model import Model
from tacauchy_rig.errors import ConfigError

_YOUNG, _POISSON = 0.3e6, 0.47
_SCENE = Scene(
    pad=DiscPad(radius_m=7e-3, height_m=3.5e-3),
    material=Material(young_pa=_YOUNG, poisson=_POISSON),
    indenter=Cylinder(diameter_m=4e-3, fillet_m=0.4e-3),
    target=Target(depth_m=0.4e-3),
)
_DEPTHS = 0.4e-3 * np.arange(1, 7) / 6
# The barrier as a parabola below half of d_hat is what single presses have.
_EXACT = BatchOptions(residual_relative=1e-7, extension=0.5)


@pytest.fixture(scope="module")
def model() -> Model:
    """A quarter of a disc under a punch."""
    return batch_model(_SCENE, refinement=0.6)


@pytest.fixture(scope="module")
def pilot(model: Model) -> Pilot:
    """A pilot to 0.4 mm."""
    return Pilot(model, _SCENE.indenter, 0.4e-3, count=3)


def _environment(**kwargs: object) -> Environment:
    given: dict[str, object] = {"young_pa": _YOUNG, "poisson": _POISSON, "depths_m": _DEPTHS}
    return Environment(**(given | kwargs))  # type: ignore[arg-type]


def _single(model: Model, indenter: Indenter, depths_m: FloatArray) -> FloatArray:
    path = LoadingPath(model, indenter)
    return np.array([path.advance(float(depth)).force_n[2] for depth in depths_m])


def test_one_environment_is_a_press(pilot: Pilot) -> None:
    """Every frame's force is that of a press on the same mesh, and is balanced by the base."""
    found = Batch(pilot, [_environment()], options=_EXACT).press()
    assert found.force_n[:, 0, 2] == pytest.approx(
        _single(pilot.model, _SCENE.indenter, _DEPTHS), rel=1e-6
    )
    assert np.abs(found.imbalance).max() <= 1e-7
    assert found.gap_m.min() > 0.0
    assert not found.failed.any()


def test_neighbours_do_not_matter(pilot: Pilot) -> None:
    """Unlike gels and depths side by side give what each gives alone."""
    environments = [
        _environment(),
        _environment(young_pa=0.5e6),
        _environment(poisson=0.42),
        _environment(depths_m=0.8 * _DEPTHS),
    ]
    together = Batch(pilot, environments, options=_EXACT).press()
    for number, environment in enumerate(environments):
        alone = Batch(pilot, [environment], options=_EXACT).press()
        assert together.force_n[:, number] == pytest.approx(alone.force_n[:, 0], rel=1e-6, abs=1e-9)


def test_force_goes_with_the_modulus(pilot: Pilot) -> None:
    """Contact stiffness goes with E too, so that all forces of a stiffer gel are in proportion."""
    found = Batch(
        pilot, [_environment(), _environment(young_pa=3.0 * _YOUNG)], options=_EXACT
    ).press()
    assert found.force_n[:, 1, 2] == pytest.approx(3.0 * found.force_n[:, 0, 2], rel=1e-6)


def test_loads_and_depths_agree(model: Model, pilot: Pilot) -> None:
    """Pushed with the forces of a press to given depths, the indenter goes to those depths."""
    displaced = Batch(pilot, [_environment()], options=_EXACT).press()
    pushed = Batch(
        Pilot(model, _SCENE.indenter, 0.4e-3, count=3, is_pushed=True),
        [_environment(depths_m=None, loads_n=displaced.force_n[:, 0, 2])],
        options=_EXACT,
    ).press()
    assert pushed.depth_m[:, 0] == pytest.approx(_DEPTHS, rel=1e-5)
    assert pushed.force_n[:, 0, 2] == pytest.approx(displaced.force_n[:, 0, 2], rel=1e-6)


def test_an_indenter_beside_the_pilots_place() -> None:
    """A ball 0.5 mm off to either side feels the same, and what a press there feels."""
    ball = replace(_SCENE, indenter=Sphere(diameter_m=6e-3))
    model = batch_model(ball, refinement=0.5, symmetric=False)
    pilot = Pilot(model, ball.indenter, 0.3e-3, count=2)
    depths = np.array([0.1e-3, 0.2e-3, 0.3e-3])
    found = Batch(
        pilot,
        [_environment(depths_m=depths, offset_m=(x, 0.0)) for x in (0.5e-3, -0.5e-3)],
        options=_EXACT,
    ).press()
    path = LoadingPath(model, ball.indenter, centre_m=(0.5e-3, 0.0))
    assert found.force_n[-1, 0] == pytest.approx(path.advance(0.3e-3).force_n, rel=1e-6, abs=1e-8)
    assert found.force_n[-1, 0, 2] == pytest.approx(found.force_n[-1, 1, 2], rel=1e-3)
    assert found.force_n[-1, 0, 0] == pytest.approx(-found.force_n[-1, 1, 0], rel=5e-2)


@pytest.mark.gpu
@pytest.mark.parametrize("count", [1, 9, 70])
def test_a_gpu_gives_what_the_cpu_gives(pilot: Pilot, count: int) -> None:
    """In one block, in a half full one and in two."""
    environments = [_environment(young_pa=(1.0 + 0.01 * k) * _YOUNG) for k in range(count)]
    host = Batch(pilot, environments, options=_EXACT).press()
    found = Batch(pilot, environments, options=_EXACT, device="cuda:0").press()
    assert found.force_n == pytest.approx(host.force_n, rel=1e-6, abs=1e-9)


def test_a_batch_can_be_pressed_again(pilot: Pilot) -> None:
    """Nothing of the first press is left in the second."""
    batch = Batch(pilot, [_environment()], options=_EXACT)
    assert np.array_equal(batch.press().force_n, batch.press().force_n)


def test_the_surface_is_stressed_as_in_a_press(model: Model, pilot: Pilot) -> None:
    """Algorithm 1 in one launch is Algorithm 1 on the same displacements."""
    batch = Batch(pilot, [_environment(), _environment(young_pa=2.0 * _YOUNG)], options=_EXACT)
    batch.press()
    apart = _apart(batch, model)
    assert max(apart.values()) < 1e-9
    assert apart["area"] < 1e-12
    assert np.abs(batch.surface_stresses()[0].traction_pa).max() > 0.1 * _YOUNG


@pytest.mark.gpu
def test_a_gpu_finds_the_same_stress(model: Model, pilot: Pilot) -> None:
    """Algorithm 1 on a GPU is Algorithm 1 on the host."""
    environments = [_environment(), _environment(young_pa=2.0 * _YOUNG)]
    batch = Batch(pilot, environments, options=_EXACT, device="cuda:0")
    batch.press()
    apart = _apart(batch, model)
    assert max(apart.values()) < 1e-9
    assert apart["area"] < 1e-12
    assert np.abs(batch.surface_stresses()[0].traction_pa).max() > 0.1 * _YOUNG


def _apart(batch: Batch, model: Model) -> dict[str, float]:
    """Return how far each quantity is from the host's, relative to its largest value.

    Gels may be stiffer than the model's.
    """
    moved, apart = batch.displacements(), dict[str, float]()
    for number, found in enumerate(batch.surface_stresses()):
        wanted = surface_stress(model, model.nodes + moved[number])
        stiffer = batch.environments[number].young_pa / model.young_pa
        parts = found.normal_pa[:, None] * found.normals + found.tangential_pa
        for name, here, there in (
            ("traction", found.traction_pa / stiffer, wanted.traction_pa),
            ("normal stress", found.normal_pa / stiffer, wanted.normal_pa),
            ("sum of parts", parts / stiffer, wanted.traction_pa),
            ("area", found.areas_m2, wanted.areas_m2),
            ("normal", found.normals, wanted.normals),
        ):
            worst = float(np.abs(here - there).max() / np.abs(there).max())
            apart[name] = max(apart.get(name, 0.0), worst)
    return apart


def test_elements_may_go_through_shared_memory_bit_by_bit(
    pilot: Pilot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Chunk after chunk, the last of them not full, gives what one chunk gives."""
    whole = Batch(pilot, [_environment()], options=_EXACT).press()
    small = Layout(threads=32, chunk=32, resident=1, width=4 * 768)
    assert len(pilot.model.elements) % small.chunk
    monkeypatch.setattr(iteration, "evaluating", lambda *_: small)
    monkeypatch.setattr(iteration, "searching", lambda *_: small)
    found = Batch(pilot, [_environment()], options=_EXACT).press()
    assert found.force_n == pytest.approx(whole.force_n, rel=1e-6, abs=1e-9)
    assert np.abs(found.imbalance).max() <= 1e-7


@pytest.mark.parametrize("lead_max", [0, 4])
def test_none_goes_farther_ahead_than_it_may(
    model: Model, monkeypatch: pytest.MonkeyPatch, lead_max: int
) -> None:
    """A press of a tenth of the depth waits for its neighbour; every frame has a stiffness."""
    pilot = Pilot(model, _SCENE.indenter, 0.4e-3, count=6)
    environments = [_environment(), _environment(depths_m=0.1 * _DEPTHS)]
    batch = Batch(pilot, environments, options=replace(_EXACT, lead_max=lead_max))
    batch.prepare()
    run, apart = batch.iteration.run, []

    def watched() -> None:
        run()
        apart.append(int(np.ptp(batch.iteration.progress.frame.numpy())))

    monkeypatch.setattr(batch.iteration, "run", watched)
    assert not batch.press().failed.any()
    assert (max(apart) > 1) == (lead_max > 0)
    assert max(apart) <= 1 + lead_max


@pytest.mark.parametrize("is_pushed", [False, True])
def test_factors_and_inverses_are_one_preconditioner(model: Model, is_pushed: bool) -> None:
    """What the CPU solves is what the GPU multiplies with."""
    pilot = Pilot(model, _SCENE.indenter, 0.4e-3, count=2, is_pushed=is_pushed)
    factored = FactoredStiffness(pilot)
    device = Device("cpu")
    right = np.random.default_rng(3).standard_normal((3, factored.row_count)).astype(np.float32)
    out = device.zeros(right.shape, wp.float32)
    for which, stiffness in enumerate(pilot.stiffnesses):
        factored.select(which)
        factored.apply(device.array(right, wp.float32), out)
        wanted = right @ stiffness.inverse(model.pattern)
        assert np.abs(out.numpy() - wanted).max() <= 1e-4 * np.abs(wanted).max()


def test_displacements_are_those_of_a_press(pilot: Pilot) -> None:
    """The last frame's nodes lie where a press leaves them."""
    batch = Batch(pilot, [_environment()], options=_EXACT)
    batch.press()
    path = LoadingPath(pilot.model, _SCENE.indenter)
    for depth in _DEPTHS:
        point = path.advance(float(depth))
    moved = point.state.positions - pilot.model.nodes
    assert np.abs(batch.displacements()[0] - moved).max() <= 1e-9


@pytest.mark.parametrize(
    ("environments", "told"),
    [
        ([], "without environments"),
        ([_environment(), _environment(depths_m=_DEPTHS[:3])], "unlike numbers of frames: 3, 6"),
        ([_environment(depths_m=None, loads_n=np.array([1.0]))], "environment 0 has loads"),
        ([_environment(offset_m=(1e-3, 0.0))], "symmetry lets only a quarter"),
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
    ("given", "told"),
    [
        ({"depths_m": None}, "both depths and loads, or neither"),
        ({"depths_m": np.array([2e-4, 1e-4])}, r"0\.2, 0\.1 mm, do not grow"),
        ({"depths_m": None, "loads_n": np.array([0.0, 1.0])}, "0, 1 N, do not grow"),
    ],
)
def test_load_histories_must_be_given_and_grow(given: dict[str, object], told: str) -> None:
    """A load history that falls has no extrapolation, and none at all no frames."""
    with pytest.raises(ConfigError, match=told):
        _environment(**given)


def test_a_frame_is_begun_anew_before_it_is_given_up(pilot: Pilot) -> None:
    """With a Newton step too few, every further start costs evaluations, and counts anew."""
    hasty = replace(_EXACT, newton_max=1)
    spent = []
    for retry_max in (0, 1, 2):
        batch = Batch(pilot, [_environment()], options=replace(hasty, retry_max=retry_max))
        found = batch.press()
        assert found.failed.all()
        assert batch.iteration.progress.retries.numpy()[0] == retry_max
        spent.append(int(found.evaluations[0]))
    assert spent[0] < spent[1] < spent[2]


def test_a_press_that_fails_is_told_from_those_that_do_not(pilot: Pilot) -> None:
    """One Newton step is not enough: the frames that were not reached are not numbers."""
    hasty = replace(_EXACT, newton_max=1)
    found = Batch(pilot, [_environment()], options=hasty).press()
    assert found.failed.all()
    assert np.isnan(found.depth_m[-1, 0])
