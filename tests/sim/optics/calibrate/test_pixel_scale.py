"""Scale, rotation and centre, from presses at known positions and from printed targets."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.optics.calibrate.pixel_scale import (
    DotTarget,
    ScaleFit,
    ScaleTarget,
    find_target,
    fit_scale,
    parse_target,
    read_positions,
)
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.errors import ConfigError
from tests.sim.optics.rendered_targets import photograph, printed_board, printed_dots

PLACES = np.random.default_rng(3).uniform(-6e-3, 6e-3, (12, 2))


@given(
    scale_x=st.floats(3e-5, 1e-4),
    scale_y=st.floats(3e-5, 1e-4),
    rotation=st.floats(-3.0, 3.0),
    mirrored=st.booleans(),
    column=st.floats(100.0, 220.0),
)
def test_any_geometry_is_recovered(
    scale_x: float, scale_y: float, rotation: float, mirrored: bool, column: float
) -> None:
    """Exact centres give the geometry back, mirrored or not."""
    true = CameraGeometry(
        width=320,
        height=240,
        scale_x_m=scale_x,
        scale_y_m=scale_y,
        centre_x_px=column,
        centre_y_px=117.0,
        rotation_rad=rotation,
        mirrored=mirrored,
    )
    fit = fit_scale(PLACES, true.to_pixels(PLACES), width=320, height=240)
    assert fit.residual_px < 1e-6
    assert fit.geometry.mirrored is mirrored
    assert fit.geometry.to_pixels(PLACES) == pytest.approx(true.to_pixels(PLACES), abs=1e-6)


_LINE = np.linspace(-1e-3, 1e-3, 12)[:, None] * (1.0, 1.0)


@pytest.mark.parametrize(
    ("places", "pixels", "message"),
    [
        (PLACES[:3], PLACES[:3] * 1e4, "3 presses"),
        (_LINE, _LINE * 1e5, "one line in the image"),
        (_LINE, PLACES * 2e4, "all places lie on one line on the gel"),
        (np.zeros((12, 2)), PLACES * 2e4, "all places lie on one line on the gel"),
    ],
)
def test_presses_that_fix_no_scale_are_refused(
    places: np.ndarray, pixels: np.ndarray, message: str
) -> None:
    """Three points leave nothing to judge by; a line, here or there, fixes no second scale."""
    with pytest.raises(ConfigError, match=message):
        fit_scale(places, pixels, width=320, height=240)


@pytest.mark.parametrize("value", ["nan", "inf"])
def test_a_place_that_is_none_is_refused(tmp_path: Path, value: str) -> None:
    """The message names the line."""
    (tmp_path / "positions.csv").write_text(f"image,x_m,y_m\na.png,{value},0\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=rf"positions.csv, line 2: x_m is {value}"):
        read_positions(tmp_path / "positions.csv")


CHARUCO = parse_target("charuco:columns=8,rows=6,square=2mm,marker=1.5mm")
ARUCO = parse_target("aruco:columns=5,rows=4,marker=2.2mm,gap=0.8mm,dictionary=4X4_50")
DOTS = parse_target("dots:columns=7,rows=5,pitch=2mm")


def _camera(*, rotation_deg: float = 3.0, mirrored: bool = False) -> CameraGeometry:
    return CameraGeometry(
        width=320,
        height=240,
        scale_x_m=6.34e-5,
        scale_y_m=6.21e-5,
        centre_x_px=163.3,
        centre_y_px=117.8,
        rotation_rad=math.radians(rotation_deg),
        mirrored=mirrored,
    )


def _fit(target: ScaleTarget, image: ImageArray) -> ScaleFit:
    found = find_target(target, image, name="target.png")
    return fit_scale(found.positions_m, found.pixels, width=320, height=240)


def _print_of(target: ScaleTarget) -> np.ndarray:
    if isinstance(target, DotTarget):
        return printed_dots(
            columns=target.columns, rows=target.rows, pitch_m=target.pitch, radius_m=4e-4
        )
    return printed_board(target.board)


@pytest.mark.parametrize("target", [CHARUCO, ARUCO, DOTS], ids=["charuco", "aruco", "dots"])
@pytest.mark.parametrize(("blur_px", "noise"), [(0.0, 0.0), (0.8, 4.0)], ids=["clean", "noisy"])
def test_camera_is_recovered(target: ScaleTarget, blur_px: float, noise: float) -> None:
    """Scales to 0.2 %, rotation to 0.1 degrees and the centre to 0.15 px."""
    true = _camera()
    fit = _fit(target, photograph(_print_of(target), true, blur_px=blur_px, noise=noise))
    assert fit.geometry.scale_x_m == pytest.approx(true.scale_x_m, rel=2e-3)
    assert fit.geometry.scale_y_m == pytest.approx(true.scale_y_m, rel=2e-3)
    assert math.degrees(fit.geometry.rotation_rad) == pytest.approx(3.0, abs=0.1)
    assert fit.geometry.centre_x_px == pytest.approx(163.3, abs=0.15)
    assert fit.geometry.centre_y_px == pytest.approx(117.8, abs=0.15)
    assert fit.residual_px < 0.5
    assert not fit.geometry.mirrored


@pytest.mark.parametrize("target", [CHARUCO, ARUCO], ids=["charuco", "aruco"])
def test_mirrored_target_is_recognised(target: ScaleTarget) -> None:
    """A board seen through a mirror is found, and the geometry says so."""
    true = _camera(mirrored=True)
    fit = _fit(target, photograph(_print_of(target), true, blur_px=0.5, noise=2.0))
    assert fit.geometry.mirrored
    corners = np.array([[-4e-3, -3e-3], [4e-3, 3e-3], [0.0, 0.0]])
    np.testing.assert_allclose(
        fit.geometry.to_pixels(corners), true.to_pixels(corners), rtol=0, atol=0.3
    )


def test_stated_errors_cover_the_truth() -> None:
    """Over noisy images the scale's departure is of the size of its stated error."""
    ratios = []
    for seed in range(6):
        image = photograph(_print_of(CHARUCO), _camera(), blur_px=0.5, noise=5.0, seed=seed)
        fit = _fit(CHARUCO, image)
        ratios.append((fit.geometry.scale_x_m - 6.34e-5) / fit.scale_error_m[0])
    assert np.abs(ratios).max() < 5.0
    assert np.sqrt(np.mean(np.square(ratios))) > 0.2


