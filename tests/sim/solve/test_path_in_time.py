"""Paths in time, and the energies of nodes with weight and mass."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_matrix, diags, triu
from scipy.sparse.linalg import eigsh

from sim.contact.surface_and_grip import ContactOptions
from sim.material.laws.law_and_lame import law
from sim.material.relaxation import prony_series
from sim.mesh.elements import ElementOrder
from sim.mesh.mirror_symmetry import MirrorSymmetry
from sim.mesh.revolved_mesh import Grading, revolved_mesh
from sim.scene.indenter import Cylinder, Indenter, Plane, Sphere
from sim.scene.material import LawName, RelaxationTerm
from sim.scene.pad import DiscPad
from sim.solve.equilibrium import SolverOptions
from sim.solve.loading_path import LoadingPath, unloaded_positions
from sim.solve.model import Model
from sim.solve.weight_and_inertia import (
    INERTIA,
    STANDARD_M_S2,
    WEIGHT,
    Inertia,
    Shares,
    nodal_masses,
    weight,
)
from sim.studies.hard_cases.dynamics import energy_j, time_step
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError
from tests.sim.material.small_disc import PAD as DISC
from tests.sim.material.small_disc import disc_model

PAD = DiscPad(radius_m=8e-3, height_m=4e-3)
DENSITY = 1070.0
YOUNG_PA = 4.3e5
PUNCH = Cylinder(diameter_m=5e-3, fillet_m=0.5e-3)
BALL = Sphere(diameter_m=8e-3)


def coarse(
    *,
    poisson: float = 0.45,
    contact: ContactOptions | None = None,
    terms: tuple[RelaxationTerm, ...] = (),
    symmetric: bool = True,
) -> Model:
    """Return a disc, or a quarter of it, of few elements."""
    mesh = revolved_mesh(
        PAD,
        Grading(start_m=2.0e-3, end_m=2.5e-3, size_m=0.6e-3, growth=2.0),
        centre_m=(0.0, 0.0),
        sector_count=8,
        name="test",
        symmetry=None if symmetric else MirrorSymmetry(),
    )
    return Model(
        mesh,
        order=ElementOrder.P2,
        law=law(LawName.STABLE_NEO_HOOKEAN),
        young_pa=YOUNG_PA,
        poisson=poisson,
        contact_options=contact or ContactOptions(distance_m=5e-6),
        prony=prony_series([terms], np.zeros(len(mesh.tets), dtype=np.int32)),
    )


def in_time(
    model: Model, indenter: Indenter, *, mass: Inertia | None = None, weighs: bool = False
) -> LoadingPath:
    """Return a path of a gel with mass."""
    potential = weight(model, DENSITY) if weighs else None
    mass = mass or Inertia(model, DENSITY)
    return LoadingPath(model, indenter, potential=potential, inertia=mass)


@pytest.mark.parametrize(
    "contact", [pytest.param({}, marks=pytest.mark.slow), {"friction": 0.5}, {"bonded": True}]
)
def test_a_slow_press_is_statics(contact: dict[str, Any]) -> None:
    """0.3 mm in a second, slid while the force is held: free, with friction, bonded."""
    options = ContactOptions(distance_m=5e-6, **contact)
    paths = [
        LoadingPath(coarse(contact=options, symmetric=False), PUNCH),
        in_time(coarse(contact=options, symmetric=False), PUNCH),
    ]
    points = [path.advance(0.3e-3, duration_s=1.0) for path in paths]
    np.testing.assert_allclose(points[1].force_n, points[0].force_n, rtol=1e-3, atol=1e-5)
    if not options.bonded:
        carried = [path.carry(shift_m=(0.05e-3, 0.0), duration_s=1.0) for path in paths]
        size = float(np.linalg.norm(carried[0].force_n))
        np.testing.assert_allclose(carried[1].force_n, carried[0].force_n, atol=2e-3 * size)


def test_a_force_that_grows_is_met_in_time() -> None:
    """Pushed with 0.2 N in a second and in 0.1 ms: both carry it, at other depths."""
    slow, quick = (in_time(coarse(), PUNCH) for _ in range(2))
    there = slow.push(0.2, duration_s=1.0)
    static = LoadingPath(coarse(), PUNCH).push(0.2)
    assert there.depth_m == pytest.approx(static.depth_m, rel=1e-3)
    sudden = quick.push(0.2, duration_s=1e-4)
    assert sudden.force_n[2] == pytest.approx(0.2, rel=1e-6)
    assert sudden.depth_m < 0.97 * static.depth_m


@pytest.mark.slow
def test_points_slide_against_mass_too() -> None:
    """Carried at speed the gel stays behind: friction is what its mass and its shear take."""
    options = ContactOptions(distance_m=5e-6, friction=0.8)
    forces = []
    for speed_m_s in (1e-3, 1.0):
        path = in_time(coarse(contact=options, symmetric=False), PUNCH)
        path.advance(0.2e-3, duration_s=1.0)
        point = path.carry(shift_m=(0.05e-3, 0.0), duration_s=0.05e-3 / speed_m_s)
        forces.append(point.force_n)
        assert abs(point.force_n[0]) <= 0.8 * point.force_n[2]
    assert abs(forces[1][0]) > 1.05 * abs(forces[0][0])


@pytest.mark.parametrize("step_s", [1e-5, 1e-4])
def test_held_press_settles_to_the_static_force(step_s: float) -> None:
    """The depth in one fast step, then held: inertia fades, and statics is left."""
    static = LoadingPath(coarse(), PUNCH).advance(0.3e-3)
    path = in_time(coarse(), PUNCH)
    first = path.advance(0.3e-3, duration_s=step_s)
    assert first.force_n[2] > 1.2 * static.force_n[2]
    last = [path.dwell(1e-3 * 2**k) for k in range(6)][-1]
    assert last.force_n[2] == pytest.approx(static.force_n[2], rel=1e-3)


def test_layer_rings_as_the_scheme_says() -> None:
    """Let go from its lowest tone, the pad follows implicit Euler's own recurrence for it."""
    model = coarse(poisson=0.3, symmetric=False)
    frequency, shape = lowest_tone(model)
    quarter_wave = math.sqrt(YOUNG_PA / 2.6 / DENSITY) / (4.0 * PAD.height_m)
    assert frequency == pytest.approx(quarter_wave, rel=0.2)
    mass = Inertia(model, DENSITY)
    path = in_time(model, Plane(), mass=mass)
    start = path.advance(-2e-3)
    start.state.positions = model.nodes + 1e-8 * shape / np.abs(shape).max()
    mass.forget(start.state.positions)
    step_s = 0.02 / frequency
    largest = int(np.argmax(np.abs(shape)))
    away, rate = 1e-8 * float(np.sign(shape.flat[largest])), 0.0
    for _ in range(30):
        now = path.dwell(step_s)
        reached = (away + step_s * rate) / (1.0 + (2.0 * np.pi * frequency * step_s) ** 2)
        away, rate = reached, (reached - away) / step_s
        moved = (now.state.positions - model.nodes).flat[largest]
        assert moved == pytest.approx(away, abs=2e-4 * 1e-8)


