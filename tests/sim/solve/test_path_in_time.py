"""A path in time: statics in the limit, the pad's own tone, and an impact that makes no energy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_matrix, diags, triu
from scipy.sparse.linalg import eigsh

from sim.contact.state import ContactOptions
from sim.material.laws.tangent import law
from sim.material.relaxation import prony_series
from sim.mesh.elements import ElementOrder
from sim.mesh.revolved import Grading, revolved_mesh
from sim.mesh.symmetry import MirrorSymmetry
from sim.scene.indenter import Cylinder, Indenter, Plane, Sphere
from sim.scene.material import LawName, RelaxationTerm
from sim.scene.pad import DiscPad
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.solve.nodal_energies import INERTIA, Inertia, nodal_masses, weight
from sim.studies.hard_cases.dynamics import energy_j, time_step
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

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
    potentials = [weight(model, DENSITY)] if weighs else []
    mass = mass or Inertia(model, DENSITY)
    return LoadingPath(model, indenter, potentials=potentials, inertia=mass)


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
