"""What moments and images of a run tell of its tool, and what becomes of it."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from sim.sensor.sensor import load_sensor
from tacauchy_rig.app.replay.inputs import inputs_of
from tacauchy_rig.app.replay.mounting import (
    Dwell,
    find_offset,
    offset_of,
    tilt_of,
    tilted_curve,
    with_found_tilt,
)
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.force_depth import ForceDepthCurve
from tests.studies.mounting.command import drawn_dwells

DEGREE = math.radians(1.0)
FAST = "replay.preset=fast"


def configured(*overrides: str) -> RigConfig:
    """Return the defaults with ``table.field=value`` overrides."""
    return load_config(overrides=overrides).config


@pytest.mark.slow
def test_a_tilt_that_costs_too_much_is_simulated() -> None:
    """A degree, in an emulated world of another gel, arm and noise, is found and switched on."""
    config = configured()
    found = with_found_tilt(
        drawn_dwells(21, (0.8 * DEGREE, -0.6 * DEGREE), config), inputs_of(config), config
    )
    tilt = np.array(found.inputs.tilt_rad)
    doubt = np.array([value.uncertainty for value in found.values])
    assert np.all(np.abs(tilt - np.array([0.8, -0.6]) * DEGREE) < 2.5 * doubt)
    assert np.all(doubt < 0.25 * DEGREE)
    (row,) = found.effects
    assert row["on"]
    assert "image would be" in row["reason"]
    assert found.inputs.scene([2.0]).motion.tilt_rad == (-tilt[1], tilt[0])


@pytest.mark.parametrize(
    ("seed", "tilt_rad", "overrides", "taken", "why"),
    [
        (3, 0.02 * DEGREE, (), False, "within 2 times its uncertainty of none"),
        pytest.param(21, DEGREE, (FAST,), True, "10.00% allowed", marks=pytest.mark.slow),
    ],
)
def test_a_tilt_of_no_consequence_is_left_out(
    seed: int, tilt_rad: float, overrides: tuple[str, ...], taken: bool, why: str
) -> None:
    """An upright tool stays upright; preset fast allows an image to be off by more than a degree's.

    The row says why.
    """
    config = configured(*overrides)
    dwells = drawn_dwells(seed, (tilt_rad, 0.0), config)[1::2]
    found = with_found_tilt(dwells, inputs_of(config), config)
    assert found.inputs == inputs_of(config)
    assert all(value.taken for value in found.values) == taken
    assert why in found.effects[0]["reason"]
    assert not found.effects[0]["on"]


@pytest.mark.parametrize(
    ("overrides", "kept", "why"),
    [
        (('indenter.kind="sphere"',), slice(None), "does not change a ball"),
        ((), slice(2), "2 presses carry moments"),
        ((), slice(0), "0 presses carry moments"),
        pytest.param(
            ('workspace.max_tilt="0.5 deg"',),
            slice(3),
            "more than workspace.max_tilt",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_what_tells_no_tilt_says_why(overrides: tuple[str, ...], kept: slice, why: str) -> None:
    """Nothing is taken, and what was stated stays."""
    dwells = drawn_dwells(3, (DEGREE, 0.0), configured())[kept]
    config = configured(*overrides, 'replay.tilt=["0.5 deg", "0 deg"]')
    found = with_found_tilt(dwells, inputs_of(config), config)
    assert all(value.value is None and why in value.basis for value in found.values)
    assert found.inputs.tilt_rad == (0.5 * DEGREE, 0.0)


def test_moments_are_taken_about_the_tip() -> None:
    """A side force at the tip is no tilt, however far the cell's point is from it."""
    config = configured('force_sensor.to_tip="80 mm"')
    dwells = drawn_dwells(21, (0.8 * DEGREE, -0.6 * DEGREE), configured())[1::2]
    near, _ = tilt_of(dwells, inputs_of(config), configured())
    moved_dwells = [(record, _about(wrench, 0.08)) for record, wrench in dwells]
    far, _ = tilt_of(moved_dwells, inputs_of(config), config)
    assert near is not None
    assert far is not None
    assert far.tilt_rad == pytest.approx(near.tilt_rad, abs=0.05 * DEGREE)
    # Cross talk of half a per cent would be 0.4 mm on that lever.
    assert far.arm_m == pytest.approx(near.arm_m, abs=2e-5)


