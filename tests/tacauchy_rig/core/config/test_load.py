"""Reading rig.toml: where values come from, what cannot stay or change, and what devices need."""

import json
from pathlib import Path

import pytest

from tacauchy_rig.core.config.load import (
    BUILT_IN,
    OF_DEVICES,
    Change,
    example_text,
    load_config,
    restore_config,
    resumed_config,
)
from tacauchy_rig.core.config.rules import ARM_REQUIRES, CELL_REQUIRES
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import ConfigError


def _refused(*overrides: str, path: Path | None = None) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load_config(path, overrides=overrides)
    assert "tacauchy-rig config show" in caught.value.remedy
    return caught.value.message.split("\n")


def test_the_default_is_a_dry_run() -> None:
    """Nothing real moves by default, and every value is the built-in one."""
    loaded = load_config()
    assert loaded.config.robot.driver == "emulated"
    assert not loaded.config.moves_real_hardware
    assert set(loaded.sources.values()) == {BUILT_IN, "sensor gelsight-mini"}
    assert loaded.config.protocol.force_targets[0] == 1.2556
    assert loaded.config.protocol.force_targets[-1] == 4.7332


def test_the_filled_in_example_is_a_real_rig(tmp_path: Path) -> None:
    """The commented example is accepted once its labels are copied, and would move a real arm."""
    path = tmp_path / "rig.toml"
    text = example_text().replace("XXXXXXXX", "A50285BI")
    path.write_text(text.replace("number and date of the sheet", "no. 7 of 2026-01-01"))
    loaded = load_config(path)
    assert loaded.config.moves_real_hardware
    assert loaded.config.force_sensor.driver == "m3733c"
    assert {loaded.sources[field] for field in (*ARM_REQUIRES, *CELL_REQUIRES)} == {str(path)}


def test_an_option_that_the_file_lacks_is_named() -> None:
    """A driver of another package that asks for it does not look like a fault of the program."""
    loaded = load_config(overrides=["camera.options.offset=3"])
    assert loaded.config.camera.options == {"offset": 3}
    for section in (loaded.config.camera, loaded.config.force_sensor):
        with pytest.raises(ConfigError, match="gain is missing"):
            _ = section.options["gain"]


def test_each_value_remembers_where_it_came_from(tmp_path: Path) -> None:
    """The command line is laid over the file, the file over the defaults, key by key."""
    path = tmp_path / "rig.toml"
    path.write_text('[robot]\npress_speed = "0.2 mm/s"\n[camera]\nwidth = 800\n')
    loaded = load_config(path, overrides=["camera.width=1280", "run.name=bench"])
    assert loaded.config.robot.press_speed == pytest.approx(2e-4)
    assert loaded.sources["robot.press_speed"] == str(path)
    assert loaded.config.camera.width == 1280
    assert loaded.sources["camera.width"] == "--set"
    assert loaded.config.run.name == "bench"
    assert loaded.sources["camera.height"] == BUILT_IN
    assert loaded.written["robot.press_speed"] == "0.2 mm/s"


@pytest.mark.parametrize(
    "override",
    ['robot.press_speed="0.2 mm/s"', "robot.press_speed=0.2 mm/s", " robot.press_speed = 200um/s"],
)
def test_overrides_need_no_quotes(override: str) -> None:
    """A shell that eats the quotes changes nothing; lists are written as in TOML."""
    targets = 'protocol.force_targets=["1 N", "2000 mN"]'
    config = load_config(overrides=[override, targets]).config
    assert config.robot.press_speed == pytest.approx(2e-4)
    assert config.protocol.force_targets == (1.0, 2.0)


@pytest.mark.parametrize("override", ["camera.width", "width=3", "=3"])
def test_an_override_that_is_none(override: str) -> None:
    """A malformed override is shown with one that works."""
    with pytest.raises(ConfigError, match=r"expected table\.field=value") as caught:
        load_config(overrides=[override])
    assert "--set camera.width=1280" in caught.value.remedy


