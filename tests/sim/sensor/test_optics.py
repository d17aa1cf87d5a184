"""Optics tables of sensor files."""

from __future__ import annotations

import pytest

from sim.sensor.optics import parse_optics
from sim.sensor.sensor import load_sensor
from tacauchy_rig.core.errors import ConfigError

LAMP = {"azimuth": "90 deg", "elevation": "20 deg", "colour": [80, 0, 0], "source": "assumed"}
GREY = {"kind": "grey-depth", "depth": ["0 mm", "1 mm"], "change": [0, -60], "source": "assumed"}


def test_built_in_sensors_have_optics() -> None:
    """Mini and DIGIT by lamps, DIGIT with shadows, 9DTact by a table that darkens."""
    mini, digit, tact = (load_sensor(name).optics for name in ("gelsight-mini", "digit", "9dtact"))
    assert len(mini.lamps) == len(digit.lamps) == 3
    assert mini.shadows is None
    assert digit.shadows is not None
    assert tact.kind == "grey-depth"
    assert list(tact.model.change) == sorted(tact.model.change, reverse=True)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"optics": {"kind": "radar"}}, '"radar" is none of "photometric", "grey-depth"'),
        ({"optics": {"kind": "grey-depth"}}, "missing or unknown change, depth, source"),
        ({"optics": {**GREY, "change": [0]}}, "are no table"),
        ({"optics": {**GREY, "depth": ["0 mm", "0 mm"]}}, "are no table"),
        ({"optics": {**GREY, "depth": ["0 mm", "1"]}}, "has no unit"),
        ({"optics": {"kind": "photometric", "shadow_softness": "0.1 mm"}}, "at least one lamp"),
        ({"lamps": [{"azimuth": "1 deg"}]}, "lamp 1 needs azimuth, elevation"),
    ],
)
def test_damaged_tables_are_refused(data: dict[str, object], message: str) -> None:
    """The file, the key and what to write are named."""
    with pytest.raises(ConfigError, match=message) as caught:
        parse_optics(data, "my.toml")
    assert "my.toml" in caught.value.message
    assert caught.value.remedy


def test_shadows_are_read() -> None:
    """A softness with lamps switches shadows on; without it they are off."""
    table = {"kind": "photometric", "shadow_softness": "0.1 mm"}
    read = parse_optics({"optics": table, "lamps": [LAMP]}, "my.toml")
    assert read.shadows is not None
    assert read.shadows.softness_m == pytest.approx(1e-4)
    assert parse_optics({"lamps": [LAMP]}, "my.toml").shadows is None
