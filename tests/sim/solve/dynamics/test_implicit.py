"""A press in time: statics in the limit, the pad's own tone, and an impact that makes no energy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.sparse import csr_matrix, diags, triu
from scipy.sparse.linalg import eigsh

from sim.arrays import FloatArray
from sim.contact.state import ContactOptions
from sim.material.laws.tangent import law
from sim.material.relaxation import prony_series
from sim.mesh.elements import ElementOrder
from sim.mesh.graded_plane import Grading
from sim.mesh.revolved import revolved_mesh
from sim.mesh.symmetry import MirrorSymmetry
from sim.scene.indenter import Cylinder, Indenter, Plane, Sphere
from sim.scene.material import LawName, RelaxationTerm
from sim.scene.pad import DiscPad
from sim.solve.dynamics.implicit import DynamicPress, DynamicStep
from sim.solve.dynamics.weight_and_inertia import INERTIA, nodal_masses, weight
from sim.solve.load_steps.path import LoadingPath
from sim.solve.model import Model
from tacauchy_rig.errors import ConfigError

PAD = DiscPad(radius_m=8e-3, height_m=4e-3)
DENSITY = 1070.0
YOUNG_PA = 4.3e5
PUNCH = Cylinder(diameter_m=5e-3, fillet_m=0.5e-3)
BALL = Sphere(diameter_m=8e-3)


def coarse(
    *,
    poisson: float = 0.45,
    bonded: bool = False,
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
        contact_options=ContactOptions(distance_m=5e-6, bonded=bonded),
        prony=prony_series([terms], np.zeros(len(mesh.tets), dtype=np.int32)),
    )


def total(step: DynamicStep) -> float:
    """Return kinetic plus stored energy [J]."""
    return step.elastic_j + step.kinetic_j + step.contact_j + step.potential_j


@pytest.mark.parametrize("step_s", [1.0, 0.1])
def test_whole_depth_in_one_slow_step_is_statics(step_s: float) -> None:
    """0.5 mm in one step: the force is the static one."""
    static = LoadingPath(coarse(), PUNCH).advance(0.5e-3)
    press = DynamicPress(LoadingPath(coarse(), PUNCH), density_kg_m3=DENSITY)
    step = press.step(0.5e-3, step_s)
    assert step.force_n[2] == pytest.approx(static.force_n[2], rel=1e-3)
    assert step.gap_min_m > 0.0
    assert step.depth_m == pytest.approx(0.5e-3, abs=1e-12)


@pytest.mark.parametrize("step_s", [1e-5, 1e-4])
def test_held_press_settles_to_the_static_force(step_s: float) -> None:
    """The depth in one fast step, then held: inertia fades, and statics is left."""
    static = LoadingPath(coarse(), PUNCH).advance(0.3e-3)
    press = DynamicPress(LoadingPath(coarse(), PUNCH), density_kg_m3=DENSITY)
    first = press.step(0.3e-3, step_s)
    assert first.force_n[2] > 1.5 * static.force_n[2]
    assert first.gap_min_m > 0.0
    last = [press.step(0.3e-3, 1e-3 * 2**k) for k in range(6)][-1]
    assert last.force_n[2] == pytest.approx(static.force_n[2], rel=1e-3)


def test_layer_rings_as_the_scheme_says() -> None:
    """Let go from its lowest tone, the pad follows implicit Euler's own recurrence for it."""
    model = coarse(poisson=0.3, symmetric=False)
    frequency, shape = lowest_tone(model)
    quarter_wave = math.sqrt(YOUNG_PA / 2.6 / DENSITY) / (4.0 * PAD.height_m)
    assert frequency == pytest.approx(quarter_wave, rel=0.2)
    press = DynamicPress(LoadingPath(model, Plane()), density_kg_m3=DENSITY, depth_m=-2e-3)
    press.state.positions = model.nodes + 1e-8 * shape / np.abs(shape).max()
    step_s = 0.02 / frequency
    largest = int(np.argmax(np.abs(shape)))
    away, rate = 1e-8 * float(np.sign(shape.flat[largest])), 0.0
    for _ in range(30):
        press.step(-2e-3, step_s)
        reached = (away + step_s * rate) / (1.0 + (2.0 * np.pi * frequency * step_s) ** 2)
        away, rate = reached, (reached - away) / step_s
        moved = (press.state.positions - model.nodes).flat[largest]
        assert moved == pytest.approx(away, abs=2e-4 * 1e-8)


