"""Prony relaxation: the discrete step is consistent, and follows closed forms."""

import math

import numpy as np
import pytest

from sim.material.relaxation import prony_series
from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Sphere
from sim.scene.material import LawName, RelaxationTerm
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError
from tests.sim.material.small_disc import disc_model, matrix

TERMS = (RelaxationTerm(share=0.3, time_s=0.1), RelaxationTerm(share=0.2, time_s=2.0))
LEFT = 0.5
STRETCH = np.array([[1.1, 0.05, 0.0], [0.0, 0.9, 0.1], [0.02, 0.0, 1.05]])


def model(name: LawName, *, terms: tuple[RelaxationTerm, ...] = TERMS, order: str = "P1") -> Model:
    """Return a small relaxing disc."""
    return disc_model(name, terms=terms, order=ElementOrder(order), size_m=0.8e-3)


def second_stress(model: Model, F: FloatArray) -> FloatArray:
    """Return the second Piola-Kirchhoff stress at a uniform deformation [Pa], shape [3, 3]."""
    sigma = model.gel.cauchy_stress(model.nodes @ F.T)
    assert np.allclose(sigma, sigma[0, 0], rtol=1e-9, atol=1e-6)
    inverse = np.linalg.inv(F)
    return np.asarray(np.linalg.det(F) * inverse @ sigma[0, 0] @ inverse.T)


def remaining(time_s: float) -> float:
    """Return the relaxation function over the slow modulus."""
    return 1.0 + sum(t.share / LEFT * math.exp(-time_s / t.time_s) for t in TERMS)


def history(model: Model, *, step_s: float = 0.05) -> FloatArray:
    """Deform a model unevenly over two steps and begin a third; return where it is going."""
    assert model.relaxation is not None
    rng = np.random.default_rng(7)
    positions = model.nodes
    for _ in range(2):
        positions = positions + rng.normal(scale=3e-5, size=positions.shape)
        model.relaxation.begin_step(step_s)
        model.relaxation.commit(positions)
    model.relaxation.begin_step(step_s)
    return np.asarray(positions + rng.normal(scale=2e-5, size=positions.shape))


@pytest.mark.parametrize(
    ("name", "order"), [(law, ("P1", "P2")[k % 2]) for k, law in enumerate(LawName)]
)
def test_step_has_an_energy(name: LawName, order: str) -> None:
    """Forces and stiffness of a step with a past are derivatives of its energy."""
    gel = model(name, order=order)
    positions = history(gel)
    rng = np.random.default_rng(8)
    motion = gel.pattern.nodal(rng.normal(scale=1e-8, size=gel.pattern.dof_count))
    ahead, behind = positions + motion, positions - motion
    rise = (gel.gel.energy(ahead)[0] - gel.gel.energy(behind)[0]) / 2.0
    assert rise == pytest.approx(np.sum(gel.gel.gradient(positions) * motion), rel=1e-6)
    change = (gel.gel.gradient(ahead) - gel.gel.gradient(behind)) / 2.0
    product = matrix(gel, positions, projected=False) @ gel.pattern.unknowns(motion)
    expected = gel.pattern.unknowns(change)
    assert np.abs(product - expected).max() < 1e-5 * np.abs(expected).max()


def test_projected_stiffness_is_positive_definite() -> None:
    """Held at a stretch for long, then let go at once: the history pushes."""
    gel = model(LawName.STABLE_NEO_HOOKEAN)
    assert gel.relaxation is not None
    gel.relaxation.forget(gel.nodes * np.array([1.0, 1.0, 2.0]))
    gel.relaxation.begin_step(1e-6)
    upright = matrix(gel, gel.nodes, projected=False)
    assert np.linalg.eigvalsh(upright).min() < 0.0
    assert np.linalg.eigvalsh(matrix(gel, gel.nodes, projected=True)).min() > 0.0


