"""Rules that tie fields together, and what the file of a real device has to state itself."""

from collections.abc import Iterator, Mapping, Set
from typing import NamedTuple
from urllib.parse import urlsplit

from tacauchy_rig.core.config.settings import RigConfig

OVERRUN_DELAY_S = 0.05
"""Reaction of the loop plus the arm's stop: about 50 ms, so 1 mm/s overruns by about 55 um."""
TOLERANCE_SHARE = 0.2
"""Of the lowest target; with more the presses of a series of six would overlap."""
BOX_SIDE_M = 0.5
"""Over one gel an arm needs a tenth of it; a wider box protects nothing."""


class BrokenRule(NamedTuple):
    """A rule that does not hold; the problem names values and units."""

    field: str
    problem: str
    remedy: str


def broken_rules(config: RigConfig, *, placed: bool = True) -> Iterator[BrokenRule]:
    """Yield each rule that does not hold.

    Args:
        placed: Home, gel and workspace box are all known.
    """
    yield from _limit_rules(config)
    yield from _target_rules(config)
    yield from _rate_rules(config)
    if placed:
        yield from _workspace_rules(config)
        yield from _height_rules(config)
    yield from _device_rules(config)
    device = config.camera.device
    try:
        _ = urlsplit(device).port if "://" in device else None
    except ValueError as error:
        yield BrokenRule("camera.device", f'"{device}": {error}', "give a port from 1 to 65535")


def _limit_rules(config: RigConfig) -> Iterator[BrokenRule]:
    limits, protocol, sensor = config.limits, config.protocol, config.force_sensor
    highest = max(protocol.force_targets)
    soft, hard = f"{limits.soft_force:g} N", f"{limits.hard_force:g} N"
    if limits.soft_force <= highest + protocol.force_tolerance:
        yield BrokenRule(
            "limits.soft_force",
            f"{soft} does not clear the highest target {highest:g} N plus its tolerance "
            f"{protocol.force_tolerance:g} N",
            "raise soft_force or lower the targets",
        )
    if limits.hard_force <= limits.soft_force:
        yield BrokenRule(
            "limits.hard_force", f"{hard} is not above soft_force {soft}", "raise hard_force"
        )
    if limits.hard_force > sensor.capacity:
        yield BrokenRule(
            "limits.hard_force",
            f"{hard} exceeds the force sensor's capacity {sensor.capacity:g} N",
            "lower hard_force, or correct force_sensor.capacity from the calibration sheet",
        )
    if limits.lateral_force > limits.soft_force:
        yield BrokenRule(
            "limits.lateral_force",
            f"{limits.lateral_force:g} N is above soft_force {soft}: friction pulls sideways with "
            "less than what presses",
            "lower lateral_force",
        )


def _target_rules(config: RigConfig) -> Iterator[BrokenRule]:
    limits, protocol = config.limits, config.protocol
    lowest, contact = min(protocol.force_targets), f"contact_force {protocol.contact_force:g} N"
    if protocol.force_tolerance > TOLERANCE_SHARE * lowest:
        yield BrokenRule(
            "protocol.force_tolerance",
            f"{protocol.force_tolerance:g} N is more than {TOLERANCE_SHARE:.0%} of the lowest "
            f"target {lowest:g} N",
            "lower force_tolerance or raise the target",
        )
    if lowest <= protocol.contact_force:
        yield BrokenRule(
            "protocol.force_targets",
            f"{lowest:g} N is not above {contact}",
            "raise the target or lower contact_force",
        )
    if limits.early_contact <= protocol.contact_force:
        early_n = f"{limits.early_contact:g} N"
        yield BrokenRule(
            "limits.early_contact", f"{early_n} is not above {contact}", "raise early_contact"
        )
    if protocol.tare_deviation >= protocol.contact_force:
        yield BrokenRule(
            "protocol.tare_deviation",
            f"{protocol.tare_deviation:g} N of allowed noise hides a contact of "
            f"{protocol.contact_force:g} N",
            "lower tare_deviation or raise contact_force",
        )


def _rate_rules(config: RigConfig) -> Iterator[BrokenRule]:
    protocol = config.protocol
    for field, rate, least, least_field, unit in (
        ("camera", config.camera.rate, protocol.min_image_rate, "min_image_rate", "fps"),
        ("force_sensor", config.force_sensor.rate, protocol.min_force_rate, "min_force_rate", "Hz"),
    ):
        if rate < least:
            yield BrokenRule(
                f"{field}.rate",
                f"{rate:g} {unit} is below protocol.{least_field} {least:g} {unit}: every press "
                "would fail",
                f"raise rate or lower {least_field}",
            )


