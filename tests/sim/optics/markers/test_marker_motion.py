"""Points printed on the gel, carried by the simulated surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.optics.markers.marker_printer import surface_displacement
from sim.optics.markers.printed_markers import marker_places
from sim.sensor.sensor import MarkerGrid
from tacauchy_rig.core.errors import ConfigError
from tests.sim.optics.analytic_surface import APEX_M, pressed_surface

GRID = MarkerGrid(columns=5, rows=4, pitch_m=(2.4e-3, 2.2e-3), radius_m=3.5e-4)


def test_places_are_a_centred_grid() -> None:
    """Rows run along x; the middle is the pad's centre."""
    places = marker_places(GRID)
    assert places.shape == (20, 2)
    np.testing.assert_allclose(places.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(places[1] - places[0], (2.4e-3, 0.0))
    np.testing.assert_allclose(places[5] - places[0], (0.0, 2.2e-3))


def _moved_surface(dx: float, dy: float):  # type: ignore[no-untyped-def]
    flat = pressed_surface(lambda x, _: np.full_like(x, APEX_M))
    moved = flat.positions.copy()
    moved[:, 0] += dx * flat.positions_rest[:, 1] / 1e-3
    moved[:, 1] += dy
    return replace(flat, positions=moved)


def test_points_follow_the_surface() -> None:
    """A field that is linear over the facets is followed exactly; rest means zero."""
    places = marker_places(GRID)
    found = surface_displacement(_moved_surface(1e-5, -3e-5), places)
    np.testing.assert_allclose(found[:, 0], 1e-5 * places[:, 1] / 1e-3, atol=1e-15)
    np.testing.assert_allclose(found[:, 1], -3e-5, atol=1e-15)
    still = surface_displacement(_moved_surface(0.0, 0.0), places)
    np.testing.assert_allclose(still, 0.0, atol=1e-17)


def test_points_beside_the_surface_are_refused() -> None:
    """A marker off the pad is named by its place."""
    with pytest.raises(ConfigError, match=r"marker at 50\.00, 0\.00 mm lies beside"):
        surface_displacement(_moved_surface(0.0, 0.0), np.array([[0.05, 0.0]]))