@pytest.mark.parametrize("name", [LawName.STABLE_NEO_HOOKEAN, LawName.NEO_HOOKEAN])
def test_held_stretch_relaxes_as_the_series_says(name: LawName) -> None:
    """A stretch made at once and held: S decays by the Prony series, whatever the steps."""
    gel, slow = model(name), model(name, terms=())
    assert gel.relaxation is not None
    still = second_stress(slow, STRETCH)
    positions = gel.nodes @ STRETCH.T
    gel.relaxation.begin_step(1e-9)
    assert np.allclose(second_stress(gel, STRETCH), still / LEFT, rtol=1e-6)
    gel.relaxation.commit(positions)
    time_s = 0.0
    for step_s in (1e-3, 0.05, 0.5, 0.01, 3.0, 40.0):
        gel.relaxation.begin_step(step_s)
        time_s += step_s
        expected = remaining(time_s) * still
        assert np.allclose(second_stress(gel, STRETCH), expected, rtol=1e-6)
        gel.relaxation.commit(positions)
    assert remaining(time_s) == pytest.approx(1.0, abs=1e-8)


def test_even_strain_rate_follows_the_closed_form() -> None:
    """Small strain that grows evenly: exact at every step, since the step takes S to do so."""
    gel, slow = model(LawName.LINEAR), model(LawName.LINEAR, terms=())
    assert gel.relaxation is not None
    direction = STRETCH - np.eye(3)
    time_s = 0.0
    for step_s in (0.01, 0.2, 0.05, 1.0, 5.0):
        gel.relaxation.begin_step(step_s)
        time_s += step_s
        F = np.eye(3) + 1e-4 * time_s * direction
        gain = sum(
            t.share / LEFT * t.time_s / time_s * (1.0 - np.exp(-time_s / t.time_s)) for t in TERMS
        )
        still = slow.gel.cauchy_stress(slow.nodes @ F.T)
        assert np.allclose(gel.gel.cauchy_stress(gel.nodes @ F.T), (1.0 + gain) * still, rtol=1e-9)
        gel.relaxation.commit(gel.nodes @ F.T)


@pytest.mark.parametrize(
    ("step_s", "factor"), [(0.0, 1.0 / LEFT), (1e-9, 1.0 / LEFT), (1e9, 1.0), (math.inf, 1.0)]
)
def test_fast_and_slow_steps_have_the_two_moduli(step_s: float, factor: float) -> None:
    """Energy and forces of one step from rest: instantaneous and slow stiffness."""
    gel, slow = (model(LawName.STABLE_NEO_HOOKEAN, terms=terms) for terms in (TERMS, ()))
    assert gel.relaxation is not None
    gel.relaxation.begin_step(step_s)
    moved = gel.nodes @ STRETCH.T
    assert gel.gel.energy(moved)[0] == pytest.approx(factor * slow.gel.energy(moved)[0], rel=1e-7)
    assert np.allclose(
        gel.gel.gradient(moved), factor * slow.gel.gradient(moved), rtol=1e-6, atol=1e-12
    )


@pytest.mark.parametrize("left", [1e-7, 0.0, -1e-2])
def test_what_is_crushed_remembers_something_finite(left: float) -> None:
    """Without volume the law's stress is finite, and so is what the next step takes over of it."""
    gel, slow = (model(LawName.STABLE_NEO_HOOKEAN, terms=terms) for terms in (TERMS, ()))
    assert gel.relaxation is not None
    crushed, next_to_it = (gel.nodes * [1.0, 1.0, share] for share in (left, left + 0.02))
    gel.relaxation.begin_step(0.1)
    gel.relaxation.commit(crushed)
    gel.relaxation.begin_step(0.1)
    forces, at_rest = gel.gel.gradient(next_to_it), slow.gel.gradient(next_to_it)
    assert np.abs(forces).max() < 3.0 * np.abs(at_rest).max()


def test_step_may_be_begun_again() -> None:
    """A refused step leaves no trace."""
    gel = model(LawName.STABLE_NEO_HOOKEAN)
    assert gel.relaxation is not None
    positions = history(gel, step_s=0.1)
    first = gel.gel.gradient(positions)
    gel.relaxation.begin_step(7.0)
    assert not np.allclose(gel.gel.gradient(positions), first)
    gel.relaxation.begin_step(0.1)
    assert np.array_equal(gel.gel.gradient(positions), first)


