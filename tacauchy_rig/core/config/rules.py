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


class Rule(NamedTuple):
    """A rule, and what is said where it does not hold; the problem names values and units."""

    is_broken: bool
    field: str
    problem: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.field}: {self.problem}; {self.remedy}"


def broken_rules(config: RigConfig, *, placed: bool = True) -> Iterator[Rule]:
    """Yield each rule that does not hold.

    Args:
        placed: Home, gel and workspace box are all known.
    """
    rules = [*_force_rules(config), *_rate_rules(config)]
    rules += [*_workspace_rules(config), *_height_rules(config)] if placed else []
    yield from (rule for rule in (*rules, *_device_rules(config)) if rule.is_broken)
    device = config.camera.device
    try:
        _ = urlsplit(device).port if "://" in device else None
    except ValueError as error:
        yield Rule(True, "camera.device", f'"{device}": {error}', "give a port from 1 to 65535")


def _force_rules(config: RigConfig) -> Iterator[Rule]:
    limits, protocol = config.limits, config.protocol
    soft_n, hard_n, early_n = limits.soft_force, limits.hard_force, limits.early_contact
    capacity_n = config.force_sensor.capacity
    lowest_n, highest_n = min(protocol.force_targets), max(protocol.force_targets)
    tolerance_n, contact_n = protocol.force_tolerance, protocol.contact_force
    soft, hard, contact = f"{soft_n:g} N", f"{hard_n:g} N", f"contact_force {contact_n:g} N"
    yield Rule(
        soft_n <= highest_n + tolerance_n,
        "limits.soft_force",
        f"{soft} does not clear the highest target {highest_n:g} N plus its tolerance "
        f"{tolerance_n:g} N",
        "raise soft_force or lower the targets",
    )
    problem = f"{hard} is not above soft_force {soft}"
    yield Rule(hard_n <= soft_n, "limits.hard_force", problem, "raise hard_force")
    yield Rule(
        hard_n > capacity_n,
        "limits.hard_force",
        f"{hard} exceeds the force sensor's capacity {capacity_n:g} N",
        "lower hard_force, or correct force_sensor.capacity from the calibration sheet",
    )
    yield Rule(
        limits.lateral_force > soft_n,
        "limits.lateral_force",
        f"{limits.lateral_force:g} N is above soft_force {soft}: friction pulls sideways with "
        "less than what presses",
        "lower lateral_force",
    )
    yield Rule(
        tolerance_n > TOLERANCE_SHARE * lowest_n,
        "protocol.force_tolerance",
        f"{tolerance_n:g} N is more than {TOLERANCE_SHARE:.0%} of the lowest target {lowest_n:g} N",
        "lower force_tolerance or raise the target",
    )
    yield Rule(
        lowest_n <= contact_n,
        "protocol.force_targets",
        f"{lowest_n:g} N is not above {contact}",
        "raise the target or lower contact_force",
    )
    problem = f"{early_n:g} N is not above {contact}"
    yield Rule(early_n <= contact_n, "limits.early_contact", problem, "raise early_contact")
    yield Rule(
        protocol.tare_deviation >= contact_n,
        "protocol.tare_deviation",
        f"{protocol.tare_deviation:g} N of allowed noise hides a contact of {contact_n:g} N",
        "lower tare_deviation or raise contact_force",
    )


def _rate_rules(config: RigConfig) -> Iterator[Rule]:
    protocol = config.protocol
    for field, rate, least, least_field, unit in (
        ("camera", config.camera.rate, protocol.min_image_rate, "min_image_rate", "fps"),
        ("force_sensor", config.force_sensor.rate, protocol.min_force_rate, "min_force_rate", "Hz"),
    ):
        yield Rule(
            rate < least,
            f"{field}.rate",
            f"{rate:g} {unit} is below protocol.{least_field} {least:g} {unit}: every press "
            "would fail",
            f"raise rate or lower {least_field}",
        )