def test_equal_settings_have_equal_hashes() -> None:
    """The hash follows the values, not the way they are written."""
    first = load_config(overrides=['protocol.drift="0.05 N"'])
    second = load_config(overrides=['protocol.drift="50 mN"'])
    assert first.config_hash == second.config_hash
    assert first.config_hash != load_config().config_hash


def test_a_recorded_configuration_is_restored() -> None:
    """What a run keeps of its configuration is enough to build it again."""
    loaded = load_config(overrides=["camera.width=1280"])
    assert restore_config(loaded.written) == loaded.config
    fallbacks = ['camera.rate="25 fps"', 'protocol.min_image_rate="15 fps"']
    assert restore_config({}) == load_config(overrides=fallbacks).config


def _read_refused() -> list[list[str]]:
    text = Path(__file__).with_name("refused.txt").read_text("utf-8")
    return [block.split("\n") for block in text.rstrip("\n").split("\n\n")]


@pytest.mark.parametrize("block", _read_refused(), ids=lambda block: block[0])
def test_a_refused_value_is_explained(block: list[str]) -> None:
    """By field, value as it was written, the limit in its unit, and what to write instead.

    ``refused.txt`` has values as ``--set`` takes them, and indented below them all of the message.
    """
    given = [line for line in block if not line.startswith(" ")]
    assert _refused(*given) == [line.strip() for line in block[len(given) :]]


def test_all_problems_are_told_at_once(tmp_path: Path) -> None:
    """One look at the message is enough to mend the file."""
    path = tmp_path / "rig.toml"
    path.write_text('[robot]\npress_speed = "1 mm/s"\nhots = ""\n[camera]\nwidth = 1\n')
    lines = _refused(path=path)
    assert [line.split(":")[0] for line in lines] == [
        "robot.press_speed",
        "robot.hots",
        "camera.width",
    ]


def test_a_value_in_the_place_of_a_table(tmp_path: Path) -> None:
    """A table that was written as a value is called that."""
    path = tmp_path / "rig.toml"
    path.write_text("robot = 5\n")
    assert _refused(path=path) == ["robot: 5 is not a table"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"[robot\n", "rig.toml: not valid TOML"),
        (b'[run]\nname = "\xff"\n', "rig.toml: not valid TOML"),
    ],
)
def test_a_file_that_is_no_toml(tmp_path: Path, content: bytes, message: str) -> None:
    """Broken files are named."""
    path = tmp_path / "rig.toml"
    path.write_bytes(content)
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert message in caught.value.message


def test_a_missing_file(tmp_path: Path) -> None:
    """A missing file is named, with the command that writes one."""
    with pytest.raises(ConfigError, match=r"rig\.toml: cannot be read: No such file") as caught:
        load_config(tmp_path / "rig.toml")
    assert "tacauchy-rig config example" in caught.value.remedy


def test_rates_of_the_camera_come_from_the_sensors_file(tmp_path: Path) -> None:
    """Between the built-in defaults and rig.toml; a file that states none leaves the defaults."""
    rates = ("camera.rate", "protocol.min_image_rate")

    def found(text: str, *overrides: str) -> tuple[float, float, set[str]]:
        path = tmp_path / "rig.toml"
        path.write_text(text)
        loaded = load_config(path, overrides=overrides)
        config = loaded.config
        sources = {loaded.sources[rate] for rate in rates}
        return config.camera.rate, config.protocol.min_image_rate, sources

    assert found("") == (18.75, 15.0, {"sensor gelsight-mini"})
    assert found('[sensor]\nname = "digit"\n') == (30.0, 15.0, {"sensor digit"})
    assert found('[sensor]\nname = "digit"\n', "sensor.name=9dtact")[2] == {"sensor 9dtact"}
    own = tmp_path / "own.toml"
    own.write_text('[camera]\nrate = { value = "40 Hz" }\n')
    named = f"sensor.name={own}"
    assert found("", named) == (40.0, 15.0, {f"sensor {own}", BUILT_IN})
    asked = found('[camera]\nrate = "22 fps"\n', named, 'protocol.min_image_rate="12 fps"')
    assert asked == (22.0, 12.0, {str(tmp_path / "rig.toml"), "--set"})
    for text in ("[camera]\nwidth = 3\n", "no TOML", "camera = 3\n"):
        own.write_text(text)
        assert found("", named) == (25.0, 15.0, {BUILT_IN})
    assert found("", "sensor.name=nowhere") == (25.0, 15.0, {BUILT_IN})


