"""Markers of a no-contact frame: found, taken off, printed again, and followed."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from sim.optics.markers.marker_tracking import (
    PrintedMarkers,
    find_markers,
    follow_markers,
    hidden_by,
)
from sim.optics.markers.simulated_markers import (
    MarkerPrinter,
    draw_markers,
    marker_places,
    seen_motion,
    surface_displacement,
)
from sim.sensor.sensor import MarkerGrid
from tacauchy_rig.core.errors import ConfigError
from tests.sim.optics.analytic_surface import APEX_M, camera, pressed_surface

GRID = MarkerGrid(columns=5, rows=4, pitch_m=(2.4e-3, 2.2e-3), radius_m=3.5e-4)
FINE = replace(
    camera(320, 240), scale_x_m=6.2e-5, scale_y_m=6.4e-5, centre_x_px=158.3, centre_y_px=121.9
)
ROWS, COLUMNS = np.mgrid[:240, :320].astype(np.float64)


def _gel() -> np.ndarray:
    red, green, blue = 120 + 0.1 * COLUMNS, 140 - 0.1 * ROWS, 130 + 0.05 * ROWS
    return np.stack([red, green, blue], -1).astype(np.uint8)


def _seen(image: np.ndarray, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    blurred = cv2.GaussianBlur(image, (0, 0), 0.8).astype(float)
    blurred += noise * np.random.default_rng(seed).standard_normal(blurred.shape)
    return np.clip(np.rint(blurred), 0, 255).astype(np.uint8)


def _frame(displacement_m: np.ndarray | float = 0.0, *, noise: float = 0.0) -> np.ndarray:
    places = marker_places(GRID) + displacement_m
    return _seen(draw_markers(_gel(), places, GRID.radius_m, FINE), noise)


def _speckled(seed: int, count: int, least_px: float, most_px: float, gap_px: float) -> np.ndarray:
    """Return irregular blots of any size at random places, some of them cut by the border."""
    rng, image, kept = np.random.default_rng(seed), _gel(), []
    while len(kept) < count:
        x, y = rng.uniform((-2.0, -2.0), (322.0, 242.0))
        radius = rng.uniform(least_px, most_px)
        if all(np.hypot(x - a, y - b) > radius + c + gap_px for a, b, c in kept):
            kept.append((x, y, radius))
    for x, y, radius in kept:
        turn = np.arctan2(ROWS - y, COLUMNS - x)
        outline = radius * (1.0 + 0.15 * np.cos(3.0 * turn + x))
        image[np.hypot(COLUMNS - x, ROWS - y) < outline] = (35, 38, 32)
    return image


def _found(frame: np.ndarray) -> PrintedMarkers:
    found = find_markers(frame)
    assert found is not None
    return found


def test_markers_come_off_and_go_on_again() -> None:
    """Without motion the frame comes back exactly; without markers it is the bare gel."""
    printed = _found(_frame())
    assert len(printed.centres_px) == 20
    np.testing.assert_allclose(
        printed.centres_px[np.lexsort(np.rint(printed.centres_px / 9.0).T)][0],
        FINE.to_pixels(marker_places(GRID))[0],
        atol=0.2,
    )
    assert np.abs(printed.bare.astype(int) - _gel()).max() <= 5
    np.testing.assert_allclose(printed.over(printed.bare), _frame(), atol=1e-3)


@pytest.mark.parametrize(
    ("count", "sizes", "gap_px"), [(25, (3.0, 12.0), 8.0), (250, (2.0, 3.5), 3.0)]
)
def test_any_pattern_is_found_and_followed(
    count: int, sizes: tuple[float, float], gap_px: float
) -> None:
    """Irregular blots, cut ones and dense ones: nearly all are found, and followed to 0.1 px."""
    still = _speckled(11, count, *sizes, gap_px)
    printed = _found(_seen(still, 1.0))
    assert 0.9 * count <= len(printed.centres_px) <= count
    x = COLUMNS - 3.0 * np.sin(ROWS / 60.0)
    moved = cv2.remap(still, x.astype(np.float32), ROWS.astype(np.float32), cv2.INTER_LINEAR)
    tracks = follow_markers(printed, _seen(moved, 1.0, seed=5))
    assert tracks.lost <= 0.2 * count  # some of those that the border cuts
    true = np.stack([3.0 * np.sin(tracks.rest_px[:, 1] / 60.0), 0.0 * tracks.rest_px[:, 1]], 1)
    error = np.linalg.norm(tracks.motion_px - true, axis=1)
    assert np.median(error) < 0.1
    assert np.median(tracks.error_px) < 0.1


def test_large_motion_is_followed_and_hidden_markers_are_lost() -> None:
    """Dots that go farther than half their distance keep their names; a covered one is lost."""
    rest = FINE.to_pixels(marker_places(GRID))
    far = 22.0 * np.exp(-((np.linalg.norm(rest - (160.0, 120.0), axis=1) / 130.0) ** 2))
    moved_px = far[:, None] * (0.8, 0.6)
    image = draw_markers(_gel(), FINE.to_pad(rest + moved_px), GRID.radius_m, FINE)
    column, row = np.rint(rest[8] + moved_px[8]).astype(int)
    image[row - 9 : row + 10, column - 9 : column + 10] = 150
    tracks = follow_markers(_found(_frame()), _seen(image, 1.0))
    order = np.argmin(np.linalg.norm(rest[:, None] - tracks.rest_px, axis=2), axis=0)
    assert tracks.lost >= 1
    assert 8 not in order
    assert len(order) >= 17
    assert np.linalg.norm(tracks.motion_px - moved_px[order], axis=1).max() < 0.3


def test_a_ball_takes_a_single_marker_along() -> None:
    """In a wide grid the others around it hardly move; it is followed all the same."""
    rest = FINE.to_pixels(marker_places(GRID))
    moved_px = np.zeros_like(rest)
    moved_px[7] = (-6.0, -3.5)
    image = draw_markers(_gel(), FINE.to_pad(rest + moved_px), GRID.radius_m, FINE)
    tracks = follow_markers(_found(_frame()), _seen(image, 1.0))
    assert tracks.lost == 0
    order = np.argmin(np.linalg.norm(rest[:, None] - tracks.rest_px, axis=2), axis=0)
    assert np.linalg.norm(tracks.motion_px - moved_px[order], axis=1).max() < 0.2


def test_markers_stay_sharp_between_pixels() -> None:
    """Half a pixel on, printed dots are as sharp as those of a camera."""
    printed = _found(_frame())
    half = np.full((2, 240, 320), 0.5)
    wanted = _frame(0.5 * np.array([FINE.scale_x_m, FINE.scale_y_m]))
    off = np.abs(printed.over(printed.bare, half) - wanted)[printed.mask]
    by_line = cv2.warpAffine(_frame(), np.float32([[1, 0, 0.5], [0, 1, 0.5]]), (320, 240))
    assert off.mean() < 0.7 * np.abs(by_line.astype(float) - wanted)[printed.mask].mean()


def test_a_hidden_mask_covers_markers_before_and_after() -> None:
    """What markers hide at rest and moved is left out of fits."""
    printed = _found(_frame())
    shift = np.array([6e-4, 0.0])
    hidden = hidden_by(printed, follow_markers(printed, _frame(shift)))
    for at in (marker_places(GRID), marker_places(GRID) + shift):
        column, row = np.rint(FINE.to_pixels(at)).astype(int).T
        assert hidden[row, column].all()
    assert hidden.mean() < 0.3


def test_a_printer_moves_markers_with_the_surface() -> None:
    """Drawn over the bare gel, markers are where the surface carries them, and stretched like it.

    The formula in NumPy gives the same image.
    """
    flat = pressed_surface(lambda x, _: np.full_like(x, APEX_M))
    moved = flat.positions.copy()
    moved[:, 0] += 0.1 * flat.positions_rest[:, 0] + 5e-5
    view = camera(96, 72)
    plain = np.full((72, 96, 3), 130, np.uint8)
    grid = MarkerGrid(columns=3, rows=2, pitch_m=(1.5e-3, 1.6e-3), radius_m=2.5e-4)
    places = marker_places(grid)
    printed = _found(_seen(draw_markers(plain, places, grid.radius_m, view)))
    surface = replace(flat, positions=moved)
    image = MarkerPrinter(flat.top, printed, view).image_over(printed.bare, surface)
    goes = places + np.stack([0.1 * places[:, 0] + 5e-5, 0.0 * places[:, 0]], axis=1)
    wanted = _seen(draw_markers(plain, goes, grid.radius_m, view))
    assert np.abs(image.astype(int) - wanted).mean() < 1.0
    motion = seen_motion(surface, places, view)
    np.testing.assert_allclose(motion, (goes - places) / view.scale_x_m, atol=1e-3)
    x, _ = view.pad_grid()
    field = np.stack([(x - (x - 5e-5) / 1.1) / view.scale_x_m, 0.0 * x])
    assert np.abs(printed.over(printed.bare, field) - image).max() < 4.0
    still = MarkerPrinter(flat.top, printed, view).image_over(printed.bare, flat)
    np.testing.assert_array_equal(still, printed.frame)


def test_what_is_pressed_nearer_is_seen_farther_out() -> None:
    """A camera at a distance sees gel that comes nearer magnified, about the image's middle."""
    flat = pressed_surface(lambda x, _: np.full_like(x, APEX_M))
    nearer = flat.positions - (0.0, 0.0, 1e-3)
    view = replace(camera(), distance_m=0.02)
    motion = seen_motion(replace(flat, positions=nearer), np.array([[1e-3, 0.0]]), view)
    middle = 0.5 * np.array([view.width - 1.0, view.height - 1.0])
    away = view.to_pixels(np.array([[1e-3, 0.0]])) - middle
    np.testing.assert_allclose(motion, away / 19.0, atol=1e-3)


def test_a_frame_without_markers_has_none() -> None:
    """Units are sold without markers: nothing is masked, and a speck is no marker."""
    assert find_markers(_seen(_gel(), 2.0)) is None
    specks = _gel()
    specks[50:53, 80:83] = 20
    assert find_markers(_seen(specks, 1.0)) is None


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
