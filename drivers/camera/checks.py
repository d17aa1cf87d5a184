"""Checks of the camera: is it there in the mode asked, how fast is it really, what is automatic."""

from __future__ import annotations

import time

from drivers.camera.interface import Camera
from drivers.camera.uvc import MANUAL_EXPOSURE
from drivers.device.interface import StreamHealth
from tacauchy_rig.core.check_result import CheckResult, CheckStatus, failed, judged, passed, skipped
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.registry import Kind, load
from tacauchy_rig.core.run import ImageFrame

_RATE_TOLERANCE = 0.05


def camera_checks(config: RigConfig, *, measure_s: float) -> list[CheckResult]:
    """Return the checks of the camera's mode and of ``measure_s`` [s] of frames."""
    section = config.camera
    camera: Camera = load(Kind.CAMERA, section.driver)(config)
    try:
        identity = camera.connect()
        time.sleep(measure_s)
        frames, health = camera.drain(), camera.health()
    except DeviceError as error:
        return [failed("camera.stream", error)]
    finally:
        camera.close()
    mode = ", ".join(f"{key} {value}" for key, value in identity.settings.items())
    size = f"{section.width}x{section.height} px"
    return [
        passed("camera.stream", f"{identity.model} at {identity.address}, {size}: {mode}"),
        rate_check(frames, health, config=config),
        exposure_check(identity.settings),
    ]


def rate_check(frames: list[ImageFrame], health: StreamHealth, *, config: RigConfig) -> CheckResult:
    """Judge the rate that was reached, by the configuration and by the protocol's least."""
    asked, least = config.camera.rate, config.protocol.min_image_rate
    size = sum(len(frame.jpeg) for frame in frames) / max(len(frames), 1)
    finding = (
        f"{health.rate_hz:.2f} fps for {asked:g} fps asked, {size / 1e3:.0f} kB a frame, "
        f"{health.corrupt_count} damaged of {health.received_count + health.corrupt_count}"
    )
    status, remedy = CheckStatus.OK, ""
    if health.rate_hz < least:
        status = CheckStatus.FAIL
        remedy = f"protocol.min_image_rate is {least:g} fps: lower it or the image size; use a "
        remedy += "USB port of its own, and a shorter exposure"
    elif health.rate_hz < asked * (1.0 - _RATE_TOLERANCE) or health.corrupt_count:
        status = CheckStatus.WARN
        remedy = "use a USB port of its own and a shorter exposure, or set camera.rate to what is "
        remedy += "reached"
    return CheckResult(
        name="camera.rate",
        status=status,
        finding=finding,
        value=health.rate_hz,
        unit="fps",
        remedy=remedy,
    )


def exposure_check(settings: dict[str, str]) -> CheckResult:
    """Judge whether the exposure is locked; an automatic one changes what a press looks like."""
    name = "camera.exposure"
    if "auto_exposure" not in settings:
        return skipped(name, "a stream has no exposure to set")
    is_locked = float(settings["auto_exposure"]) == MANUAL_EXPOSURE
    found = f"{settings['exposure']}, gain {settings['gain']}"
    return judged(
        name,
        f"locked at {found}" if is_locked else f"is automatic (now {found})",
        is_good=is_locked,
        remedy="set camera.exposure, camera.gain and camera.white_balance to fixed values",
    )
