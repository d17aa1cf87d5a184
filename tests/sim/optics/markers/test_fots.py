"""The FOTS exponentials of marker motion."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.optics.markers.fots import FotsMarkers, fit_fots
from sim.optics.markers.printed_markers import marker_places
from sim.scene.indenter import Plane
from sim.scene.scene import Motion, Scene, Target
from sim.sensor.sensor import MarkerGrid, load_sensor

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


def _press(
    centre_m: tuple[float, float],
    *,
    depth_m: float = 0.0,
    shift_m: tuple[float, float] = (0.0, 0.0),
    twist_rad: float = 0.0,
) -> Scene:
    motion, target = Motion(shift_m=shift_m, twist_rad=twist_rad), Target(depth_m=depth_m)
    return replace(SCENE, centre_m=centre_m, target=target, motion=motion)


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
