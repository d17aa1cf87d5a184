"""Doctor's look at the devices: what it says of good ones, bad ones and absent ones."""

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from drivers.device_checks import (
    _image_rate_check,
    device_checks,
    exposure_check,
    latency_timer_check,
    require_devices,
)
from drivers.interfaces import StreamHealth
from tacauchy_rig.core.config.load import load_config, restore_config
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.doctor_check import CheckResult, CheckStatus
from tacauchy_rig.core.errors import DeviceError
from tests.drivers.conftest import changed

RunBox = Callable[..., AbstractContextManager[str]]
ServeMjpeg = Callable[..., AbstractContextManager[str]]


def configured(**values: str) -> RigConfig:
    """Return the defaults with fields such as ``force_sensor__port`` replaced.

    A real arm has the dry run's places here, which no file of an operator may leave out.
    """
    return restore_config({name.replace("__", "."): value for name, value in values.items()})


def checked(config: RigConfig, *, measure_s: float = 0.5) -> Mapping[str, CheckResult]:
    """Return the results by name."""
    return {result.name: result for result in device_checks(config, measure_s=measure_s)}


def test_dry_run_has_nothing_to_check() -> None:
    """Devices that start with the run are skipped, in words."""
    results = checked(configured())
    assert set(results) == {"robot", "force_sensor", "camera"}
    assert {result.status for result in results.values()} == {CheckStatus.SKIP}


def force_sensor(port: str) -> RigConfig:
    """Return a configuration with the force sensor alone real."""
    return configured(
        force_sensor__driver="m3733c",
        force_sensor__port=port,
        force_sensor__calibration_sheet="test",
    )


def test_live_force_sensor_is_measured(run_box: RunBox, tmp_path: Path) -> None:
    """Rate and noise of a live sensor are told with their units."""
    with run_box(tmp_path, noise_n=0.004) as port:
        results = checked(force_sensor(port))
    rate, noise = results["force_sensor.rate"], results["force_sensor.noise"]
    assert rate.value == pytest.approx(100.0, rel=0.05)
    assert (noise.status, noise.unit) == (CheckStatus.OK, "N")
    assert noise.value == pytest.approx(0.004, rel=0.5)
    assert results["force_sensor.latency_timer"].status is CheckStatus.SKIP


def test_loaded_and_noisy_force_sensors_are_warned_of(run_box: RunBox, tmp_path: Path) -> None:
    """A zero or a noise that the tare would refuse is seen before a run."""
    with run_box(tmp_path, load=(0.0, 0.0, 9.0)) as port:
        loaded = checked(force_sensor(port))["force_sensor.noise"]
    with run_box(tmp_path, noise_n=0.2) as port:
        noisy = checked(force_sensor(port))["force_sensor.noise"]
    assert loaded.status is noisy.status is CheckStatus.WARN
    assert "tare_mean" in loaded.remedy
    assert "tare_deviation" in noisy.remedy


def absent(port: str) -> RigConfig:
    """Return a configuration of real devices that are not there."""
    return configured(
        robot__driver="ur5",
        robot__host="127.0.0.99",
        force_sensor__driver="m3733c",
        force_sensor__port=port,
        force_sensor__calibration_sheet="test",
        camera__driver="uvc",
        camera__device="No Such Camera",
    )


def test_absent_devices_fail_with_a_remedy() -> None:
    """Nothing plugged in: every check fails or is skipped, none raises."""
    results = checked(absent("/dev/ttyUSB77"))
    for name in ("robot.controller", "force_sensor.stream", "camera.stream"):
        assert results[name].status is CheckStatus.FAIL, name
        assert results[name].remedy, name
    assert results["robot.ready"].status is CheckStatus.SKIP


@pytest.mark.parametrize(
    ("timer", "status"), [("16", CheckStatus.WARN), ("1", CheckStatus.OK), (None, CheckStatus.SKIP)]
)
def test_latency_timer(tmp_path: Path, timer: str | None, status: CheckStatus) -> None:
    """An FTDI adapter at its default of 16 ms gets the command that cures it."""
    device = tmp_path / "dev" / "ttyUSB3"
    device.parent.mkdir()
    device.touch()
    link = tmp_path / "by-id"
    link.symlink_to(device)
    folder = tmp_path / "sys/bus/usb-serial/devices/ttyUSB3"
    folder.mkdir(parents=True)
    if timer is not None:
        (folder / "latency_timer").write_text(f"{timer}\n")
    result = latency_timer_check(str(link), sys_folder=tmp_path / "sys")
    assert result.status is status
    if status is CheckStatus.WARN:
        assert result.remedy == f"echo 1 | sudo tee {folder / 'latency_timer'}"


