"""What a configuration says of the replay and its optics, checked before anything is pressed."""

import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from sim.effects.effect_choice import PRESET_TOLERANCE
from sim.optics.calibrate.ball_press import Circle
from sim.optics.calibrate.gel_profile import touching_places
from sim.optics.colour.nominal_optics import nominal_photometric
from sim.optics.colour.photometric import PhotometricModel
from sim.scene.indenter import describe
from sim.scene.scene import ContactMode, Preset
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.lamps_and_optics import Lamp
from sim.sensor.sensor import Sensor, load_sensor
from sim.tolerance import Tolerance
from tacauchy_rig.app.replay.chosen_optics import (
    VIEWED,
    OpticalCalibration,
    calibrated_optics,
    fitted_view,
    optics_of,
)
from tacauchy_rig.app.replay.simulator_inputs import check_optics, check_replay, inputs_of
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.time_limit_and_progress import heard
from tests.mock.real_time import load_mocks, mocks_installed
from tests.tacauchy_rig.app.importing.test_places import CUBE


def configured(*overrides: str) -> RigConfig:
    """Return the defaults with ``table.field=value`` overrides."""
    return load_config(overrides=overrides).config


def test_the_line_names_sensor_preset_and_tolerance() -> None:
    """What chooses the preset stands beside it."""
    assert check_replay(configured()).startswith("GelSight Mini, preset auto, optics")
    named = configured("replay.preset=accurate")
    assert check_replay(named).startswith("GelSight Mini, preset accurate, optics")
    assert "for a tolerance of 5% of F_z" in check_replay(configured("replay.tolerance=5%"))


def test_auto_is_the_cheapest_preset_that_promises_its_tolerance() -> None:
    """The mesh is chosen, and effects are left out as on the preset that it would be else.

    A preset or a tolerance that is given is not chosen anew.
    """
    settled = inputs_of(configured()).settled([1.0])
    scene = settled.scene([1.0])
    assert scene.preset is Preset.FAST
    assert 1.0 < scene.refinement < 2.2
    assert scene.tolerance == PRESET_TOLERANCE[Preset.BALANCED]
    assert str(settled.stated_accuracy) == "3% of F_z"
    assert settled.settled([4.0]) is settled
    for override in ("replay.preset=balanced", "replay.tolerance=5%"):
        given = inputs_of(configured(override))
        assert given.settled([1.0]) is given


def test_auto_is_a_named_preset_where_none_promises_its_tolerance(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A run is replayed all the same, and nothing is promised."""
    monkeypatch.setattr(
        "tacauchy_rig.app.replay.simulator_inputs.OF_AUTO", Tolerance(relative=1e-7)
    )
    settled = inputs_of(configured()).settled([1.0])
    scene = settled.scene([1.0])
    assert (scene.preset, scene.refinement, scene.tolerance) == (Preset.BALANCED, 1.0, None)
    assert settled.stated_accuracy is None


def test_the_line_names_the_calibration(tmp_path: Path) -> None:
    """A file that can be read is named; without one it is said what the images come from."""
    file = tmp_path / "calibration.npz"
    nominal_photometric([Lamp(azimuth_rad=0.0, elevation_rad=0.5, colour=(9.0, 0.0, 0.0))]).save(
        file
    )
    sensor = load_sensor("gelsight-mini")
    given = configured(f"sensor.optics_calibration={file}")
    assert check_optics(given, sensor) == f"optics from {file}"
    assert "emulated sensor" in check_optics(configured(), sensor)
    with mocks_installed():
        assert "not calibrated" in check_optics(load_mocks().config, sensor)


def test_what_the_replay_overrides_reaches_the_scene(tmp_path: Path) -> None:
    """Law, friction, tilt, place and triangles of a configuration are those of the scene."""
    cube = tmp_path / "cube.stl"
    cube.write_bytes(CUBE)
    config = configured(
        'replay.law="neo-hookean"',
        "replay.friction=0.3",
        'replay.tilt=["1 deg", "-0.5 deg"]',
        'replay.offset=["0.2 mm", "0 mm"]',
        f'replay.indenter="mesh:{cube},unit=mm"',
    )
    scene = inputs_of(config).scene([2.0])
    assert scene.material.law == "neo-hookean"
    assert (scene.contact, scene.friction) == (ContactMode.FRICTION, 0.3)
    assert scene.motion.tilt_rad == pytest.approx((math.radians(0.5), math.radians(1.0)))
    assert scene.centre_m == (0.2e-3, 0.0)
    assert describe(scene.indenter) == "mesh:cube.stl,unit=mm"


def test_relaxation_may_be_left_out(tmp_path: Path) -> None:
    """It comes from the sensor's file, and goes with one word."""
    text = (files("sim.sensor") / "files" / "gelsight-mini.toml").read_text()
    relaxing = '\n[[relaxation]]\nshare = "3 %"\ntime = "0.3 s"\nsource = "made up"\n'
    (tmp_path / "mine.toml").write_text(text + relaxing)
    named = f'sensor.name="{tmp_path / "mine.toml"}"'
    assert inputs_of(configured(named)).sensor.material.relaxation
    without = inputs_of(configured(named, "replay.relaxation=false"))
    assert without.sensor.material.relaxation == ()


@pytest.mark.parametrize(
    ("override", "told"),
    [
        ('replay.law="rubber"', "replay.law: 'rubber' is no law"),
        ('replay.indenter="cone:5mm"', "replay.indenter: 'cone:5mm': no such indenter"),
        ('replay.indenter="mesh:absent.stl"', "replay.indenter"),
        ('replay.friction="-0.1"', "replay.friction"),
        ('replay.tilt=["20 deg", "0 deg"]', "replay.tilt"),
        ('replay.pose="guessed"', "replay.pose"),
        ("sensor.optics_calibration=gone.npz", "gone.npz does not exist"),
        ("sensor.name=gelsight-maxi", "gelsight-maxi"),
        ("replay.preset=finest", "'finest' is no preset"),
        ("replay.drive=push", "'push' is no way to reach a force"),
        ("replay.tolerance=1 mm", "replay.tolerance"),
    ],
)
def test_what_cannot_be_replayed_is_refused_by_its_field(override: str, told: str) -> None:
    """Before anything is pressed, with a remedy."""
    with pytest.raises(ConfigError) as caught:
        check_replay(configured(override))
    assert told in caught.value.message
    assert caught.value.remedy


MINI = load_sensor("gelsight-mini")
VIEW = MINI.camera


def _calibration(tmp_path: Path, **provenance: object) -> str:
    made = {
        "width_px": VIEW.width,
        "height_px": VIEW.height,
        "scale_x_m_px": VIEW.scale_x_m,
        "scale_y_m_px": VIEW.scale_y_m,
        "blur_px": 0.7,
    }
    path = tmp_path / "calibration.npz"
    PhotometricModel(
        exponents=np.array([[1, 0, 0, 0, 0]]),
        coefficients=np.array([[30.0, 20.0, 10.0]]),
        provenance=made | provenance,
    ).save(path)
    return str(path)


def test_a_calibration_of_the_sensors_images_is_taken(tmp_path: Path) -> None:
    """Colours and blur come from the file, the view from the sensor's."""
    found = calibrated_optics(_calibration(tmp_path), MINI)
    assert found.blur_px == 0.7
    assert found.geometry == VIEW


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"width_px": 640, "height_px": 480}, r"of images of 640 x 480 px, .* at 320 x 240 px"),
        ({"scale_x_m_px": 2.0 * VIEW.scale_x_m}, r"0.1268 mm per pixel, .* says 0.0634 mm"),
    ],
)
def test_a_calibration_of_other_images_is_refused(
    tmp_path: Path, other: dict[str, object], message: str
) -> None:
    """Raw frames, or another sensor's: both sizes, both scales are named."""
    with pytest.raises(ConfigError, match=message):
        calibrated_optics(_calibration(tmp_path, **other), MINI)


