"""``config show`` and ``config example`` as an operator calls them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tacauchy_rig.app.cli.app import app
from tacauchy_rig.core.config.fields import ceilings
from tacauchy_rig.core.config.load import example_text, load_config
from tacauchy_rig.core.errors import ConfigError

runner = CliRunner()


def test_show_names_the_source_of_each_value(tmp_path: Path) -> None:
    """A value from the file is told from a built-in default and from --set."""
    path = tmp_path / "rig.toml"
    path.write_text('[robot]\npress_speed = "0.2 mm/s"\n')
    out = tmp_path / "show.json"
    arguments = ["config", "show", str(path), "--set", "camera.width=1280", "--json", str(out)]
    assert runner.invoke(app, arguments).exit_code == 0
    sources = {row["field"]: row["source"] for row in json.loads(out.read_text())["fields"]}
    assert sources["robot.press_speed"] == str(path)
    assert sources["camera.width"] == "--set"
    assert sources["camera.height"] == "built-in default"


@pytest.mark.parametrize(
    "setting",
    ["sensor.name=gelsight-maxi", "replay.preset=finest", "sensor.optics_calibration=gone.npz"],
)
def test_show_refuses_what_no_replay_is_made_with(setting: str) -> None:
    """The fields are listed all the same: that is where the wrong one is found."""
    done = runner.invoke(app, ["config", "show", "--set", setting])
    assert isinstance(done.exception, ConfigError)
    assert setting.partition("=")[2] in done.exception.message
    assert "replay.preset" in done.stdout


@pytest.mark.parametrize("out", [None, "rig.toml"])
def test_example_is_written_and_overwrites_nothing(tmp_path: Path, out: str | None) -> None:
    """It waits to be filled in; the JSON has the text and where it was written."""
    file = tmp_path / "example.json"
    arguments = [] if out is None else [str(tmp_path / out)]
    command = ["config", "example", *arguments, "--json", str(file)]
    assert runner.invoke(app, command).exit_code == 0
    place = None if out is None else str(tmp_path / out)
    assert json.loads(file.read_text("utf-8")) == {"file": place, "text": example_text()}
    if place is not None:
        assert Path(place).read_text("utf-8") == example_text()
        with pytest.raises(ConfigError, match="is not filled in"):
            load_config(Path(place))
        Path(place).write_text("precious")
        with pytest.raises(ConfigError, match="cannot be written"):
            runner.invoke(app, command, catch_exceptions=False)
        assert Path(place).read_text() == "precious"


def test_every_ceiling_is_printed_with_its_reason() -> None:
    """A person sees all that can refuse a file before writing one."""
    printed = runner.invoke(app, ["config", "ceilings"]).stdout
    for field, ceiling in ceilings():
        assert f"`{field}`" in printed
        assert ceiling.because in printed
