"""The emulated world's truth: a function of the seed alone."""

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.emulators.plant.gel_image_and_lights import render_press, view_of
from drivers.emulators.plant.gel_response import SurfaceProfile
from drivers.emulators.plant.press_table import PressCase, compute_table
from drivers.emulators.plant.relief_shadows_and_texture import relief_of, visible_share
from drivers.emulators.plant.truth import (
    EmulatedUnit,
    GelDisc,
    GelLight,
    SphereTip,
    draw_truth,
    read_truth,
    write_truth,
)
from sim.sensor.sensor import load_sensor
from tacauchy_rig.app.cli.emulated_calibration import emulated_unit
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.json_codec import read_json


def test_another_process_draws_the_same_world(tmp_path: Path) -> None:
    """Emulators in separate processes agree without talking to each other."""
    program = (
        "import sys, pathlib; from drivers.emulators.plant.truth import *;"
        "write_truth(pathlib.Path(sys.argv[1]), draw_truth(7))"
    )
    subprocess.run([sys.executable, "-c", program, str(tmp_path)], check=True, cwd=Path.cwd())
    assert read_truth(tmp_path / "truth.json") == draw_truth(7)


@given(st.integers(0, 2**31))
def test_every_world_is_believable(seed: int) -> None:
    """Spread stays within what units of one sensor show."""
    truth = draw_truth(seed)
    assert 0.39e6 < truth.young_pa < 0.48e6
    assert 0.47 <= truth.poisson <= 0.49
    assert 0.05 <= sum(truth.relaxation_weights) <= 0.08
    assert 1e-4 <= sum(value**2 for value in truth.pose_error_m) ** 0.5 <= 3.0001e-4
    assert 0.005 <= truth.force_noise_n <= 0.010
    assert abs(truth.force_drift_n_s) < 1e-3


def test_a_broken_truth_file_is_refused(tmp_path: Path) -> None:
    """A file without the fields names itself."""
    path = tmp_path / "truth.json"
    path.write_text("{}")
    with pytest.raises(RecordError, match=r"truth\.json"):
        read_truth(path)


BALL = SphereTip(diameter_m=4e-3)
LAYERED = GelDisc(
    radius_m=8e-3, thickness_m=3e-3, dome_radius_m=math.inf, layers=((0.9, 0.25), (0.1, 1.0))
)


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the tests out of the user's cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def test_a_soft_base_under_a_skin_is_softer_than_the_skin_and_stiffer_than_the_base() -> None:
    """The force of a layered gel lies between those of its materials."""

    def force(gel: GelDisc) -> float:
        return float(compute_table(PressCase(tip=BALL, gel=gel, max_depth_m=1.2e-4)).force[-1])

    skin = force(replace(LAYERED, layers=()))
    assert 0.25 * skin < force(LAYERED) < skin
    alike = replace(LAYERED, layers=((0.9, 1.0), (0.1, 1.0)))
    assert force(alike) == pytest.approx(skin, rel=1e-3)


@pytest.mark.parametrize("name", ["gelsight-mini", "digit", "9dtact"])
def test_a_world_of_every_sensor_survives_its_file(name: str, tmp_path: Path) -> None:
    """What emulators and runs read is what was drawn; a flat gel has no infinite number."""
    truth = draw_truth(3, unit=emulated_unit(load_sensor(name)))
    path = write_truth(tmp_path, truth)
    assert read_truth(path) == truth
    keys = {"young_pa", "surface_error_m", "force_latency_s", "tilt_rad"}
    assert keys <= set(read_json(dict[str, object], path, what="truth")), "units are in the keys"


def test_the_emulated_mini_is_the_default_unit() -> None:
    """A GelSight Mini made from its file has the gel of the shipped press tables."""
    made, default = emulated_unit(load_sensor("gelsight-mini")), EmulatedUnit()
    assert made.gel == default.gel
    assert made.young_pa == default.young_pa
    assert made.pixel_m == pytest.approx(default.pixel_m)


@pytest.mark.slow
def test_a_translucent_gel_is_grey_and_darkens_under_a_ball() -> None:
    """Light through clear gel: no colour, darkest in the middle of the contact."""
    gel = GelDisc(radius_m=8e-3, thickness_m=3e-3, dome_radius_m=math.inf)
    truth = draw_truth(1, unit=EmulatedUnit(gel=gel, light=GelLight.TRANSLUCENT))
    still = [
        render_press(truth, BALL, depth, (320, 240), noise_seed=None).astype(int)
        for depth in (0.0, 3e-4)
    ]
    assert np.ptp(still[1], axis=2).max() == 0
    change = (still[1] - still[0])[..., 0]
    column, row = (round(p) for p in view_of(truth, (320, 240)).pixel(0.0, 0.0))
    assert change[row, column] == change.min() < -15


def test_a_dent_hides_a_grazing_light_from_the_gel_behind_it() -> None:
    """Behind the dent the light is hidden, before it and far behind it is not."""
    radius = np.linspace(0.0, 6e-3, 400)
    profile = SurfaceProfile(
        depth_m=5e-4,
        centre=(0.0, 0.0),
        tilt=(0.1, 0.0),  # beside a dome's middle, where a dent is as high on all sides
        contact_radius=1e-3,
        radius=radius,
        height=-5e-4 * np.exp(-((radius / 1e-3) ** 2)),
        radius_rest=radius,
        tilt_height=np.zeros(0),
    )
    relief = relief_of(profile, dome_radius_m=math.inf)
    assert relief is not None
    x = np.array([[-4e-3, -1.6e-3, 1.6e-3]], np.float32).repeat(4, axis=1).repeat(4, axis=0)
    toward = tuple(np.full_like(x, part) for part in (0.98, 0.0, 0.2))
    shown = visible_share(relief, x, np.zeros_like(x), toward)
    np.testing.assert_array_equal(*(relief.bulge_at(side * x, 0 * x) for side in (-0.5, 0.5)))
    assert shown[0, [0, -1]] == pytest.approx(1.0)
    assert shown[0, 4:8].min() < 0.5
