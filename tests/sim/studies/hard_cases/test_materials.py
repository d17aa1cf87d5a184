"""Rows of nearly incompressible gel, slivers and stiff layers, and what they are made of."""

from __future__ import annotations

import numpy as np
import pytest

from sim.mesh.tet_mesh import smallest_dihedral_deg
from sim.studies.hard_cases.materials import sliver_count, slivers, stiff_layers, with_slivers
from sim.studies.hard_cases.pads import brick_mesh


def test_slivers_are_as_flat_as_asked_and_change_nothing_else() -> None:
    """The smallest angle is the one asked for, every volume positive, the surface untouched."""
    good = brick_mesh((4, 4, 3))
    bad = with_slivers(good, dihedral_deg=0.5)
    assert smallest_dihedral_deg(bad) == pytest.approx(0.5, rel=1e-6)
    assert sliver_count(bad, below_deg=0.51) >= 3
    assert sliver_count(good, below_deg=0.51) == 0
    corners = bad.vertices[bad.tets]
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    assert volumes.min() > 0.0
    assert volumes.sum() == pytest.approx(12e-3 * 12e-3 * 4e-3, rel=1e-12)


def test_slivers_cost_few_iterations() -> None:
    """The row itself, pressed less deep."""
    outcome = slivers(depth_m=0.2e-3)
    assert outcome.passed, outcome.measured


@pytest.mark.slow
def test_stiff_layers_meet_the_laminate() -> None:
    """The row itself: both ways round."""
    outcome = stiff_layers()
    assert outcome.passed, outcome.measured