def _workspace_rules(config: RigConfig) -> Iterator[BrokenRule]:
    box = config.workspace
    ends = {axis: (getattr(box, f"{axis}_min"), getattr(box, f"{axis}_max")) for axis in "xyz"}
    for axis, (low, high) in ends.items():
        if low >= high:
            yield BrokenRule(
                f"workspace.{axis}_min",
                f"{low * 1e3:g} mm is not below {axis}_max {high * 1e3:g} mm",
                "swap or correct the two",
            )
        if high - low > BOX_SIDE_M:
            yield BrokenRule(
                f"workspace.{axis}_max",
                f"the box is {(high - low) * 1e3:g} mm wide along {axis}; over one gel at most "
                f"{BOX_SIDE_M * 1e3:g} mm are of use",
                "draw it close around gel and home",
            )
    for name, point in (
        ("robot.home", config.robot.home),
        ("sensor.surface", config.sensor.surface),
    ):
        if not all(low <= x <= high for x, (low, high) in zip(point, ends.values(), strict=True)):
            text = ", ".join(f"{value * 1e3:g}" for value in point)
            yield BrokenRule(
                name, f"({text}) mm is outside the workspace box", "correct it or the box"
            )


def _height_rules(config: RigConfig) -> Iterator[BrokenRule]:
    protocol, sensor = config.protocol, config.sensor
    low, surface = config.workspace.z_min, sensor.surface[2]
    above = config.robot.home[2] - surface
    clearance = protocol.air_press_height + protocol.approach_height
    if above < clearance:
        yield BrokenRule(
            "robot.home",
            f"is {above * 1e3:g} mm above the gel; the air press and approach need "
            f"{clearance * 1e3:g} mm",
            "raise home",
        )
    deepest = surface - config.limits.max_depth - sensor.surface_uncertainty
    if deepest < low:
        yield BrokenRule(
            "workspace.z_min",
            f"{low * 1e3:g} mm stops the arm before max_depth below the lowest expected surface, "
            f"{deepest * 1e3:g} mm",
            "lower z_min or max_depth",
        )
    if protocol.approach_height <= sensor.surface_uncertainty:
        yield BrokenRule(
            "protocol.approach_height",
            f"{protocol.approach_height * 1e3:g} mm may touch a surface known to "
            f"{sensor.surface_uncertainty * 1e3:g} mm",
            "raise approach_height",
        )


def _device_rules(config: RigConfig) -> Iterator[BrokenRule]:
    if config.robot.driver == "ur5" and not config.robot.host:
        yield BrokenRule(
            "robot.host", "is empty", "give the controller's address, e.g. 192.168.0.10"
        )
    sensor = config.force_sensor
    if sensor.driver == "m3733c" and not sensor.port:
        yield BrokenRule(
            "force_sensor.port", "is empty", "give the port, e.g. /dev/serial/by-id/..."
        )
    if sensor.is_real and not sensor.calibration_sheet:
        yield BrokenRule(
            "force_sensor.calibration_sheet",
            "is empty; capacity has no other source",
            "name the calibration sheet that came with the sensor (number and date)",
        )
    overrun = config.robot.press_speed * OVERRUN_DELAY_S
    if overrun > config.limits.max_depth / 10:
        yield BrokenRule(
            "robot.press_speed",
            f"{config.robot.press_speed * 1e3:g} mm/s overruns by {overrun * 1e6:.0f} um",
            "lower press_speed",
        )


ARM_REQUIRES: Mapping[str, str] = {
    "robot.home": "write where the tip hangs free above the gel (x, y, z), in the base frame",
    "robot.tcp_offset": "write the way from the tool flange to the indenter's tip (x, y, z)",
    "robot.payload": "write the mass of force sensor and indenter",
    "sensor.surface": "write the highest point of the gel (x, y, z), in the base frame",
    **{
        f"workspace.{axis}_{end}": f"write the {word} {axis} that the tip may reach"
        for axis in "xyz"
        for end, word in (("min", "smallest"), ("max", "largest"))
    },
}
"""Fields by which an arm moves, each with what to do where it is missing."""

CELL_REQUIRES: Mapping[str, str] = {
    "force_sensor.capacity": "write the range that its own calibration sheet states",
    "force_sensor.calibration_sheet": "write the number and the date of its calibration sheet",
}
"""Fields by which a cell is kept from overload, likewise."""

_EXAMPLE_SHEET = "number and date of the sheet"
_EXAMPLE_SERIAL = "XXXXXXXX"


def required_but_missing(config: RigConfig, defaulted: Set[str]) -> Iterator[BrokenRule]:
    """Yield each value that a real device needs and nobody gave.

    Args:
        defaulted: Dotted fields that only the built-in defaults give.
    """
    for device, fields, because in (
        (config.robot, ARM_REQUIRES, 'robot.driver = "{}" moves a real arm'),
        (config.force_sensor, CELL_REQUIRES, 'force_sensor.driver = "{}" is a real cell'),
    ):
        for field, remedy in fields.items():
            if device.is_real and field in defaulted:
                yield BrokenRule(
                    field, f"is not given, and {because.format(device.driver)}", remedy
                )
    if config.force_sensor.is_real:
        yield from _example_placeholders(config)


def _example_placeholders(config: RigConfig) -> Iterator[BrokenRule]:
    sensor = config.force_sensor
    if sensor.calibration_sheet.strip() == _EXAMPLE_SHEET:
        field = "force_sensor.calibration_sheet"
        yield BrokenRule(field, f'"{_EXAMPLE_SHEET}" is not filled in', CELL_REQUIRES[field])
    if _EXAMPLE_SERIAL in sensor.port:
        yield BrokenRule(
            "force_sensor.port",
            f'"{sensor.port}" is not filled in',
            "write the adapter's own name: `ls /dev/serial/by-id` lists it",
        )