BEGUN = load_config().written


def test_addresses_and_limits_are_changed_and_told() -> None:
    """Old and new value stand beside one another; what stays is no change."""
    config, changes = resumed_config(
        BEGUN,
        ["camera.device=GelSight Mini", 'limits.stale_image="1 s"', 'limits.soft_force="6 N"'],
    )
    assert config.camera.device == "GelSight Mini"
    assert config.limits.stale_image == 1.0
    assert changes == (
        Change(field="camera.device", old="", new="GelSight Mini"),
        Change(field="limits.stale_image", old="500 ms", new="1 s"),
    )
    assert str(changes[1]) == "limits.stale_image = 1 s, before: 500 ms"


def test_without_a_change_it_is_the_runs_own() -> None:
    """A run that just goes on goes on as it was."""
    assert resumed_config(BEGUN, []) == (load_config().config, ())


def test_what_the_run_is_cannot_be_changed() -> None:
    """Every such field is refused at once, with what may be changed."""
    given = ['protocol.force_targets=["2 N"]', "sensor.name=digit", "camera.width=320"]
    with pytest.raises(ConfigError) as caught:
        resumed_config(BEGUN, [*given, 'limits.soft_force="7 N"'])
    fields = [line.split(":")[0] for line in caught.value.message.split("\n")]
    assert fields == ["protocol.force_targets", "sensor.name", "camera.width"]
    assert "force_sensor.port" in caught.value.remedy


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ('limits.hard_force="4000 N"', "above the limit 50 N"),
        ('limits.soft_force="2 N"', "does not clear the highest target"),
        ('limits.soft_forse="7 N"', "did you mean soft_force?"),
    ],
)
def test_a_changed_limit_is_checked_as_any_other(override: str, message: str) -> None:
    """Ceilings, rules and spelling hold for a begun run too."""
    with pytest.raises(ConfigError, match=message.replace("?", r"\?")):
        resumed_config(BEGUN, [override])


def test_a_run_of_another_time_is_asked_before_it_is_pressed_again() -> None:
    """What was recorded under wider limits is read; pressing needs narrower ones."""
    wide = {**BEGUN, "limits.max_depth": "100 mm"}
    with pytest.raises(ConfigError, match=r"limits\.max_depth"):
        resumed_config(wide, [])
    config, (change,) = resumed_config(wide, ['limits.max_depth="2 mm"'])
    assert config.limits.max_depth == pytest.approx(2e-3)
    assert change.old == "100 mm"


@pytest.mark.parametrize("field", OF_DEVICES)
def test_each_of_the_devices_fields_is_one(field: str) -> None:
    """A misspelt name could never be given."""
    table, _, name = field.partition(".")
    assert name in RigConfig.model_fields[table].annotation.model_fields


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
    given = {field: BEGUN[field] for field in ARM_REQUIRES if field != left_out}
    assert refused({**ARM, **given}) == [left_out]


def test_values_from_file_and_command_line_are_the_users_own(tmp_path: Path) -> None:
    """Equal to the built-in ones or not: somebody wrote them."""
    path = tmp_path / "rig.toml"
    path.write_text('[robot]\npayload = "0.4 kg"\n')
    given = {field: BEGUN[field] for field in ARM_REQUIRES if field != "robot.payload"}
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


def test_the_documented_file_for_emulated_devices_is_complete() -> None:
    """docs/reference/devices.md names one that can be copied."""
    config = load_config(Path(__file__).parents[4] / "docs/examples/emulated-rig.toml").config
    assert config.robot.host == config.emulation.robot_host
    assert config.moves_real_hardware