def noise_frames(ended: threading.Event) -> Iterator[bytes]:
    """Yield 320x240 images at about 30 fps."""
    source = np.random.default_rng(5)
    while not ended.wait(1 / 30):
        image = source.integers(0, 255, (240, 320, 3), dtype=np.uint8)
        yield cv2.imencode(".jpg", image)[1].tobytes()


def camera(url: str, rate: str) -> RigConfig:
    """Return a configuration with the camera alone real."""
    return configured(
        camera__driver="uvc",
        camera__device=url,
        camera__width="320",
        camera__height="240",
        camera__rate=rate,
        protocol__min_image_rate="5 fps",
    )


def test_live_camera_is_measured(serve_mjpeg: ServeMjpeg) -> None:
    """The rate that is reached is told, not the one advertised."""
    with serve_mjpeg(noise_frames) as url:
        results = checked(camera(url, "60 fps"))
    rate = results["camera.rate"]
    assert rate.status is CheckStatus.WARN
    assert rate.value is not None
    assert 5 < rate.value < 40
    assert "for 60 fps asked" in rate.finding
    assert results["camera.stream"].status is CheckStatus.OK
    assert results["camera.exposure"].status is CheckStatus.SKIP


def test_camera_below_the_protocols_least_rate_fails(serve_mjpeg: ServeMjpeg) -> None:
    """A camera too slow for the protocol is a failure with what to change."""
    with serve_mjpeg(noise_frames) as url:
        config = camera(url, "60 fps")
        protocol = config.protocol.model_copy(update={"min_image_rate": 55.0})
        result = checked(config.model_copy(update={"protocol": protocol}))["camera.rate"]
    assert result.status is CheckStatus.FAIL
    assert "min_image_rate" in result.remedy


def test_automatic_exposure_is_warned_of() -> None:
    """V4L2's automatic exposure is told; a locked one is fine."""
    settings = {"auto_exposure": "3", "exposure": "156", "gain": "0"}
    absent = {"auto_exposure": "-1", "exposure": "-1", "gain": "0"}
    assert exposure_check(absent).status is CheckStatus.SKIP
    assert exposure_check(settings).status is CheckStatus.WARN
    assert exposure_check({**settings, "auto_exposure": "1"}).status is CheckStatus.OK


def test_controller_is_asked_who_it_is(emulate_ur: Callable[..., Any]) -> None:
    """A controller that is ready and at home passes; another generation is refused."""
    host = emulate_ur(home=(0.0, -0.4, 0.23)).host
    results = checked(configured(robot__driver="ur5", robot__host=host))
    assert results["robot.controller"].status is CheckStatus.OK
    assert "e-series, software 5." in results["robot.controller"].finding
    assert results["robot.ready"].status is CheckStatus.OK
    assert results["robot.home"].status is CheckStatus.OK
    other = checked(configured(robot__driver="ur5", robot__host=host, robot__model="cb3"))
    assert other["robot.ready"].status is CheckStatus.FAIL


def test_all_that_is_missing_is_told_together(tmp_path: Path) -> None:
    """A person who has three cables to plug in is told of three."""
    gone = str(tmp_path / "ttyUSB7")
    with pytest.raises(DeviceError) as caught:
        require_devices(absent(gone))
    lines = [line for line in str(caught.value).split("\n") if not line.startswith("  -> ")]
    assert [line.split()[0].rstrip(":") for line in lines] == ["robot", "force", "camera"]
    assert gone in lines[1]
    assert str(caught.value).count("  -> ") == 3


def test_those_that_are_there_pass(emulate_ur, run_box, tmp_path: Path) -> None:
    """A ready controller and a streaming box answer, and are let go of again."""
    host = emulate_ur().host
    with run_box(tmp_path) as port:
        config = changed(force_sensor(port), robot={"driver": "ur5", "host": host})
        require_devices(config)
        require_devices(config)


@pytest.mark.parametrize(
    ("rate_hz", "status"),
    [
        (18.75, CheckStatus.OK),
        (18.7, CheckStatus.OK),
        (16.0, CheckStatus.WARN),
        (14.9, CheckStatus.FAIL),
    ],
)
def test_a_mini_is_judged_by_the_rate_that_it_delivers(rate_hz: float, status: CheckStatus) -> None:
    """It advertises 25 Hz; its sensor file asks for 18.75 Hz and says that 15 Hz suffice."""
    health = StreamHealth(received_count=40, rate_hz=rate_hz)
    result = _image_rate_check([], health, load_config().config)
    assert result.status is status
    assert "for 18.75 fps asked" in result.finding