def _about(
    wrench: tuple[np.ndarray, np.ndarray] | None, above_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return a wrench of the emulated cell, its z up, about a point above the tip."""
    assert wrench is not None
    mean, error = wrench[0].copy(), wrench[1]
    mean[3:] += np.cross([0.0, 0.0, -above_m], mean[:3])
    return mean, error


def test_a_stated_pose_is_taken_as_it_is() -> None:
    """Nothing is looked for."""
    config = configured("replay.pose=stated", 'replay.tilt=["0.5 deg", "0 deg"]')
    unread: list[Dwell] = []
    found = with_found_tilt(unread, inputs_of(config), config)
    assert found.inputs == inputs_of(config)
    assert found.values == found.effects == ()


def test_a_tilt_begins_deeper() -> None:
    """Depth counts from the first touch, which a tilted face has off the middle of the dome."""
    config = configured('replay.tilt=["1 deg", "0 deg"]')
    curve = ForceDepthCurve(depth_m=np.array([0.0, 2e-4, 4e-4]), force_n=np.array([0.0, 1.2, 2.5]))
    shifted = tilted_curve(curve, inputs_of(config))
    assert shifted is not None
    extra = shifted.depth_m[1:] - curve.depth_m[1:]
    # The dome's radius along x is 185 mm: touched R l^2 / 2 = 28 um earlier.
    assert np.all((extra > 1.5e-5) & (extra < 3.5e-5))
    assert shifted.depth_m[0] == 0.0


def _attempts(shift_px: float) -> list[SimpleNamespace]:
    """Return trials with a dark disc, seen beside where it is simulated."""
    rows, columns = np.mgrid[:240, :320]

    def disc(beside: float) -> np.ndarray:
        far = np.hypot(columns - 160.0 - beside, rows - 120.0) - 40.0
        dark = 60.0 / (1.0 + np.exp(far / 3.0))
        return np.repeat(np.rint(160.0 - dark)[..., None], 3, axis=2).astype(np.uint8)

    reference = np.full((240, 320, 3), 160, np.uint8)
    seen = SimpleNamespace(real=disc(shift_px), reference=reference)
    return [
        SimpleNamespace(record=SimpleNamespace(index=k), images=seen, made=disc(0.0))
        for k in (1, 2, 3)
    ]


@pytest.mark.parametrize(("shift_px", "taken"), [(3.0, True), (0.3, False)])
def test_a_place_beyond_what_the_arm_repeats_to_is_found(shift_px: float, taken: bool) -> None:
    """Three pixels are 0.19 mm; a third of one, rounded to 8 bits, is within the arm's 0.03 mm.

    One image tells nothing: a scatter takes two.
    """
    config, camera = configured(), load_sensor("gelsight-mini").camera
    attempts = _attempts(shift_px)
    images = {each.record.index: each.made for each in attempts}
    values = find_offset(attempts, images, camera, config)  # type: ignore[arg-type]
    assert values[0].value == pytest.approx(shift_px * camera.scale_x_m, abs=4e-6)
    assert values[1].value == pytest.approx(0.0, abs=2e-6)
    beside = offset_of(values)
    assert (beside is not None) is taken
    if beside is not None:
        x, y = inputs_of(config).moved(beside).offset_m
        assert (x, y) == pytest.approx(beside)
    alone = find_offset(attempts[:1], images, camera, config)  # type: ignore[arg-type]
    assert offset_of(alone) is None
    assert "at least two are needed" in alone[0].basis
