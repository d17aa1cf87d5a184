"""Checks that every device is present, ready and fast enough; nothing moves or is set."""

import itertools
import math
import os
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from drivers.arm.ur5_controller_check import probe_controller, require_ready
from drivers.interfaces import MANUAL_EXPOSURE, Arm, DeviceIdentity, StreamHealth
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.doctor_check import (
    CheckResult,
    CheckStatus,
    checked,
    failed,
    judged,
    passed,
    skipped,
)
from tacauchy_rig.core.errors import DeviceError, RigError
from tacauchy_rig.core.registry import Kind, load
from tacauchy_rig.core.run import FZ, ForceSample, ImageFrame

_GOOD_TIMER_MS = 1
_FORCE_RATE_TOLERANCE = 0.02
_IMAGE_RATE_TOLERANCE = 0.05


def require_devices(config: RigConfig) -> None:
    """Ask the arm's controller, see a frame of the force sensor and one of the camera.

    Devices that the run itself starts are passed over.

    Raises:
        DeviceError: One or more do not answer; each is named with what to do.
    """
    errors = []
    for kind, section, others in (
        (Kind.ARM, config.robot, ()),
        (Kind.FORCE_SENSOR, config.force_sensor, (None,)),
        (Kind.CAMERA, config.camera, ()),
    ):
        try:
            if section.is_real and section.driver == "ur5":
                report = probe_controller(config.robot.host, timeout_s=config.robot.connect_timeout)
                require_ready(report, model=config.robot.model)
            elif section.is_real:
                device = load(kind, section.driver)(config, *others)
                with _connected(device):
                    if kind is Kind.ARM:  # which may refuse only now
                        device.state()
        except RigError as error:
            errors.append(str(error))  # with its own remedy below it
    if errors:
        raise DeviceError("\n".join(errors))


@contextmanager
def _connected(device: Any) -> Iterator[DeviceIdentity]:
    """Connect a device for a while."""
    try:
        yield device.connect()
    finally:
        device.close()


def device_checks(config: RigConfig, *, measure_s: float = 2.0) -> list[CheckResult]:
    """Check every real device; never raises, because what is wrong is the result.

    Args:
        measure_s: How long each stream is measured [s].
    """
    checks: dict[str, Callable[[], list[CheckResult]]] = {
        "robot": lambda: robot_checks(config),
        "force_sensor": lambda: _force_sensor_checks(config, measure_s),
        "camera": lambda: _camera_checks(config, measure_s),
    }
    results: list[CheckResult] = []
    for name, check in checks.items():
        device = getattr(config, name)
        reason = f'driver = "{device.driver}": it starts with the run, there is nothing to check'
        results += check() if device.is_real else [skipped(name, reason)]
    return results


def robot_checks(config: RigConfig) -> list[CheckResult]:
    """Return ``robot.controller`` and ``robot.home``, of a UR also ``robot.ready``."""
    robot = config.robot
    later = ["robot.ready", "robot.home"] if robot.driver == "ur5" else ["robot.home"]
    try:
        if robot.driver != "ur5":
            # An arm of another package checks for itself whether it is ready.
            arm: Arm = load(Kind.ARM, robot.driver)(config)
            with _connected(arm) as identity:
                home = _home_check(config, arm.state().pose.position)
            return [passed("robot.controller", f"{identity.model} at {identity.address}"), home]
        report = probe_controller(robot.host, timeout_s=robot.connect_timeout)
    except RigError as error:
        unknown = [skipped(name, "no controller answers") for name in later]
        return [failed("robot.controller", error), *unknown]
    finding = (
        f"{report.model.value}, software {report.version_text}, serial number "
        f"{report.serial or 'unknown'}, answered everything in {report.probe_s * 1e3:.0f} ms"
    )

    def ready() -> str:
        require_ready(report, model=robot.model)
        return "powered, in remote control, free, no safety stop"

    return [
        passed("robot.controller", finding, value=report.probe_s * 1e3, unit="ms"),
        checked("robot.ready", ready),
        _home_check(config, report.pose),
    ]


def _home_check(config: RigConfig, pose: Sequence[float]) -> CheckResult:
    distance_m = math.dist(pose[:3], config.robot.home)
    position = ", ".join(f"{value * 1e3:.1f}" for value in pose[:3])
    return judged(
        "robot.home",
        f"the tip is at ({position}) mm, {distance_m * 1e3:.1f} mm from home",
        is_good=distance_m <= config.workspace.home_radius,
        value=distance_m * 1e3,
        unit="mm",
        remedy=f"jog the tip to within {config.workspace.home_radius * 1e3:g} mm of robot.home, or "
        "correct robot.home and the pendant's tool centre point",
    )


def _force_sensor_checks(config: RigConfig, measure_s: float) -> list[CheckResult]:
    """Return the checks of the serial port and of ``measure_s`` [s] of unloaded samples."""
    section = config.force_sensor
    sensor = load(Kind.FORCE_SENSOR, section.driver)(config, None)
    try:
        with _connected(sensor) as identity:
            # While the port is open: the driver has asked the adapter for low latency by now.
            timer = latency_timer_check(section.port)
            time.sleep(measure_s)
            samples, health = sensor.drain(), sensor.health()
    except RigError as error:
        return [failed("force_sensor.stream", error)]
    return [
        passed("force_sensor.stream", f"{identity.model} at {_place(identity)}"),
        timer,
        _force_rate_check(samples, health, asked_hz=section.rate),
        _noise_check(samples, config),
    ]


def _place(identity: DeviceIdentity, more: str = "") -> str:
    settings = ", ".join(f"{key} {value}" for key, value in identity.settings.items())
    return f"{identity.address}{more}{': ' if settings else ''}{settings}"


