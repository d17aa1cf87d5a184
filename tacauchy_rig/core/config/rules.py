"""Rules that tie fields of different tables together: limits that no rig could honour."""

from __future__ import annotations

from collections.abc import Iterator

from tacauchy_rig.core.config.model import RigConfig

OVERRUN_DELAY_S = 0.05
"""Reaction of the loop plus the arm's stop: about 50 ms, so 1 mm/s overruns by about 55 um."""
TOLERANCE_SHARE = 0.2
"""Of the lowest target; with more the presses of a series of six would overlap."""
BOX_SIDE_M = 0.5
"""Over one gel an arm needs a tenth of it; a wider box protects nothing."""


def broken_rules(config: RigConfig, *, placed: bool = True) -> Iterator[tuple[str, str, str]]:
    """Yield (field, problem with values and units, remedy) of each rule that does not hold.

    Args:
        config: The checked configuration.
        placed: Home, gel and workspace box are all known.
    """
    force_rules = (*_limit_rules(config), *_protocol_rules(config))
    yield from (rule[1:] for rule in force_rules if rule[0])
    if placed:
        yield from _workspace_rules(config)
        yield from _height_rules(config)
    yield from _device_rules(config)


def _limit_rules(config: RigConfig) -> tuple[tuple[bool, str, str, str], ...]:
    """Return what is wrong or not with the limits on force: where, why, and what to do."""
    limits, protocol, sensor = config.limits, config.protocol, config.force_sensor
    highest = max(protocol.force_targets)
    return (
        (
            limits.soft_force <= highest + protocol.force_tolerance,
            "limits.soft_force",
            (
                f"{limits.soft_force:g} N does not clear the highest target {highest:g} N "
                f"plus its tolerance {protocol.force_tolerance:g} N"
            ),
            "raise soft_force or lower the targets",
        ),
        (
            limits.hard_force <= limits.soft_force,
            "limits.hard_force",
            f"{limits.hard_force:g} N is not above soft_force {limits.soft_force:g} N",
            "raise hard_force",
        ),
        (
            limits.hard_force > sensor.capacity,
            "limits.hard_force",
            f"{limits.hard_force:g} N exceeds the force sensor's capacity {sensor.capacity:g} N",
            "lower hard_force, or correct force_sensor.capacity from the calibration sheet",
        ),
        (
            limits.lateral_force > limits.soft_force,
            "limits.lateral_force",
            (
                f"{limits.lateral_force:g} N is above soft_force {limits.soft_force:g} N: friction "
                "pulls sideways with less than what presses"
            ),
            "lower lateral_force",
        ),
    )


def _protocol_rules(config: RigConfig) -> tuple[tuple[bool, str, str, str], ...]:
    """Return what is wrong or not with targets and thresholds: where, why, and what to do."""
    limits, protocol = config.limits, config.protocol
    lowest = min(protocol.force_targets)
    image_rate_hz, force_rate_hz = config.camera.rate, config.force_sensor.rate
    return (
        (
            protocol.force_tolerance > TOLERANCE_SHARE * lowest,
            "protocol.force_tolerance",
            (
                f"{protocol.force_tolerance:g} N is more than {TOLERANCE_SHARE:.0%} of the lowest "
                f"target {lowest:g} N"
            ),
            "lower force_tolerance or raise the target",
        ),
        (
            lowest <= protocol.contact_force,
            "protocol.force_targets",
            f"{lowest:g} N is not above contact_force {protocol.contact_force:g} N",
            "raise the target or lower contact_force",
        ),
        (
            limits.early_contact <= protocol.contact_force,
            "limits.early_contact",
            f"{limits.early_contact:g} N is not above contact_force {protocol.contact_force:g} N",
            "raise early_contact",
        ),
        (
            protocol.tare_deviation >= protocol.contact_force,
            "protocol.tare_deviation",
            (
                f"{protocol.tare_deviation:g} N of allowed noise hides a contact of "
                f"{protocol.contact_force:g} N"
            ),
            "lower tare_deviation or raise contact_force",
        ),
        (
            image_rate_hz < protocol.min_image_rate,
            "camera.rate",
            (
                f"{image_rate_hz:g} fps is below protocol.min_image_rate "
                f"{protocol.min_image_rate:g} fps: every press would fail"
            ),
            "raise rate or lower min_image_rate",
        ),
        (
            force_rate_hz < protocol.min_force_rate,
            "force_sensor.rate",
            (
                f"{force_rate_hz:g} Hz is below protocol.min_force_rate "
                f"{protocol.min_force_rate:g} Hz: every press would fail"
            ),
            "raise rate or lower min_force_rate",
        ),
    )


