"""Markers moved by the surface and by exponentials, drawn, and tracked again."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.optics.markers.fidelity import FotsMarkers, fit_fots
from sim.optics.markers.material_points import surface_displacement
from sim.optics.markers.printed_markers import draw_markers, marker_places
from sim.optics.markers.tracking import track_markers
from sim.scene.indenter import Plane
from sim.scene.scene import Motion, Scene, Target
from sim.sensor.sensor import MarkerGrid, load_sensor
from tacauchy_rig.errors import ConfigError
from tests.sim.optics.analytic_surface import APEX_M, camera, pressed_surface

GRID = MarkerGrid(columns=5, rows=4, pitch_m=(2.4e-3, 2.2e-3), radius_m=3.5e-4)
FOTS = FotsMarkers(
    dilate_gain=40.0,
    dilate_decay=8e4,
    shear_gain=0.9,
    shear_decay=6e4,
    twist_gain=0.8,
    twist_decay=1.2e5,
)
SCENE = load_sensor("gelsight-mini").scene(Plane(), Target(depth_m=0.0))
FINE = camera(scale_x_m=6.2e-5, scale_y_m=6.4e-5)


def _press(
    centre_m: tuple[float, float],
    *,
    depth_m: float = 0.0,
    shift_m: tuple[float, float] = (0.0, 0.0),
    twist_rad: float = 0.0,
) -> Scene:
    motion, target = Motion(shift_m=shift_m, twist_rad=twist_rad), Target(depth_m=depth_m)
    return replace(SCENE, centre_m=centre_m, target=target, motion=motion)


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


@settings(max_examples=25, deadline=None)
@given(x=st.floats(-5e-3, 5e-3), y=st.floats(-5e-3, 5e-3))
def test_no_motion_moves_no_marker(x: float, y: float) -> None:
    """Zero depth, shift and turn give exactly zero: the turn is cos(theta) - 1."""
    found = FOTS.displacement(marker_places(GRID), _press((x, y)))
    np.testing.assert_array_equal(found, 0.0)


def test_twist_turns_about_the_contact() -> None:
    """Near the centre a followed turn is a rotation: lengths are kept."""
    whole = replace(FOTS, twist_gain=1.0, twist_decay=0.0)
    load = _press((1e-3, 0.0), twist_rad=0.4)
    places = marker_places(GRID)
    arm = places - (1e-3, 0.0)
    turned = arm + whole.displacement(places, load)
    np.testing.assert_allclose(np.hypot(*turned.T), np.hypot(*arm.T), rtol=1e-12)
    angle = math.atan2(turned[0, 1], turned[0, 0]) - math.atan2(arm[0, 1], arm[0, 0])
    assert math.remainder(angle - 0.4, 2 * math.pi) == pytest.approx(0.0, abs=1e-12)


def test_exponentials_are_fitted() -> None:
    """Displacements of a press, a shear and a twist give the six numbers back."""
    places = marker_places(GRID)
    loads = [
        _press((0.5e-3, 0.0), depth_m=8e-4),
        _press((0.0, 0.0), depth_m=8e-4, shift_m=(4e-4, 1e-4)),
        _press((0.0, 1e-3), depth_m=8e-4, twist_rad=0.2),
    ]
    found = fit_fots(places, loads, [FOTS.displacement(places, load) for load in loads])
    for name in ("dilate_gain", "dilate_decay", "shear_gain", "shear_decay", "twist_gain"):
        assert getattr(found, name) == pytest.approx(getattr(FOTS, name), rel=0.02)


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