def latency_timer_check(port: str, *, sys_folder: Path = Path("/sys")) -> CheckResult:
    """Judge how long the USB adapter holds bytes back before it sends them on."""
    name = "force_sensor.latency_timer"
    adapter = Path(os.path.realpath(port)).name
    path = sys_folder / "bus/usb-serial/devices" / adapter / "latency_timer"
    try:
        timer_ms = int(path.read_text("ascii"))
    except (OSError, ValueError):
        return skipped(name, f"{port} is not a USB adapter with a latency timer")
    return judged(
        name,
        f"{adapter} holds data back for up to {timer_ms} ms; more than {_GOOD_TIMER_MS} ms bunches "
        "the frames",
        is_good=timer_ms <= _GOOD_TIMER_MS,
        value=timer_ms,
        unit="ms",
        remedy=f"echo {_GOOD_TIMER_MS} | sudo tee {path}",
    )


def _force_rate_check(
    samples: list[ForceSample], health: StreamHealth, *, asked_hz: float
) -> CheckResult:
    """Judge rate, losses and bunching."""
    gaps = [b.stamp_ns - a.stamp_ns for a, b in itertools.pairwise(samples)]
    wrong = abs(health.rate_hz / asked_hz - 1.0) > _FORCE_RATE_TOLERANCE
    return judged(
        "force_sensor.rate",
        f"{health.rate_hz:.2f} Hz for {asked_hz:g} Hz asked, longest gap "
        f"{max(gaps, default=0) * 1e-6:.1f} ms, {health.lost_count} lost and "
        f"{health.corrupt_count} damaged of {health.received_count}",
        is_good=not (wrong or health.lost_count or health.corrupt_count),
        value=health.rate_hz,
        unit="Hz",
        remedy="check cable and shield, the adapter's latency timer, and the rate set in the box",
    )


def _noise_check(samples: list[ForceSample], config: RigConfig) -> CheckResult:
    """Judge zero and noise of Fz; the sensor is taken to be unloaded."""
    name = "force_sensor.noise"
    values = [sample.wrench[FZ] for sample in samples]
    if len(values) < 2:
        return skipped(name, f"{len(values)} samples are too few")
    mean, deviation = statistics.fmean(values), statistics.stdev(values)
    finding = f"Fz {mean:+.4f} N with {deviation:.4f} N of noise (standard deviation)"
    most, zero = config.protocol.tare_deviation, config.protocol.tare_mean
    remedies = {
        f"noise is above protocol.tare_deviation {most:g} N: keep the arm still, check shield and "
        "earth": deviation > most,
        f"zero is beyond protocol.tare_mean {zero:g} N: unload the sensor, or zero it in the box "
        "(AT+ADJZF)": abs(mean) > zero,
        "a live sensor has noise: switch the box off and on": deviation == 0.0,
    }
    remedy = next((text for text, is_so in remedies.items() if is_so), "")
    return judged(name, finding, is_good=not remedy, value=deviation, unit="N", remedy=remedy)


def _camera_checks(config: RigConfig, measure_s: float) -> list[CheckResult]:
    """Return the checks of the camera's mode and of ``measure_s`` [s] of frames."""
    section = config.camera
    camera = load(Kind.CAMERA, section.driver)(config)
    try:
        with _connected(camera) as identity:
            time.sleep(measure_s)
            frames, health = camera.drain(), camera.health()
    except RigError as error:
        return [failed("camera.stream", error)]
    size = f", {section.width}x{section.height} px"
    return [
        passed("camera.stream", f"{identity.model} at {_place(identity, size)}"),
        _image_rate_check(frames, health, config),
        exposure_check(identity.settings),
    ]


def _image_rate_check(
    frames: list[ImageFrame], health: StreamHealth, config: RigConfig
) -> CheckResult:
    """Judge the rate that was reached, by the configuration and by the protocol's least."""
    asked, least = config.camera.rate, config.protocol.min_image_rate
    size = sum(len(frame.jpeg) for frame in frames) / max(len(frames), 1)
    status, remedy = CheckStatus.OK, ""
    if health.rate_hz < least:
        status = CheckStatus.FAIL
        remedy = f"protocol.min_image_rate is {least:g} fps: lower it or the image size; use a "
        remedy += "USB port of its own, and a shorter exposure"
    elif health.rate_hz < asked * (1.0 - _IMAGE_RATE_TOLERANCE) or health.corrupt_count:
        status = CheckStatus.WARN
        remedy = "use a USB port of its own and a shorter exposure, or set camera.rate to what is "
        remedy += "reached"
    return CheckResult(
        name="camera.rate",
        status=status,
        finding=f"{health.rate_hz:.2f} fps for {asked:g} fps asked, {size / 1e3:.0f} kB a frame, "
        f"{health.corrupt_count} damaged of {health.received_count + health.corrupt_count}",
        value=health.rate_hz,
        unit="fps",
        remedy=remedy,
    )


def exposure_check(settings: dict[str, str]) -> CheckResult:
    """Judge whether the exposure is locked; an automatic one changes what a press looks like."""
    name = "camera.exposure"
    if "auto_exposure" not in settings:
        return skipped(name, "a stream has no exposure to set")
    if float(settings["exposure"]) < 0.0:
        return skipped(name, "the camera has no control of its exposure")
    is_locked = float(settings["auto_exposure"]) == MANUAL_EXPOSURE
    found = f"{settings['exposure']}, gain {settings['gain']}"
    return judged(
        name,
        f"locked at {found}" if is_locked else f"is automatic (now {found})",
        is_good=is_locked,
        remedy="set camera.exposure, camera.gain and camera.white_balance to fixed values",
    )
