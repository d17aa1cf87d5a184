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
    limits, protocol, camera = config.limits, config.protocol, config.camera
    press_s = limits.max_depth / config.robot.press_speed + protocol.settle_timeout
    press_s = min(press_s, protocol.press_timeout)
    trial_s = trial_duration_s(config, search_m=protocol.search_travel, press_s=press_s)
    rate = (
        camera.rate * camera.width * camera.height * JPEG_BYTES_PER_PIXEL
        + config.robot.model.rate_hz * ARM_MESSAGE_BYTES
        + config.force_sensor.rate * FORCE_MESSAGE_BYTES
    )
    attempts = len(protocol.force_targets) + 1
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


def trial_duration_s(config: RigConfig, *, search_m: float, press_s: float) -> float:
    """Return how long a trial takes from home to home [s].

    Args:
        search_m: Way of the search down to the gel [m].
        press_s: From contact to the beginning of the dwell [s].
    """
    robot, protocol = config.robot, config.protocol
    height_m = abs(robot.home[2] - config.sensor.surface[2])
    return (
        2.0 * protocol.tare_duration
        + protocol.reference_duration
        + height_m / robot.approach_speed
        + search_m / robot.search_speed
        + press_s
        + protocol.dwell_duration
        + protocol.sway
        + height_m / robot.retract_speed
    )


def _size(count: float) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.1f} MB"