def test_no_calibration_renders_what_cannot_be_calibrated(tmp_path: Path) -> None:
    """A renderer without terms to fit is refused another's colours, and is not fitted in a run."""
    renderer = replace(MINI.optics.renderer, exponents=None)
    sensor = replace(MINI, optics=replace(MINI.optics, renderer=renderer))
    with pytest.raises(ConfigError, match=r"optics\.kind photometric cannot be calibrated"):
        calibrated_optics(_calibration(tmp_path), sensor)

    def calibrate(_sensor: Sensor) -> OpticalCalibration:
        raise AssertionError

    said: list[str] = []
    with heard(said.append):
        found = optics_of("", sensor, calibrate=calibrate)
    assert found.model is sensor.optics.model
    assert "not calibrated" in said[0]


def test_a_scale_that_was_measured_anew_is_taken(tmp_path: Path) -> None:
    """A lab's own scale may differ from the file's by a few per cent."""
    given = _calibration(tmp_path, scale_x_m_px=1.02 * VIEW.scale_x_m)
    assert calibrated_optics(given, MINI).geometry == VIEW


PLACES_M = ((-4e-3, -3e-3), (5e-3, -2e-3), (3e-3, 4e-3), (-5e-3, 2e-3), (0.0, 1e-3))
MOVED = replace(
    VIEW, scale_x_m=1.01 * VIEW.scale_x_m, centre_x_px=163.0, centre_y_px=116.5, rotation_rad=4e-3
)


@pytest.mark.parametrize(
    ("seen", "places_m", "told"),
    [
        (MOVED, PLACES_M, ""),
        (replace(MOVED, scale_y_m=1.1 * VIEW.scale_y_m), PLACES_M, "contradict the stated scale"),
        (MOVED, [(x, 0.5 * x) for x, _ in PLACES_M], "lie on one line"),
    ],
)
def test_presses_at_known_places_tell_where_pixels_look(
    tmp_path: Path, seen: CameraGeometry, places_m: Sequence[tuple[float, float]], told: str
) -> None:
    """Balls are seen where they touch the dome; a replay with the calibration looks there, too."""
    touched_m = touching_places(np.array(places_m), MINI.pad, ball_radius_m=4e-3)
    pixels = seen.to_pixels(touched_m).tolist()
    circles = [Circle(x_px=x, y_px=y, radius_px=9.0) for x, y in pixels]
    pairs = list(zip(circles, places_m, strict=True))
    if told:
        with pytest.raises(ConfigError, match=told):
            fitted_view(pairs, VIEW, MINI.pad, ball_radius_m=4e-3)
        return
    fit, _ = fitted_view(pairs, VIEW, MINI.pad, ball_radius_m=4e-3)
    view = {name: getattr(fit.geometry, name) for name in VIEWED}
    found = calibrated_optics(_calibration(tmp_path, view=view), MINI).geometry
    assert asdict(found) == pytest.approx(asdict(seen), rel=1e-6)