@pytest.mark.parametrize(("indenter", "speed_m_s"), [(PUNCH, 5.0), (BALL, 1.0)])
def test_impact_makes_no_energy_and_no_overlap(indenter: Indenter, speed_m_s: float) -> None:
    """Hit at speed, stopped at 0.4 mm, held: gaps stay open, energy within the work done."""
    model = coarse()
    mass = Inertia(model, DENSITY)
    path = in_time(model, indenter, mass=mass)
    before = path.advance(-0.05e-3)
    energies, forces, works, held = [energy_j(path, mass)], [], [0.0], []
    for k in range(30):
        point = time_step(path, min(-0.05e-3 + 0.02e-3 * (k + 1), 0.4e-3), 0.02e-3 / speed_m_s)
        assert model.surface.gaps(point.state.positions, indenter, point.state).min() > 0.0
        energies.append(energy_j(path, mass))
        forces.append(float(point.force_n[2]))
        works.append(forces[-1] * (point.depth_m - before.depth_m))
        held += [energies[-1]] if point.depth_m == before.depth_m else []
        before = point
    assert max(forces) > 0.5
    assert np.all(np.diff(energies) <= np.array(works[1:]) + 1e-6 * sum(works))
    assert len(held) > 3
    assert np.all(np.diff(held) <= 1e-9 * held[0])


