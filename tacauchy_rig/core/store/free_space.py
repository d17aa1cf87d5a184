"""Is there room for a session? Asked before the arm moves, not found out during a press."""

from dataclasses import dataclass
from pathlib import Path

from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.atomic_write import free_bytes
from tacauchy_rig.core.store.run_files import read_error

FORCE_MESSAGE_BYTES = 280
"""Of one force sample in a recording, its share of the index included; a test measures it."""

ARM_MESSAGE_BYTES = 350
"""Of one state of the arm, likewise."""

JPEG_BYTES_PER_PIXEL = 0.25
"""A generous JPEG; a gel's smooth image takes about 0.1 (0.84 MB at 3280x2464)."""

_MARGIN_BYTES = 200e6


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionEstimate:
    """What a session is expected to record."""

    trial_s: float  # recorded time of one attempt, each step at its full length [s]
    rate_bytes_s: float  # while recording [bytes/s]
    total_bytes: float  # of one attempt at each trial and one attempt more, with a margin


def estimate_session(config: RigConfig) -> SessionEstimate:
    """Estimate what the configured session will record."""
    trial_s = _trial_duration_s(config)
    camera = config.camera
    rate = (
        camera.rate * camera.width * camera.height * JPEG_BYTES_PER_PIXEL
        + config.robot.model.rate_hz * ARM_MESSAGE_BYTES
        + config.force_sensor.rate * FORCE_MESSAGE_BYTES
    )
    attempts = len(config.protocol.force_targets) + 1
    total = attempts * trial_s * rate + _MARGIN_BYTES
    return SessionEstimate(trial_s=trial_s, rate_bytes_s=rate, total_bytes=total)


def check_free_space(folder: Path, config: RigConfig) -> SessionEstimate:
    """Return the estimate if the disk under ``folder`` has room for it."""
    estimate, camera = estimate_session(config), config.camera
    try:
        free = free_bytes(folder)
    except OSError as error:
        raise read_error(folder, error, what="the output directory") from error
    if free < estimate.total_bytes:
        raise RecordError(
            f"{folder}: {_size(free)} free, but this session may record "
            f"{_size(estimate.total_bytes)} ({len(config.protocol.force_targets)} trials of up to "
            f"{estimate.trial_s:.0f} s at {_size(estimate.rate_bytes_s)}/s, mostly "
            f"{camera.width}x{camera.height} images at {camera.rate:g} Hz)",
            remedy="free some space, set run.output_directory to a larger disk, "
            "or lower camera.width and camera.height",
        )
    return estimate


def _trial_duration_s(config: RigConfig) -> float:
    robot, protocol, limits = config.robot, config.protocol, config.limits
    height = abs(robot.home[2] - config.sensor.surface[2])
    press = limits.max_depth / robot.press_speed + protocol.settle_timeout
    return (
        2 * protocol.tare_duration
        + protocol.reference_duration
        + height / robot.approach_speed
        + protocol.search_travel / robot.search_speed
        + min(press, protocol.press_timeout)
        + protocol.dwell_duration
        + height / robot.retract_speed
    )


def _size(count: float) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.1f} MB"
