"""Pressure along lines through the tip, from values at nodes."""

from __future__ import annotations

import numpy as np
import pytest

from reports.evidence.replayed import pressure_profile, shear_at


def test_a_profile_is_what_the_nodes_say() -> None:
    """Of a pressure that falls from the tip, further along x than along y; nothing beyond."""
    x, y = np.meshgrid(np.linspace(-5e-3, 5e-3, 101), np.linspace(-5e-3, 5e-3, 101))
    pressure = 1e5 * np.maximum(1.0 - np.hypot((x - 1e-3) / 2e-3, y / 1e-3), 0.0)
    profile = pressure_profile(
        {
            "node_m": np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1),
            "contact_pressure_pa": pressure.ravel(),
            "indenter_tip_m": np.array([1e-3, 0.0, 2e-3]),
        }
    )
    assert profile is not None
    assert np.interp(0.0, profile.along_m, profile.on_x_pa) == pytest.approx(1e5, rel=0.01)
    assert np.interp(1e-3, profile.along_m, profile.on_x_pa) == pytest.approx(5e4, rel=0.01)
    assert np.interp(5e-4, profile.along_m, profile.on_y_pa) == pytest.approx(5e4, rel=0.01)
    assert profile.on_x_pa[0] == profile.on_y_pa[-1] == 0.0


def test_without_pressure_there_is_no_profile() -> None:
    """Arrays of another replay, or a gel that nothing touches."""
    assert pressure_profile({}) is None
    nodes = {"node_m": np.zeros((3, 3)), "indenter_tip_m": np.zeros(3)}
    assert pressure_profile({**nodes, "contact_pressure_pa": np.zeros(3)}) is None


def test_shear_is_told_where_it_is_asked_for() -> None:
    """Along x and y, linear between nodes, nothing beyond them; None where nobody kept it."""
    corners = np.array([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [0.0, 2.0, 1.0], [2.0, 2.0, 1.0]])
    shear = np.stack([corners[:, 0], -corners[:, 1], np.full(4, 9.0)], axis=1)
    places = np.array([[0.5, 1.5, 5.0]]), np.array([[1.0, 0.25, 5.0]])
    found = shear_at({"node_m": corners, "contact_shear_pa": shear}, *places)
    np.testing.assert_allclose(found, [[[0.5, -1.0], [1.5, -0.25], [0.0, 0.0]]])
    assert shear_at({"node_m": corners}, *places) is None
