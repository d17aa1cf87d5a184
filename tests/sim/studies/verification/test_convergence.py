"""Orders of convergence."""

from __future__ import annotations

import numpy as np
import pytest

from sim.studies.verification.forces import fitted_order, rim_forces


@pytest.mark.parametrize("order", [1.0, 1.8, 3.0])
def test_fit_finds_the_order_and_the_limit(order: float) -> None:
    """Forces on a power law give its power back."""
    edges = np.array([2.0, 1.333, 1.0, 0.667, 0.5])
    found, limit = fitted_order(edges, 1.2 + 0.05 * edges**order)
    assert found == pytest.approx(order, abs=0.02)
    assert limit == pytest.approx(1.2, rel=2e-3)


def test_finer_edges_at_a_sharp_rim_lower_the_force() -> None:
    """By less every time; a whole punch's force comes from its quarter."""
    coarse, middle, fine = rim_forces((0.32, 0.16, 0.08))
    assert coarse > middle > fine > 0.5
    assert coarse - middle > middle - fine
