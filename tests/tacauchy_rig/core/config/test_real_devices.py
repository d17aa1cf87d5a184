"""Values that a real device's file must give itself, one by one and all together."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tacauchy_rig.core.config.load import example_text, load_config
from tacauchy_rig.core.config.rules import ARM_REQUIRES, CELL_REQUIRES
from tacauchy_rig.core.errors import ConfigError

WRITTEN = load_config().written
ARM = {"robot.driver": "ur5", "robot.host": "192.0.2.1"}
CELL = {"force_sensor.driver": "m3733c", "force_sensor.port": "/dev/ttyUSB0"}
SHEET = {"force_sensor.capacity": "50 N", "force_sensor.calibration_sheet": "no. 7"}


def overrides(values: dict[str, object]) -> list[str]:
    """Return values as ``--set`` takes them."""
    return [f"{field}={json.dumps(value)}" for field, value in values.items()]


def refused(values: dict[str, object], path: Path | None = None) -> list[str]:
    """Return the fields that are refused, in their order."""
    with pytest.raises(ConfigError) as caught:
        load_config(path, overrides=overrides(values))
    assert "tacauchy-rig config example" in caught.value.remedy
    return [line.split(":")[0] for line in caught.value.message.split("\n")]


def test_a_real_arm_takes_no_place_from_the_dry_run() -> None:
    """Everything that is missing is listed at once, each field with what to write."""
    assert refused(ARM) == list(ARM_REQUIRES)
    assert {"robot.home", "robot.tcp_offset", "robot.payload", "sensor.surface"} < set(ARM_REQUIRES)
    assert sum(field.startswith("workspace.") for field in ARM_REQUIRES) == 6


@pytest.mark.parametrize("left_out", ARM_REQUIRES)
def test_each_value_of_an_arm_is_asked_for(left_out: str) -> None:
    """One that is left out is refused although its built-in value would do."""
    given = {field: WRITTEN[field] for field in ARM_REQUIRES if field != left_out}
    assert refused({**ARM, **given}) == [left_out]


def test_values_from_file_and_command_line_are_the_users_own(tmp_path: Path) -> None:
    """Equal to the built-in ones or not: somebody wrote them."""
    path = tmp_path / "rig.toml"
    path.write_text('[robot]\npayload = "0.4 kg"\n')
    given = {field: WRITTEN[field] for field in ARM_REQUIRES if field != "robot.payload"}
    loaded = load_config(path, overrides=overrides({**ARM, **given}))
    assert loaded.config.moves_real_hardware


def test_places_are_not_compared_with_the_dry_runs() -> None:
    """A home of one's own is not told to lie outside a box that nobody gave."""
    home = ["300 mm", "300 mm", "500 mm"]
    assert refused({**ARM, "robot.home": home}) == [f for f in ARM_REQUIRES if f != "robot.home"]


@pytest.mark.parametrize("left_out", CELL_REQUIRES)
def test_a_real_cell_has_its_own_sheet(left_out: str) -> None:
    """Neither the capacity nor the sheet of the emulated cell stands for it."""
    assert refused({**CELL, **{f: v for f, v in SHEET.items() if f != left_out}}) == [left_out]
    assert load_config(overrides=overrides({**CELL, **SHEET})).config.force_sensor.capacity == 50.0


def test_placeholders_of_the_example_are_refused(tmp_path: Path) -> None:
    """A copied example names the two labels that nobody has read yet."""
    path = tmp_path / "rig.toml"
    path.write_text(example_text())
    assert refused({}, path) == ["force_sensor.calibration_sheet", "force_sensor.port"]
    emulated = {"robot.driver": "emulated", "force_sensor.driver": "emulated"}
    assert load_config(path, overrides=overrides(emulated)).config.force_sensor.capacity == 50.0


def test_the_documented_file_for_emulated_devices_is_complete(tmp_path: Path) -> None:
    """docs/reference/devices.md shows one that can be copied."""
    page = Path(__file__).parents[4] / "docs" / "reference" / "devices.md"
    found = re.search(r"```toml\n(.*?)```", page.read_text("utf-8"), re.DOTALL)
    assert found is not None
    path = tmp_path / "rig.toml"
    path.write_text(found.group(1))
    config = load_config(path).config
    assert config.robot.host == config.emulation.robot_host
    assert config.moves_real_hardware
