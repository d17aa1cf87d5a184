"""The paper's printed law: what its stress at rest does to a pad that nothing touches."""

from __future__ import annotations

import numpy as np
import pytest

from sim.material.laws.paper_eq4 import free_stretch
from sim.scene.indenter import Sphere
from sim.scene.material import LawName
from sim.solve.equilibrium import SolverOptions
from sim.solve.loading_path import LoadingPath, unloaded_positions
from sim.solve.model import Model
from tests.sim.material.small_disc import PAD, disc_model

YOUNG_PA = 0.43e6


def paper_model(name: LawName, poisson: float) -> Model:
    """Return a disc of the paper's modulus."""
    return disc_model(name, young_pa=YOUNG_PA, poisson=poisson, size_m=0.4e-3)


def test_undeformed_gel_is_under_the_shear_modulus() -> None:
    """Cauchy stress at rest is mu in every direction: 145 kPa for the gel of E 0.43 MPa."""
    model = paper_model(LawName.PAPER_EQ4, 0.48)
    stress = model.gel.cauchy_stress(model.nodes)
    expected = model.law.rest_stress(YOUNG_PA, 0.48)
    assert expected == pytest.approx(145.3e3, rel=1e-3)
    assert np.allclose(stress, expected * np.eye(3), rtol=1e-9, atol=1e-3)


def test_stress_is_the_printed_formula() -> None:
    """Sigma = mu/J b + lambda (J - 1) 1 (paper, Eq. 4)."""
    model = paper_model(LawName.PAPER_EQ4, 0.45)
    F = np.array([[1.1, 0.05, 0.0], [0.0, 0.9, 0.1], [0.02, 0.0, 1.05]])
    mu = YOUNG_PA / 2.0 / 1.45
    lam = YOUNG_PA * 0.45 / 1.45 / 0.1
    J = np.linalg.det(F)
    expected = mu / J * F @ F.T + lam * (J - 1.0) * np.eye(3)
    assert np.allclose(model.gel.cauchy_stress(model.nodes @ F.T), expected, rtol=1e-9)


@pytest.mark.parametrize(("poisson", "shrink"), [(0.45, 0.0402), (0.48, 0.0143)])
def test_free_gel_has_no_stress_only_when_it_has_shrunk(poisson: float, shrink: float) -> None:
    """A gel that nothing holds is smaller by some per cent along every axis."""
    model = paper_model(LawName.PAPER_EQ4, poisson)
    stretch = free_stretch(poisson)
    assert 1.0 - stretch == pytest.approx(shrink, abs=1e-4)
    stress = model.gel.cauchy_stress(stretch * model.nodes)
    assert np.abs(stress).max() < 1e-7 * YOUNG_PA


def test_free_gel_of_low_poisson_ratio_collapses() -> None:
    """Below nu = 0.339 no stretch is free of stress."""
    assert free_stretch(0.338) == 0.0
    assert free_stretch(0.0) == 0.0
    assert 0.6 < free_stretch(0.34) < 0.7


def test_clamped_pad_does_not_rest_in_its_own_shape() -> None:
    """Solved without an indenter, its top sinks by 7 % of the height; a usable law's stays."""
    top = np.array([0.0, 0.0, PAD.height_m])
    sink = {}
    for name in (LawName.PAPER_EQ4, LawName.STABLE_NEO_HOOKEAN):
        model = paper_model(name, 0.45)
        positions = unloaded_positions(model, options=SolverOptions())
        middle = int(np.argmin(np.linalg.norm(model.nodes - top, axis=1)))
        sink[name] = PAD.height_m - positions[middle, 2]
        if name is LawName.PAPER_EQ4:
            assert np.abs(model.pattern.unknowns(model.gel.gradient(positions))).max() < 1e-9
    assert sink[LawName.STABLE_NEO_HOOKEAN] == pytest.approx(0.0, abs=1e-15 * PAD.height_m)
    assert sink[LawName.PAPER_EQ4] == pytest.approx(0.07 * PAD.height_m, rel=0.1)


def test_depth_counts_from_the_shrunk_pad() -> None:
    """The path touches the pad where it stands, and its force begins there."""
    path = LoadingPath(paper_model(LawName.PAPER_EQ4, 0.45), Sphere(diameter_m=4e-3))
    assert path.touch_m == pytest.approx(0.93 * PAD.height_m, rel=0.01)
    assert path.advance(-2e-5).force_n[2] == 0.0
    assert path.advance(2e-5).force_n[2] > 0.0
