"""What a real device's file must say itself: the built-in values are those of the dry run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set

from tacauchy_rig.core.config.model import RigConfig

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


def required_but_missing(config: RigConfig, defaulted: Set[str]) -> Iterator[tuple[str, str, str]]:
    """Yield (field, problem, remedy) of each value that a real device needs and nobody gave.

    Args:
        config: The checked configuration.
        defaulted: Dotted fields that only the built-in defaults give.
    """
    if config.robot.is_real:
        yield from _missing(
            ARM_REQUIRES,
            defaulted,
            f'robot.driver = "{config.robot.driver}" moves a real arm',
        )
    if config.force_sensor.is_real:
        yield from _missing(
            CELL_REQUIRES,
            defaulted,
            f'force_sensor.driver = "{config.force_sensor.driver}" is a real cell',
        )
        yield from _left_as_in_the_example(config)


def _missing(
    fields: Mapping[str, str], defaulted: Set[str], because: str
) -> Iterator[tuple[str, str, str]]:
    for field, remedy in fields.items():
        if field in defaulted:
            yield field, f"is not given, and {because}", remedy


def _left_as_in_the_example(config: RigConfig) -> Iterator[tuple[str, str, str]]:
    sensor = config.force_sensor
    if sensor.calibration_sheet.strip() == _EXAMPLE_SHEET:
        field = "force_sensor.calibration_sheet"
        yield field, f'"{_EXAMPLE_SHEET}" is not filled in', CELL_REQUIRES[field]
    if _EXAMPLE_SERIAL in sensor.port:
        yield (
            "force_sensor.port",
            f'"{sensor.port}" is not filled in',
            "write the adapter's own name: `ls /dev/serial/by-id` lists it",
        )