def test_weight_at_rest_moves_nothing() -> None:
    """Started at its own sag the pad stays, and depth counts from there."""
    model = coarse()
    mass = Inertia(model, DENSITY)
    path = in_time(model, BALL, mass=mass, weighs=True)
    path.advance(-0.1e-3)
    for _ in range(5):
        point = path.dwell(1e-4)
    assert np.abs(mass.velocities_m_s).max() < 1e-7
    assert not point.force_n.any()


def test_relaxing_gel_pushes_back_less_with_time() -> None:
    """Pressed fast and held far beyond the time constant: first the fast force, then the slow."""
    slow = LoadingPath(coarse(), PUNCH).advance(0.2e-3).force_n[2]
    path = in_time(coarse(terms=(RelaxationTerm(share=0.4, time_s=10.0),)), PUNCH)
    fast = path.advance(0.2e-3, duration_s=0.05).force_n[2]
    assert fast == pytest.approx(slow / 0.6, rel=0.02)
    assert path.dwell(1e4).force_n[2] == pytest.approx(slow, rel=1e-3)


def test_motion_goes_on_from_a_press_that_lasts_for_ever() -> None:
    """An equilibrium is at rest in time too, and nothing goes back."""
    model = coarse()
    mass = Inertia(model, DENSITY)
    path = in_time(model, PUNCH, mass=mass)
    first = path.advance(0.1e-3)
    point = path.advance(0.2e-3)
    stored = energy_j(path, mass)
    step = path.dwell(1e-3)
    assert step.force_n[2] == pytest.approx(point.force_n[2], rel=1e-6)
    assert energy_j(path, mass) == pytest.approx(stored, rel=1e-9)
    with pytest.raises(ConfigError, match="relaxes or has mass cannot go back"):
        path.advance(0.15e-3, start=first)


def lowest_tone(model: Model) -> tuple[float, FloatArray]:
    """Return the clamped pad's lowest frequency [Hz] and its shape, [node_count, 3]."""
    pattern = model.pattern
    free = np.zeros((*model.surface.areas.shape, 3, 3))
    data = model.hessian_data(model.nodes, free, projected=False)
    upper = csr_matrix((data, pattern.indices, pattern.indptr))
    stiffness = upper + triu(upper, 1).T
    masses = diags(
        pattern.unknowns(np.tile(nodal_masses(model, DENSITY, INERTIA)[:, None], (1, 3)))
    ).tocsc()
    start = np.ones(pattern.dof_count)
    squared, shapes = eigsh(stiffness.tocsc(), k=1, M=masses, sigma=0.0, v0=start)
    return float(np.sqrt(squared[0]) / (2.0 * np.pi)), pattern.nodal(shapes[:, 0])


def test_steps_that_grow_leave_the_base_where_it_is() -> None:
    """A prediction is a sum of states with shares above one: what it rounds must not add up."""
    path = in_time(coarse(), PUNCH)
    for depth_m in 0.2e-3 * np.linspace(0.1, 1.0, 40) ** 3:
        path.advance(float(depth_m), duration_s=1e-5)
    assert path.last is not None
    clamped = path.model.clamped
    assert np.array_equal(path.last.state.positions[clamped], path.model.nodes[clamped])


DISC_PA, WHOLE = 4e5, MirrorSymmetry()


def disc(order: ElementOrder, *, symmetry: MirrorSymmetry | None = WHOLE) -> Model:
    """Return a clamped disc of some hundred elements."""
    return disc_model(
        LawName.LINEAR, order=order, young_pa=DISC_PA, poisson=0.3, size_m=0.4e-3, symmetry=symmetry
    )


@pytest.mark.parametrize("shares", [WEIGHT, INERTIA])
@pytest.mark.parametrize("order", list(ElementOrder))
def test_masses_sum_to_the_pad(shares: Shares, order: ElementOrder) -> None:
    """Nothing is lost, and one density an element gives what one density for all gives."""
    model = disc(order)
    found = nodal_masses(model, DENSITY, shares)
    assert found.sum() == pytest.approx(DENSITY * model.volume_m3, rel=1e-12)
    each = nodal_masses(model, np.full(len(model.elements), DENSITY), shares)
    assert np.allclose(found, each, rtol=1e-14)


