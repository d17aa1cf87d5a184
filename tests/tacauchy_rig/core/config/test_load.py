"""Reading rig.toml: where values come from, and what is said of those that cannot stay."""

from __future__ import annotations

from pathlib import Path

import pytest

from tacauchy_rig.core.config.load import BUILT_IN, example_text, load_config, restore_config
from tacauchy_rig.core.config.rules import ARM_REQUIRES, CELL_REQUIRES
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
        (b'[run]\nname = "\xff"\n', "rig.toml: cannot be read"),
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
    with pytest.raises(ConfigError, match=r"rig\.toml: no such configuration file") as caught:
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
