"""The displacement search."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.material.laws.tangent import law
from sim.mesh.elements import ElementOrder
from sim.mesh.revolved import Grading, revolved_mesh
from sim.scene.indenter import Cylinder
from sim.scene.material import LawName
from sim.scene.pad import DiscPad
from sim.solve.force_search import find_force
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model

PUNCH = Cylinder(diameter_m=4e-3, fillet_m=0.3e-3)


@pytest.fixture(scope="module")
def path() -> LoadingPath:
    """Return a path into a coarse pad; every search goes on from the last."""
    mesh = revolved_mesh(
        DiscPad(radius_m=6e-3, height_m=4e-3),
        Grading(start_m=1.7e-3, end_m=2e-3, size_m=0.5e-3, growth=2.0),
        centre_m=(0.0, 0.0),
        sector_count=8,
        name="test",
    )
    model = Model(
        mesh, order=ElementOrder.P2, law=law(LawName.STABLE_NEO_HOOKEAN), young_pa=3e5, poisson=0.45
    )
    return LoadingPath(model, PUNCH)


@settings(max_examples=8, deadline=None, derandomize=True)
@given(force_n=st.floats(min_value=0.05, max_value=0.9))
def test_any_force_is_met_from_anywhere(path: LoadingPath, force_n: float) -> None:
    """Up or down from the last point, within the tolerance and in few evaluations."""
    match = find_force(path, force_n, tolerance_n=1e-3)
    assert abs(match.point.force_n[2] - force_n) <= 1e-3
    assert len(match.history) <= 12
    assert match.history[-1] == (match.point.depth_m, match.point.force_n[2])


def test_force_and_depth_are_the_same_path(path: LoadingPath) -> None:
    """Pressing to the depth that a search found gives its force."""
    match = find_force(path, 0.6, tolerance_n=1e-3)
    again = LoadingPath(path.model, PUNCH).advance(match.point.depth_m)
    assert again.force_n[2] == pytest.approx(match.point.force_n[2], rel=1e-4)
