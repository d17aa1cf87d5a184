"""Shear at places of the pad, from values at nodes."""

from __future__ import annotations

import numpy as np

from reports.evidence.replayed import shear_at


def test_shear_is_told_where_it_is_asked_for() -> None:
    """Along x and y, linear between nodes, nothing beyond them; None where nobody kept it."""
    corners = np.array([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [0.0, 2.0, 1.0], [2.0, 2.0, 1.0]])
    shear = np.stack([corners[:, 0], -corners[:, 1], np.full(4, 9.0)], axis=1)
    places = np.array([[0.5, 1.5, 5.0]]), np.array([[1.0, 0.25, 5.0]])
    found = shear_at({"node_m": corners, "contact_shear_pa": shear}, *places)
    np.testing.assert_allclose(found, [[[0.5, -1.0], [1.5, -0.25], [0.0, 0.0]]])
    assert shear_at({"node_m": corners}, *places) is None