def _workspace_rules(config: RigConfig) -> Iterator[tuple[str, str, str]]:
    box, home, surface = config.workspace, config.robot.home, config.sensor.surface
    for axis, low, high in (
        ("x", box.x_min, box.x_max),
        ("y", box.y_min, box.y_max),
        ("z", box.z_min, box.z_max),
    ):
        if low >= high:
            yield (
                f"workspace.{axis}_min",
                f"{low * 1e3:g} mm is not below {axis}_max {high * 1e3:g} mm",
                "swap or correct the two",
            )
        if high - low > BOX_SIDE_M:
            yield (
                f"workspace.{axis}_max",
                (
                    f"the box is {(high - low) * 1e3:g} mm wide along {axis}; over one gel at most "
                    f"{BOX_SIDE_M * 1e3:g} mm are of use"
                ),
                "draw it close around gel and home",
            )
    for name, point in (("robot.home", home), ("sensor.surface", surface)):
        inside = (
            box.x_min <= point[0] <= box.x_max
            and box.y_min <= point[1] <= box.y_max
            and box.z_min <= point[2] <= box.z_max
        )
        if not inside:
            text = ", ".join(f"{value * 1e3:g}" for value in point)
            yield (name, f"({text}) mm lies outside the workspace box", "correct it or the box")


def _height_rules(config: RigConfig) -> Iterator[tuple[str, str, str]]:
    home, surface, low = config.robot.home, config.sensor.surface, config.workspace.z_min
    clearance = config.protocol.air_press_height + config.protocol.approach_height
    if home[2] - surface[2] < clearance:
        yield (
            "robot.home",
            (
                f"is {(home[2] - surface[2]) * 1e3:g} mm above the gel; the air press and approach "
                f"need {clearance * 1e3:g} mm"
            ),
            "raise home",
        )
    deepest = surface[2] - config.limits.max_depth - config.sensor.surface_uncertainty
    if deepest < low:
        yield (
            "workspace.z_min",
            (
                f"{low * 1e3:g} mm stops the arm before max_depth below the lowest expected "
                f"surface, {deepest * 1e3:g} mm"
            ),
            "lower z_min or max_depth",
        )
    if config.protocol.approach_height <= config.sensor.surface_uncertainty:
        yield (
            "protocol.approach_height",
            (
                f"{config.protocol.approach_height * 1e3:g} mm may touch a surface known to "
                f"{config.sensor.surface_uncertainty * 1e3:g} mm"
            ),
            "raise approach_height",
        )


def _device_rules(config: RigConfig) -> Iterator[tuple[str, str, str]]:
    if config.robot.driver == "ur5" and not config.robot.host:
        yield ("robot.host", "is empty", "give the controller's address, e.g. 192.168.0.10")
    sensor = config.force_sensor
    if sensor.driver == "m3733c" and not sensor.port:
        yield ("force_sensor.port", "is empty", "give the port, e.g. /dev/serial/by-id/...")
    if sensor.is_real and not sensor.calibration_sheet:
        yield (
            "force_sensor.calibration_sheet",
            "is empty; capacity has no other source",
            "name the calibration sheet that came with the sensor (number and date)",
        )
    overrun = config.robot.press_speed * OVERRUN_DELAY_S
    if overrun > config.limits.max_depth / 10:
        yield (
            "robot.press_speed",
            f"{config.robot.press_speed * 1e3:g} mm/s overruns by {overrun * 1e6:.0f} um",
            "lower press_speed",
        )
