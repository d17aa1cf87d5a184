"""Markers of a no-contact frame, taken off it and printed again where the gel carried them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from sim.optics.markers.printed_markers import (
    draw_markers,
    marker_places,
    printed_markers,
    track_markers,
)
from sim.sensor.sensor import MarkerGrid
from tacauchy_rig.core.errors import ConfigError
from tests.sim.optics.analytic_surface import camera

GRID = MarkerGrid(columns=5, rows=4, pitch_m=(2.4e-3, 2.2e-3), radius_m=3.5e-4)
FINE = replace(
    camera(scale_x_m=6.2e-5, scale_y_m=6.4e-5),
    width=320,
    height=240,
    centre_x_px=158.3,
    centre_y_px=121.9,
)


def _gel() -> np.ndarray:
    rows, columns = np.mgrid[:240, :320]
    return np.stack([120 + 0.1 * columns, 140 - 0.1 * rows, 130 + 0.05 * rows], -1).astype(np.uint8)


def _frame(displacement_m: np.ndarray | float = 0.0, *, noise: float = 0.0) -> np.ndarray:
    image = draw_markers(_gel(), marker_places(GRID) + displacement_m, GRID.radius_m, FINE)
    blurred = cv2.GaussianBlur(image, (0, 0), 0.8).astype(float)
    blurred += noise * np.random.default_rng(0).standard_normal(blurred.shape)
    return np.clip(np.rint(blurred), 0, 255).astype(np.uint8)


def test_markers_come_off_and_go_on_again() -> None:
    """Without motion the frame comes back; without markers it is the bare gel."""
    printed = printed_markers(_frame(), GRID, FINE)
    assert printed is not None
    assert len(printed.centres_px) == 20
    assert np.abs(printed.bare.astype(int) - _gel()).max() <= 5
    again = printed.over(printed.bare, np.zeros_like(printed.places_m), FINE)
    assert np.abs(again.astype(int) - _frame()).max() <= 1


def test_moved_markers_are_where_they_were_moved_to() -> None:
    """Tracked in a frame with noise, every marker is within 0.1 px of its displacement."""
    printed = printed_markers(_frame(noise=1.0), GRID, FINE)
    assert printed is not None
    moved = 4e-5 * np.stack([np.sin(np.arange(20.0)), np.cos(2.0 * np.arange(20.0))], axis=1)
    image = printed.over(printed.bare, moved, FINE)
    tracks = track_markers(_frame(), image, FINE, radius_m=GRID.radius_m)
    assert tracks.lost == 0
    order = [int(np.argmin(np.linalg.norm(printed.places_m - p, axis=1))) for p in tracks.places_m]
    error_px = (tracks.displacement_m - moved[order]) / (FINE.scale_x_m, FINE.scale_y_m)
    assert np.linalg.norm(error_px, axis=1).max() < 0.1


def test_markers_at_the_border_move_too() -> None:
    """A row that the image cuts in half is found by the others and moved like them."""
    cut = replace(FINE, centre_y_px=2.0 + 1.5 * 2.2e-3 / FINE.scale_y_m)
    image = draw_markers(_gel(), marker_places(GRID), GRID.radius_m, cut)
    printed = printed_markers(image, GRID, cut)
    assert printed is not None
    assert printed.centres_px[:, 1].min() < 4.0
    moved = np.tile([6e-5, 0.0], (len(printed.places_m), 1))
    wanted = draw_markers(_gel(), marker_places(GRID) + moved[0], GRID.radius_m, cut)
    drawn = printed.over(printed.bare, moved, cut)
    assert np.abs(drawn[:12].astype(int) - wanted[:12]).mean() < 1.0


def test_a_frame_without_markers_has_none() -> None:
    """Units are sold without markers: nothing is drawn, nothing is masked."""
    assert printed_markers(_gel(), GRID, FINE) is None
    assert printed_markers(_frame(), None, FINE) is None


def test_markers_off_their_places_are_refused() -> None:
    """A pixel size that is far off names the section to correct."""
    wrong = replace(GRID, pitch_m=(0.8e-3, 0.7e-3), radius_m=3.5e-4)
    with pytest.raises(ConfigError, match="near one of the"):
        printed_markers(_frame(), wrong, FINE)
