"""Single frames of the emulated camera: geometry, light, texture, markers, noise."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.emulators.plant.gel_image_and_lights import render_press, view_of
from drivers.emulators.plant.truth import CylinderTip, MarkerGrid, SphereTip, draw_truth
from tacauchy_rig.core.errors import ConfigError

TRUTH = draw_truth(7)
PUNCH = CylinderTip(diameter_m=5e-3)
SIZE = (640, 480)
BLUE, GREEN, RED = 0, 1, 2


@pytest.fixture(scope="module")
def change() -> np.ndarray:
    """Return pressed minus unloaded, without noise [grey levels]."""
    pressed = render_press(TRUTH, PUNCH, 0.6e-3, SIZE, noise_seed=None)
    return pressed.astype(float) - render_press(TRUTH, PUNCH, 0.0, SIZE, noise_seed=None)


def _ring(change: np.ndarray, angle_deg: float, radius_m: float, channel: int) -> float:
    angle = np.radians(angle_deg)
    column, row = view_of(TRUTH, SIZE).pixel(radius_m * np.cos(angle), radius_m * np.sin(angle))
    patch = change[round(row) - 1 : round(row) + 2, round(column) - 1 : round(column) + 2, channel]
    return float(patch.mean())


def test_each_light_brightens_the_side_that_faces_it(change: np.ndarray) -> None:
    """The skirt is red above, green below and blue on the left, and darker on the far side."""
    for channel, angle in ((RED, -97.0), (GREEN, 94.0), (BLUE, 183.0)):
        assert _ring(change, angle, 2.8e-3, channel) > 25.0
        assert _ring(change, angle + 180.0, 2.8e-3, channel) < -8.0


def test_the_flat_contact_keeps_its_colour(change: np.ndarray) -> None:
    """Under the flat face the slope is nearly that of the unloaded gel."""
    assert all(abs(_ring(change, angle, 1e-3, RED)) < 8.0 for angle in range(0, 360, 45))


def test_far_away_nothing_changes(change: np.ndarray) -> None:
    """The corners of the frame do not feel the press."""
    assert np.abs(change[:20, :20]).max() <= 1.0
    assert np.abs(change[-20:, -20:]).max() <= 1.0


def test_deeper_is_stronger() -> None:
    """The change grows with every step of depth, so force can be told from the image."""
    rest = render_press(TRUTH, PUNCH, 0.0, SIZE, noise_seed=None).astype(float)
    energy = [
        np.abs(render_press(TRUTH, PUNCH, depth, SIZE, noise_seed=None) - rest).mean()
        for depth in (0.1e-3, 0.2e-3, 0.4e-3, 0.6e-3, 0.8e-3)
    ]
    assert np.all(np.diff(energy) > 0.02)


def test_the_contact_sits_where_it_was_pressed() -> None:
    """The centroid of the change follows the press to a pixel, through scale and rotation."""
    still = replace(TRUTH, tilt_rad=(0.0, 0.0))
    rest = render_press(still, PUNCH, 0.0, SIZE, noise_seed=None).astype(float)
    centre = (2e-3, -1.5e-3)
    pressed = render_press(still, PUNCH, 0.4e-3, SIZE, centre_m=centre, noise_seed=None)
    strong = np.abs(pressed - rest).max(axis=-1) > 15.0
    rows, columns = np.nonzero(strong)
    middle = 0.5 * (columns.min() + columns.max()), 0.5 * (rows.min() + rows.max())
    assert middle == pytest.approx(view_of(still, SIZE).pixel(*centre), abs=3.0)


def test_view_maps_points_to_pixels_and_back() -> None:
    """The true mapping is its own inverse, to judge a scale calibration by."""
    view = view_of(TRUTH, (1640, 1232))
    x, y = view.gel_points()
    column, row = view.pixel(float(x[300, 700]), float(y[300, 700]))
    assert (column, row) == pytest.approx((700, 300), abs=1e-2)


def test_sizes_show_the_same_scene() -> None:
    """A large frame is the small one with more pixels, not another gel."""
    small = render_press(TRUTH, PUNCH, 0.5e-3, (640, 480), noise_seed=None).astype(float)
    large = render_press(TRUTH, PUNCH, 0.5e-3, (1920, 1440), noise_seed=None)
    shrunk = large.reshape(480, 3, 640, 3, 3).mean(axis=(1, 3))
    assert np.abs(shrunk - small).mean() < 1.0


def test_noise_is_drawn_anew_and_repeatable() -> None:
    """One noise seed gives one frame; another differs by noise of the drawn size."""
    first = render_press(TRUTH, PUNCH, 0.0, SIZE, noise_seed=1)
    assert np.array_equal(first, render_press(TRUTH, PUNCH, 0.0, SIZE, noise_seed=1))
    other = render_press(TRUTH, PUNCH, 0.0, SIZE, noise_seed=2)
    scatter = np.std(first.astype(float) - other) / np.sqrt(2.0)
    assert scatter == pytest.approx(TRUTH.image_noise_levels, rel=0.1)


@pytest.mark.slow
def test_a_ball_shades_the_inside_of_its_contact(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A calibration ball shows slopes of every direction inside its circle."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    ball = SphereTip(diameter_m=4.7e-3)
    pressed = render_press(TRUTH, ball, 0.8e-3, SIZE, noise_seed=None).astype(float)
    change = pressed - render_press(TRUTH, ball, 0.0, SIZE, noise_seed=None)
    assert _ring(change, -97.0, 1e-3, RED) > 25.0
    assert _ring(change, 83.0, 1e-3, RED) < -10.0


def test_markers_move_outwards_with_the_surface() -> None:
    """Dots are absent by default, dark when asked for, and pushed away from a press."""
    plain = render_press(TRUTH, PUNCH, 0.0, SIZE, noise_seed=None).astype(float)
    dots = replace(TRUTH, unit=replace(TRUTH.unit, markers=MarkerGrid()))
    dotted = render_press(dots, PUNCH, 0.0, SIZE, noise_seed=None)
    column, row = view_of(TRUTH, SIZE).pixel(*MarkerGrid().rest()[0])
    at = round(row), round(column)
    assert dotted[at].mean() < 0.6 * plain[at].mean()
    assert MarkerGrid().rest().shape == (63, 2)


def test_a_size_no_camera_has_is_refused() -> None:
    """The message names the size and the range."""
    with pytest.raises(ConfigError, match="100x75 px is not between 320x240 and 3280x2464"):
        render_press(TRUTH, PUNCH, 0.0, (100, 75))
