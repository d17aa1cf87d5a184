"""Ball presses of the emulated sensor: places, clicks, frames with and without noise."""

import csv
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.emulators.plant.ball_presses import (
    BALL_DIAMETER_M,
    CLICK_ERROR_PX,
    frame_noise,
    write_ball_presses,
)
from drivers.emulators.plant.truth import draw_truth
from sim.sensor.sensor import load_sensor
from tacauchy_rig.app.cli.emulated_calibration import emulated_unit

TRUTH = draw_truth(7)


def _circles(folder: Path) -> dict[str, list[float]]:
    with (folder / "circles.csv").open(encoding="utf-8") as file:
        _, *rows = csv.reader(file)
    return {name: [float(value) for value in values] for name, *values in rows}


def test_later_presses_are_those_of_a_longer_series(tmp_path: Path) -> None:
    """Presses 6 and 7 of seven, and two presses from the sixth on: the same images and clicks."""
    write_ball_presses(TRUTH, tmp_path / "seven", count=7)
    write_ball_presses(TRUTH, tmp_path / "two", count=2, first=6)
    later = _circles(tmp_path / "two")
    assert list(later) == ["press-06.png", "press-07.png"]
    for name, circle in later.items():
        assert circle == _circles(tmp_path / "seven")[name]
        images = [cv2.imread(str(tmp_path / folder / name)) for folder in ("seven", "two")]
        np.testing.assert_array_equal(*images)


def test_without_noise_frames_differ_by_the_noise_alone(tmp_path: Path) -> None:
    """Recorded and noise-free frames are as far apart as is said, and clicked alike."""
    write_ball_presses(TRUTH, tmp_path / "recorded", count=3)
    write_ball_presses(TRUTH, tmp_path / "still", count=3, noise_free=True)
    circles = _circles(tmp_path / "recorded")
    assert circles == _circles(tmp_path / "still")
    apart = []
    for name, (x, y, radius) in circles.items():
        recorded, still = (
            cv2.imread(str(tmp_path / folder / name)).astype(float)
            for folder in ("recorded", "still")
        )
        rows, columns = np.ogrid[: still.shape[0], : still.shape[1]]
        inside = np.hypot(columns - x, rows - y) < radius - 3.0 * CLICK_ERROR_PX
        apart.append(np.abs(recorded - still)[inside].ravel())
    found = frame_noise(TRUTH, count=3)
    assert np.concatenate(apart).mean() == pytest.approx(found.recorded, rel=0.1)
    assert 0.3 < found.noise < found.recorded < 1.5


def test_another_world_has_other_colours(tmp_path: Path) -> None:
    """The seed draws the light; the places stay."""
    write_ball_presses(TRUTH, tmp_path / "a", count=1, noise_free=True)
    write_ball_presses(draw_truth(8), tmp_path / "b", count=1, noise_free=True)
    frames = [
        cv2.imread(str(tmp_path / folder / "no_contact.png")).astype(float) for folder in "ab"
    ]
    assert np.abs(frames[0] - frames[1]).mean() > 1.0
    places = [(tmp_path / folder / "positions.csv").read_text() for folder in "ab"]
    assert places[0] == places[1]


def test_a_thin_gel_is_pressed_until_it_is_steep(tmp_path: Path) -> None:
    """The deepest presses of a DIGIT show slopes of 40 degrees, as those of a lab do."""
    unit = emulated_unit(load_sensor("digit"))
    write_ball_presses(draw_truth(7, unit=unit), tmp_path, count=20, noise_free=True)
    radius_m = max(circle[2] for circle in _circles(tmp_path).values()) * unit.pixel_m[0]
    assert radius_m / (0.5 * BALL_DIAMETER_M) > math.sin(math.radians(40.0))
