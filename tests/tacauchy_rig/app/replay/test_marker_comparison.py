"""Markers of a recorded frame beside those of the simulated surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.optics.markers.printed_markers import draw_markers, find_markers, marker_places
from sim.sensor.sensor import MarkerGrid
from tacauchy_rig.app.replay.rendering import marker_motion
from tests.sim.optics.analytic_surface import APEX_M, camera, pressed_surface

GRID = MarkerGrid(columns=4, rows=3, pitch_m=(2.4e-3, 2.2e-3), radius_m=3.5e-4)


def test_a_trial_states_how_far_its_markers_are_off() -> None:
    """A surface that moves by 0.2 mm where the recording moved by 0.3 mm is 0.1 mm, 1 px off."""
    view, places = camera(), marker_places(GRID)
    plain = np.full((96, 128, 3), 140, np.uint8)
    rest = draw_markers(plain, places, GRID.radius_m, view)
    loaded = draw_markers(plain, places + np.array([3e-4, 0.0]), GRID.radius_m, view)
    markers = find_markers(rest)
    assert markers is not None
    flat = pressed_surface(lambda x, _: np.full_like(x, APEX_M))
    surface = replace(flat, positions=flat.positions + np.array([2e-4, 0.0, 0.0]))
    found = marker_motion(3, markers, loaded, surface, view)
    assert (found.trial, found.drawn, found.tracked, found.lost) == (3, 12, 12, 0)
    assert found.apart_median_px == pytest.approx(1.0, abs=0.1)
    assert found.apart_rms_m == pytest.approx(1e-4, rel=0.1)
    assert found.simulated_largest_m == pytest.approx(2e-4, rel=0.01)
    assert found.tracking_error_px is not None
    assert found.tracking_error_px < 0.1
    assert marker_motion(3, markers, None, surface, view).tracked is None