def test_inertial_masses_are_positive() -> None:
    """Quadratic corners weigh less than nothing, but every node resists acceleration."""
    model = disc(ElementOrder.P2)
    assert nodal_masses(model, DENSITY, WEIGHT).min() < 0.0
    assert nodal_masses(model, DENSITY, INERTIA).min() > 0.0


@pytest.mark.parametrize("order", list(ElementOrder))
def test_weight_does_the_work_of_a_linear_motion(order: ElementOrder) -> None:
    """Energy of a stretch equals minus m g times the centre's motion: the sharing is consistent."""
    model = disc(order)
    found = weight(model, DENSITY)
    F = np.array([[1.1, 0.05, 0.0], [0.0, 0.9, 0.1], [0.02, 0.0, 1.05]])
    moved = model.nodes @ F.T + np.array([1e-4, 2e-4, -3e-4])
    shares = nodal_masses(model, 1.0, WEIGHT) / model.volume_m3
    centre = shares @ (moved - model.nodes)
    work = -DENSITY * model.volume_m3 * STANDARD_M_S2 * float(centre[2])
    assert found.energy(moved) == pytest.approx(-work, rel=1e-12)
    assert centre[2] == pytest.approx(0.05 * DISC.height_m / 2.0 - 3e-4, rel=1e-9)


def test_weight_sags_the_pad_as_a_column_does() -> None:
    """A wide clamped layer sinks by rho g H^2 / (2 M), M the modulus without sideways strain."""
    model = disc(ElementOrder.P2, symmetry=None)
    positions = unloaded_positions(model, options=SolverOptions(), potential=weight(model, DENSITY))
    middle = int(np.argmin(np.linalg.norm(model.nodes - [0.0, 0.0, DISC.height_m], axis=1)))
    modulus = DISC_PA * (1 - 0.3) / ((1 + 0.3) * (1 - 2 * 0.3))
    expected = DENSITY * STANDARD_M_S2 * DISC.height_m**2 / (2.0 * modulus)
    assert DISC.height_m - positions[middle, 2] == pytest.approx(expected, rel=0.15)
    assert expected / DISC.height_m == pytest.approx(2e-5, rel=0.1)


def test_a_soft_skin_on_a_stiff_base_settles_under_its_weight() -> None:
    """What rounding leaves is the stiff base's; beside the skin's modulus it never settled."""
    plain = disc(ElementOrder.P2)
    in_skin = plain.nodes[plain.elements[:, :4], 2].mean(axis=1) > 0.8 * DISC.height_m
    model = Model(
        plain.mesh,
        order=ElementOrder.P2,
        law=law(LawName.STABLE_NEO_HOOKEAN),
        young_pa=np.where(in_skin, 1e-3, 1.0) * DISC_PA,
        poisson=0.49,
        contact_options=ContactOptions(distance_m=40e-6, friction=0.8),
    )
    positions = unloaded_positions(model, options=SolverOptions(), potential=weight(model, DENSITY))
    assert 0.0 < DISC.height_m - positions[:, 2].max() < 0.01 * DISC.height_m


@pytest.mark.parametrize("kind", ["weight", "inertia"])
def test_gradient_and_diagonal_are_derivatives(kind: str) -> None:
    """Central differences of the energy and of the gradient agree."""
    model = disc(ElementOrder.P2)
    rng = np.random.default_rng(2)
    moved = model.nodes + rng.normal(scale=1e-4, size=model.nodes.shape)
    motion = rng.normal(scale=1e-5, size=model.nodes.shape)
    memory = Inertia(model, DENSITY)
    memory.forget(model.nodes + 1e-5)
    memory.begin_step(1e-4)
    potential = memory.flight(None) if kind == "inertia" else weight(model, DENSITY)
    rise = (potential.energy(moved + motion) - potential.energy(moved - motion)) / 2.0
    assert rise == pytest.approx(float(np.sum(potential.gradient(moved) * motion)), rel=1e-9)
    change = (potential.gradient(moved + motion) - potential.gradient(moved - motion)) / 2.0
    assert np.allclose(change, potential.diagonal() * motion, rtol=1e-9, atol=1e-18)