@pytest.mark.parametrize("speed_m_s", [1.0, 5.0])
@pytest.mark.parametrize("indenter", [PUNCH, BALL])
def test_impact_makes_no_energy_and_no_overlap(indenter: Indenter, speed_m_s: float) -> None:
    """Hit at speed, stopped at 0.4 mm, held: gaps stay open, energy within the work done."""
    press = DynamicPress(LoadingPath(coarse(), indenter), density_kg_m3=DENSITY, depth_m=-0.05e-3)
    stop, step_s = 0.4e-3, 0.02e-3 / speed_m_s

    def depth_at(time_s: float) -> float:
        return min(-0.05e-3 + speed_m_s * time_s, stop)

    steps = press.run(depth_at, step_s=step_s, duration_s=30 * step_s)
    assert min(step.gap_min_m for step in steps) > 0.0
    assert max(step.force_n[2] for step in steps) > 0.5
    damped = [step.damped_j for step in steps]
    assert min(np.diff([0.0, *damped])) >= -1e-6 * steps[-1].work_j
    held = [step for step in steps if step.depth_m == pytest.approx(stop, abs=1e-12)]
    assert len(held) > 3
    assert np.all(np.diff([total(step) for step in held]) <= 1e-9 * total(held[0]))


def test_weight_at_rest_moves_nothing() -> None:
    """Started at its own sag the pad stays, and depth counts from there."""
    model = coarse()
    path = LoadingPath(model, BALL, potentials=[weight(model, DENSITY)])
    press = DynamicPress(path, density_kg_m3=DENSITY, depth_m=-0.1e-3)
    steps = press.run(lambda _: -0.1e-3, step_s=1e-4, duration_s=5e-4)
    assert max(step.kinetic_j for step in steps) < 1e-20
    assert not steps[-1].force_n.any()


def test_relaxing_gel_pushes_back_less_with_time() -> None:
    """Pressed fast and held far beyond the time constant: first the fast force, then the slow."""
    slow = LoadingPath(coarse(), PUNCH).advance(0.2e-3).force_n[2]
    model = coarse(terms=(RelaxationTerm(share=0.4, time_s=10.0),))
    press = DynamicPress(LoadingPath(model, PUNCH), density_kg_m3=DENSITY)
    fast = press.step(0.2e-3, 0.05).force_n[2]
    assert fast == pytest.approx(slow / 0.6, rel=0.02)
    assert press.step(0.2e-3, 1e4).force_n[2] == pytest.approx(slow, rel=1e-3)


def test_motion_goes_on_from_a_static_press() -> None:
    """A path's equilibrium is at rest in time too."""
    path = LoadingPath(coarse(), PUNCH)
    point = path.advance(0.2e-3)
    press = DynamicPress(path, density_kg_m3=DENSITY)
    step = press.step(press.depth_m, 1e-3)
    assert step.force_n[2] == pytest.approx(point.force_n[2], rel=1e-6)
    assert step.kinetic_j < 1e-12 * step.elastic_j


def test_what_cannot_be_stepped_is_refused() -> None:
    """Bonded contact, and a start inside the pad."""
    with pytest.raises(ConfigError, match="frictionless contact only"):
        DynamicPress(LoadingPath(coarse(bonded=True), PUNCH), density_kg_m3=DENSITY)
    with pytest.raises(ConfigError, match="starts 1 mm inside the pad"):
        DynamicPress(LoadingPath(coarse(), PUNCH), density_kg_m3=DENSITY, depth_m=1e-3)


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
