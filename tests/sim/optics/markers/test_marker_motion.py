"""Markers moved by the surface, drawn, and tracked again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.optics.markers.material_points import surface_displacement
from sim.optics.markers.printed_markers import draw_markers, marker_places, track_markers
from sim.sensor.sensor import MarkerGrid
from tacauchy_rig.core.errors import ConfigError
from tests.sim.optics.analytic_surface import APEX_M, camera, pressed_surface

GRID = MarkerGrid(columns=5, rows=4, pitch_m=(2.4e-3, 2.2e-3), radius_m=3.5e-4)
FINE = camera(scale_x_m=6.2e-5, scale_y_m=6.4e-5)


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
    np.testing.assert_array_equal(still, 0.0)


def test_points_beside_the_surface_are_refused() -> None:
    """A marker off the pad is named by its place."""
    with pytest.raises(ConfigError, match=r"marker at 50\.00, 0\.00 mm lies beside"):
        surface_displacement(_moved_surface(0.0, 0.0), np.array([[0.05, 0.0]]))


@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_tracking_finds_the_motion(noise: float) -> None:
    """Rendered over uneven light, every marker's displacement comes back within 0.1 px."""
    rng = np.random.default_rng(4)
    rows, columns = np.mgrid[:96, :128]
    light = np.stack([120 + 0.5 * columns, 150 - 0.4 * rows, 100 + 0.3 * rows], axis=-1)
    grid = MarkerGrid(columns=3, rows=2, pitch_m=(2.3e-3, 2.4e-3), radius_m=3.5e-4)
    places = marker_places(grid)
    moved = places + rng.uniform(-3e-4, 3e-4, places.shape)

    def frame(at: np.ndarray) -> np.ndarray:
        image = draw_markers(np.rint(light).astype(np.uint8), at, grid.radius_m, FINE)
        noisy = image + rng.normal(0.0, 1.0, image.shape) * noise
        return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)

    tracks = track_markers(frame(places), frame(moved), FINE, radius_m=grid.radius_m)
    assert len(tracks.places_m) == 6
    assert tracks.lost == 0
    order = np.lexsort((places[:, 0], places[:, 1]))
    seen = np.lexsort((tracks.places_m[:, 0], np.rint(tracks.places_m[:, 1] / 1e-3)))
    error = tracks.displacement_m[seen] - (moved - places)[order]
    assert np.abs(error / (6.2e-5, 6.4e-5)).max() < 0.1


def test_frame_without_markers_is_refused() -> None:
    """A frame at rest with nothing printed on it names what to check."""
    plain = np.full((96, 128, 3), 120, np.uint8)
    with pytest.raises(ConfigError, match="shows no marker"):
        track_markers(plain, plain, FINE, radius_m=3.5e-4)