def test_forgetting_leaves_the_slow_law() -> None:
    """Held for ever, the gel is as if it had no series, at any deformation."""
    gel, slow = (model(LawName.PAPER_EQ4, terms=terms) for terms in (TERMS, ()))
    assert gel.relaxation is not None
    positions = history(gel)
    gel.relaxation.forget(positions)
    assert np.allclose(
        gel.gel.gradient(positions), slow.gel.gradient(positions), rtol=1e-12, atol=1e-15
    )
    gel.relaxation.begin_step(0.1)
    assert np.allclose(
        gel.gel.gradient(positions), slow.gel.gradient(positions), rtol=1e-9, atol=1e-12
    )


def test_layers_relax_by_their_own_series() -> None:
    """Terms of several materials share their time constants, not their shares."""
    skin = (RelaxationTerm(share=0.5, time_s=0.1),)
    series = prony_series([TERMS, skin, ()], np.array([0, 0, 1, 2], dtype=np.int32))
    assert series is not None
    assert series.times_s.tolist() == [0.1, 2.0]
    assert series.ratios[0] == pytest.approx([0.6, 0.6, 1.0, 0.0])
    assert series.ratios[1] == pytest.approx([0.4, 0.4, 0.0, 0.0])


def test_elastic_gel_has_no_series() -> None:
    """Nothing is allocated for it."""
    assert prony_series([()], np.zeros(3, dtype=np.int32)) is None
    assert model(LawName.LINEAR, terms=()).relaxation is None


def test_gel_that_relaxes_to_nothing_is_refused() -> None:
    """A liquid has no slow modulus."""
    liquid = [RelaxationTerm(share=share, time_s=10 * share) for share in (0.6, 0.5)]
    with pytest.raises(ConfigError, match=r"takes 1\.1 of the instantaneous stiffness"):
        prony_series([liquid], np.zeros(1, dtype=np.int32))


def test_path_that_takes_its_time_forgets_its_haste() -> None:
    """Fast, then on for ever: the slow force. Fast from above the pad: the instantaneous one."""
    ball = Sphere(diameter_m=4e-3)
    slow = LoadingPath(model(LawName.STABLE_NEO_HOOKEAN, terms=()), ball).advance(1e-4).force_n[2]
    path = LoadingPath(model(LawName.STABLE_NEO_HOOKEAN), ball)
    path.advance(5e-5, duration_s=1e-3)
    assert path.advance(1e-4).force_n[2] == pytest.approx(slow, rel=1e-6)
    path = LoadingPath(model(LawName.STABLE_NEO_HOOKEAN), ball)
    path.advance(-2e-5, duration_s=1e-6)
    fast = path.advance(1e-4, duration_s=1e-6).force_n[2]
    # The barrier is as stiff as for the slow gel, and yields 1 % more to the fast one.
    assert fast == pytest.approx(slow / LEFT, rel=0.02)
    assert path.dwell(math.inf).force_n[2] == pytest.approx(slow, rel=1e-6)


def test_press_takes_the_time_that_it_is_given() -> None:
    """Touching counts as a part of it: a press in one go gives what forty short ones give."""
    ball, whole_s, depth_m, load_n = Sphere(diameter_m=4e-3), 0.5, 1e-4, 0.1
    by_depth, by_load = (LoadingPath(model(LawName.STABLE_NEO_HOOKEAN), ball) for _ in range(2))
    for k in range(40):
        pressed = by_depth.advance(depth_m * (k + 1) / 40, duration_s=whole_s / 40)
        pushed = by_load.push(load_n * (k + 1) / 40, duration_s=whole_s / 40)
    at_once = LoadingPath(model(LawName.STABLE_NEO_HOOKEAN), ball)
    force_n = at_once.advance(depth_m, duration_s=whole_s).force_n[2]
    assert force_n == pytest.approx(pressed.force_n[2], rel=1e-3)
    at_once = LoadingPath(model(LawName.STABLE_NEO_HOOKEAN), ball)
    assert at_once.push(load_n, duration_s=whole_s).depth_m == pytest.approx(
        pushed.depth_m, rel=1e-3
    )