def test_blank_image_is_refused() -> None:
    """No target: the message counts what was found and names the image."""
    blank = np.full((240, 320), 128, np.uint8)
    for target, wanted in ((CHARUCO, 35), (ARUCO, 80), (DOTS, 35)):
        with pytest.raises(
            ConfigError, match=rf"blank.png shows 0 of the target's {wanted} points"
        ):
            find_target(target, blank, name="blank.png")


def test_missing_dot_is_refused() -> None:
    """A grid with a dot too few is not guessed at."""
    printed = printed_dots(columns=7, rows=5, pitch_m=2e-3, radius_m=4e-4)
    printed[: printed.shape[0] // 4, : printed.shape[1] // 5] = 255
    image = photograph(printed, _camera(), blur_px=0.3, noise=1.0)
    with pytest.raises(ConfigError, match="0 of the target's 35 points"):
        find_target(DOTS, image, name="dots.png")


def test_a_grid_of_more_dots_is_refused() -> None:
    """A part of a larger grid is not taken for the grid that was asked for."""
    printed = printed_dots(columns=8, rows=5, pitch_m=1.6e-3, radius_m=4e-4)
    image = photograph(printed, _camera(), blur_px=0.3, noise=1.0)
    with pytest.raises(ConfigError, match="0 of the target's 35 points"):
        find_target(DOTS, image, name="dots.png")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("rings:n=3", "no such target"),
        ("dots:columns=7,rows=5", "missing or unknown: pitch"),
        ("dots:columns=7,rows=1,pitch=2mm", "rows '1' is not a whole number above 1"),
        ("dots:columns=7,rows=5,pitch=2", "has no unit"),
        ("charuco:columns=8,rows=6,square=1mm,marker=1.5mm", "is not smaller than square"),
        ("dots:columns=7,rows=5,pitch=2mm,dictionary=x", "missing or unknown: dictionary"),
        (
            "aruco:columns=5,rows=4,marker=2mm,gap=1mm,dictionary=9X9_1",
            "no ArUco dictionary '9X9_1'",
        ),
    ],
)
def test_wrong_targets_are_refused(text: str, message: str) -> None:
    """What is missing or wrong is named."""
    with pytest.raises(ConfigError, match=message):
        parse_target(text)
