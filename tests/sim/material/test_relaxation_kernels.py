"""What a relaxing point remembers, step by step, and that it gives back no more than it got."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from sim.arrays import FloatArray
from sim.material import relaxation_kernels as kernels
from sim.material.laws.tangent import law
from sim.material.relaxation import prony_series
from sim.mesh.elements import ElementOrder
from sim.scene.material import LawName, RelaxationTerm
from sim.solve.model import Model
from sim.studies.hard_cases.pads import brick_mesh

TERM = RelaxationTerm(share=0.4, time_s=0.1)
KEEPS, GAINS = np.array([0.7, 0.2]), np.array([0.85, 0.5])


def on_cpu(values: FloatArray, kind: type) -> wp.array:
    """Return values as an array of a Warp type."""
    return wp.array(np.ascontiguousarray(values), dtype=kind, device="cpu")


def relaxing(name: LawName) -> Model:
    """Return a small block of one term."""
    mesh = brick_mesh((1, 1, 1))
    series = prony_series([(TERM,)], np.zeros(len(mesh.tets), dtype=np.int32))
    return Model(
        mesh, order=ElementOrder.P1, law=law(name), young_pa=4e5, poisson=0.45, prony=series
    )


def test_a_step_begins_with_what_the_branches_keep() -> None:
    """H = sum of r (keep h - gain S), for branches of unlike stiffness in every element."""
    rng = np.random.default_rng(1)
    ratios, stress = rng.uniform(size=(2, 3)), rng.normal(size=(3, 4, 3, 3))
    branches = rng.normal(size=(2, 3, 4, 3, 3))
    out = wp.zeros((3, 4), dtype=wp.mat33d, device="cpu")
    coefficients = [on_cpu(each, wp.float64) for each in (KEEPS, GAINS, ratios)]
    state = [on_cpu(each, wp.mat33d) for each in (stress, branches)]
    wp.launch(
        kernels.recall, dim=(3, 4), inputs=[*coefficients, *state], outputs=[out], device="cpu"
    )
    kept = KEEPS[:, None, None, None, None] * branches
    gained = GAINS[:, None, None, None, None] * stress
    wanted = np.einsum("ke,keqij->eqij", ratios, kept - gained)
    np.testing.assert_allclose(out.numpy(), wanted, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("name", [LawName.STABLE_NEO_HOOKEAN, LawName.LINEAR])
def test_a_branch_gains_by_the_stress_and_forgets_its_share(name: LawName) -> None:
    """Step after step h <- keep h + gain (S_new - S_old), S of the law at the step's end."""
    gel = relaxing(name)
    arrays = gel.gel._arrays
    shape = tuple(arrays.weights.shape)
    stress = wp.zeros(shape, dtype=wp.mat33d, device="cpu")
    branches = wp.zeros((2, *shape), dtype=wp.mat33d, device="cpu")
    before, wanted = np.zeros((3, 3)), np.zeros((2, 3, 3))
    for stretch in (1.1, 1.3, 0.8):
        F = np.diag([stretch, 1.0, 1.0])
        positions = on_cpu(gel.nodes @ F.T, wp.vec3d)
        wp.launch(
            kernels.advance_kernel(gel.law),
            dim=shape,
            inputs=[arrays, on_cpu(KEEPS, wp.float64), on_cpu(GAINS, wp.float64), positions],
            outputs=[stress, branches],
            device="cpu",
        )
        now = _remembered_stress(gel, F)
        wanted = KEEPS[:, None, None] * wanted + GAINS[:, None, None] * (now - before)
        before = now
        size = np.abs(now).max()
        np.testing.assert_allclose(stress.numpy()[0, 0], now, atol=1e-9 * size)
        np.testing.assert_allclose(branches.numpy()[:, 0, 0], wanted, atol=1e-9 * size)


def _remembered_stress(gel: Model, F: FloatArray) -> FloatArray:
    """Return F^-1 P of a law that is objective, P of one that is not [Pa], by the slow gel."""
    P = np.linalg.det(F) * gel.gel.cauchy_stress(gel.nodes @ F.T)[0, 0] @ np.linalg.inv(F).T
    return np.asarray(np.linalg.inv(F) @ P if gel.law.is_objective else P)


@pytest.mark.parametrize(
    ("duration_s", "is_lossy"), [(1e-6, False), (0.1, True), (0.6, True), (1e5, False)]
)
def test_a_cycle_gives_back_no_more_than_it_took(duration_s: float, is_lossy: bool) -> None:
    """Squeezed and let go: work is lost at the pace of the term, none far from it, and none won."""
    gel = relaxing(LawName.STABLE_NEO_HOOKEAN)
    assert gel.relaxation is not None
    here, force, work, most = gel.nodes, np.zeros_like(gel.nodes), 0.0, 0.0
    steps = 80
    for phase in np.arange(1, steps + 1) * np.pi / steps:
        there = gel.nodes * np.array([1.0, 1.0, 1.0 - 0.1 * np.sin(phase) ** 2])
        gel.relaxation.begin_step(duration_s / steps)
        now = gel.gel.gradient(there)
        work += float(np.sum(0.5 * (force + now) * (there - here)))
        most = max(most, work)
        gel.relaxation.commit(there)
        here, force = there, now
    assert most > 0.0
    assert work > 0.02 * most if is_lossy else abs(work) < 1e-3 * most