def _workspace_rules(config: RigConfig) -> Iterator[Rule]:
    box = config.workspace
    ends = {axis: (getattr(box, f"{axis}_min"), getattr(box, f"{axis}_max")) for axis in "xyz"}
    for axis, (low, high) in ends.items():
        problem = f"{low * 1e3:g} mm is not below {axis}_max {high * 1e3:g} mm"
        yield Rule(low >= high, f"workspace.{axis}_min", problem, "swap or correct the two")
        yield Rule(
            high - low > BOX_SIDE_M,
            f"workspace.{axis}_max",
            f"the box is {(high - low) * 1e3:g} mm wide along {axis}; over one gel at most "
            f"{BOX_SIDE_M * 1e3:g} mm are of use",
            "draw it close around gel and home",
        )
    for name, point in (
        ("robot.home", config.robot.home),
        ("sensor.surface", config.sensor.surface),
    ):
        inside = all(low <= x <= high for x, (low, high) in zip(point, ends.values(), strict=True))
        problem = f"({', '.join(f'{x * 1e3:g}' for x in point)}) mm is outside the workspace box"
        yield Rule(not inside, name, problem, "correct it or the box")


def _height_rules(config: RigConfig) -> Iterator[Rule]:
    protocol, sensor = config.protocol, config.sensor
    low, surface = config.workspace.z_min, sensor.surface[2]
    above = config.robot.home[2] - surface
    clearance = protocol.air_press_height + protocol.approach_height
    yield Rule(
        above < clearance,
        "robot.home",
        f"is {above * 1e3:g} mm above the gel; the air press and approach need "
        f"{clearance * 1e3:g} mm",
        "raise home",
    )
    deepest = surface - config.limits.max_depth - sensor.surface_uncertainty
    yield Rule(
        deepest < low,
        "workspace.z_min",
        f"{low * 1e3:g} mm stops the arm before max_depth below the lowest expected surface, "
        f"{deepest * 1e3:g} mm",
        "lower z_min or max_depth",
    )
    yield Rule(
        protocol.approach_height <= sensor.surface_uncertainty,
        "protocol.approach_height",
        f"{protocol.approach_height * 1e3:g} mm may touch a surface known to "
        f"{sensor.surface_uncertainty * 1e3:g} mm",
        "raise approach_height",
    )


def _device_rules(config: RigConfig) -> Iterator[Rule]:
    robot, sensor = config.robot, config.force_sensor
    yield Rule(
        robot.driver == "ur5" and not robot.host,
        "robot.host",
        "is empty",
        "give the controller's address, e.g. 192.168.0.10",
    )
    yield Rule(
        sensor.driver == "m3733c" and not sensor.port,
        "force_sensor.port",
        "is empty",
        "give the port, e.g. /dev/serial/by-id/...",
    )
    yield Rule(
        sensor.is_real and not sensor.calibration_sheet,
        "force_sensor.calibration_sheet",
        "is empty; capacity has no other source",
        "name the calibration sheet that came with the sensor (number and date)",
    )
    overrun = robot.press_speed * OVERRUN_DELAY_S
    yield Rule(
        overrun > config.limits.max_depth / 10,
        "robot.press_speed",
        f"{robot.press_speed * 1e3:g} mm/s overruns by {overrun * 1e6:.0f} um",
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


def required_but_missing(config: RigConfig, defaulted: Set[str]) -> Iterator[Rule]:
    """Yield each value that a real device needs and nobody gave.

    Args:
        defaulted: Dotted fields that only the built-in defaults give.
    """
    for device, fields, because in (
        (config.robot, ARM_REQUIRES, 'robot.driver = "{}" moves a real arm'),
        (config.force_sensor, CELL_REQUIRES, 'force_sensor.driver = "{}" is a real cell'),
    ):
        problem = f"is not given, and {because.format(device.driver)}"
        for field, remedy in fields.items():
            if device.is_real and field in defaulted:
                yield Rule(True, field, problem, remedy)
    sensor, sheet = config.force_sensor, "force_sensor.calibration_sheet"
    if sensor.is_real and sensor.calibration_sheet.strip() == _EXAMPLE_SHEET:
        yield Rule(True, sheet, f'"{_EXAMPLE_SHEET}" is not filled in', CELL_REQUIRES[sheet])
    if sensor.is_real and _EXAMPLE_SERIAL in sensor.port:
        yield Rule(
            True,
            "force_sensor.port",
            f'"{sensor.port}" is not filled in',
            "write the adapter's own name: `ls /dev/serial/by-id` lists it",
        )
