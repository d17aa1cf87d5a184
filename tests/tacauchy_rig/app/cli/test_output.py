"""What commands print and write: results, configurations, and lines that follow a press."""

import errno
import io
import json
import logging
import sys
import time
from enum import StrEnum
from pathlib import Path
from typing import Annotated
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from typer import Context, Option, Typer
from typer.main import get_command
from typer.testing import CliRunner

from protocols.trials.time_left import TimeLeft
from tacauchy_rig.app.cli import output
from tacauchy_rig.app.cli import session_progress as session
from tacauchy_rig.app.cli.app import app
from tacauchy_rig.core.config.field_ranges import ceilings
from tacauchy_rig.core.config.load import example_text, load_config
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.run import JournalEvent, Phase
from tacauchy_rig.core.time_limit_and_progress import told


class _Colour(StrEnum):
    RED = "red"


def test_not_a_number_becomes_null(tmp_path: Path) -> None:
    """JSON knows no NaN, and a reader must not meet one."""
    path = tmp_path / "deep" / "out.json"
    output.write_json(path, {"a": float("nan"), "b": np.array([1.0, np.inf]), "c": _Colour.RED})
    assert json.loads(path.read_text()) == {"a": None, "b": [1.0, None], "c": "red"}


def test_unwritable_file_is_explained(tmp_path: Path) -> None:
    """The message names the file, and of a full disk its space and what to do."""
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordError, match="file: exists already"):
        output.write_json(tmp_path / "file" / "out.json", {})
    full = patch.object(Path, "mkdir", side_effect=OSError(errno.ENOSPC, "No space left"))
    with full, pytest.raises(RecordError, match=r"no space left to write \(.* MB free\)") as told:
        output.writable_folder(tmp_path / "out")
    assert "free some space" in told.value.remedy
    assert "--out" in told.value.remedy


def test_a_commands_docstring_describes_its_options() -> None:
    """A flag has no opposite, an annotation adds a name; what is no parameter is refused."""

    def press(place: Path, *, force: str = "2N", is_dry: Annotated[bool, Option("--dry")] = False):
        """Press.

        Args:
            place (FOLDER): Where it
                goes.
            force: How hard.
            is_dry: Move nothing.
        """

    (program := Typer(add_completion=False)).command()(output.documented(press))
    command = get_command(program)
    place, force, is_dry, _ = command.get_params(Context(command))
    assert command.help == "Press."
    assert (place.metavar, place.help, place.required) == ("FOLDER", "Where it goes.", True)
    assert (force.opts, force.help, force.default) == (["--force"], "How hard.", "2N")
    assert (is_dry.opts, is_dry.secondary_opts, is_dry.help) == (["--dry"], [], "Move nothing.")
    press.__doc__ = "Press.\n\nArgs:\n    forse: How hard."
    with pytest.raises(KeyError, match="forse"):
        output.documented(press)


SOURCE = logging.getLogger("sim.device.compiled")


def test_the_first_compiled_kernel_is_announced_and_the_sum_is_told(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """One line when it begins to matter, one in the end; kernels that are found need no words."""
    with output.compilation_told():
        for seconds in (30.0, 7.6):
            SOURCE.info("compiled", extra={"compiled_s": seconds})
    told = capsys.readouterr()
    assert not told.out
    assert told.err.splitlines() == [
        "compiling kernels once for this computer; later presses find them",
        "compiling kernels once: 38 s",
    ]
    with output.compilation_told():
        pass
    assert not capsys.readouterr().err


def test_loading_is_told() -> None:
    """What is imported before the first step is no silence."""
    lines: list[str] = []
    with patch.dict(sys.modules), told(lines.append, silent_s=0.5):
        for number in range(30):
            sys.modules[f"loaded_{number}"] = sys
            time.sleep(0.03)
    assert "loading the program" in lines[0]


def test_steps_are_plain_lines_without_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    """Each says what was done, of how many, and how long it goes on."""
    with output.Steps() as steps:
        for done in range(3):
            steps("fit", done, 2)
    lines = [line.strip() for line in capsys.readouterr().err.splitlines()]
    assert lines == ["0/2 fit", "1/2 fit, about 0 s left", "2/2 fit"]


@pytest.mark.parametrize("command", ["accuracy", "modes"])
def test_a_folder_that_cannot_be_made_ends_the_command_first(tmp_path: Path, command: str) -> None:
    """Nothing is pressed for results that have no place; the message names the place."""
    taken = tmp_path / "file"
    taken.write_text("not a folder", "utf-8")
    done = CliRunner().invoke(app, ["study", command, "--out", str(taken)])
    assert isinstance(done.exception, RecordError)
    assert str(taken) in str(done.exception)


def test_a_new_folder_is_made_and_left_empty(tmp_path: Path) -> None:
    """The probe leaves nothing behind."""
    folder = output.writable_folder(tmp_path / "a" / "b")
    assert list(folder.iterdir()) == []


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
        with pytest.raises(RecordError, match="exists already"):
            runner.invoke(app, command, catch_exceptions=False)
        assert Path(place).read_text() == "precious"


def test_every_ceiling_is_printed_with_its_reason() -> None:
    """A person sees all that can refuse a file before writing one."""
    printed = runner.invoke(app, ["config", "ceilings"]).stdout
    for field, ceiling in ceilings():
        assert f"`{field}`" in printed
        assert ceiling.because in printed


EVENTS = (
    JournalEvent.now("phase", phase="press"),
    JournalEvent(
        stamp_ns=0, name="attempt-start", trial=2, attempt=1, detail={"force_target_n": 2}
    ),
    JournalEvent.now(session.PROGRESS, force_n=1.5, height_m=0.1997),
)


def shown(width, *events, left_s=None):
    """Return the lines after events as a terminal of that width shows them."""
    progress, out = session.SessionProgress(load_config(None).config, plan=()), io.StringIO()
    for event in events:
        progress(event)
    with patch.object(TimeLeft, "seconds", return_value=left_s):
        Console(file=out, width=width, force_terminal=False).print(progress.lines(width))
    return out.getvalue().splitlines()


def test_force_target_time_and_the_way_to_stop_are_told():
    """Four lines of a usual terminal."""
    step, force, when, how = shown(100, *EVENTS, left_s=75.4)
    assert step == "  pressing to the target   trial 2 of 6"
    assert force.startswith("   1.500 N " + session.FULL)
    assert force.endswith(" of 2.000 ± 0.03 N, limit 6 N")
    assert when == "  about 1 min 15 s left   z 199.700 mm"
    assert how.strip() == session.HOW_TO_STOP


def test_nothing_is_wrapped_on_a_narrow_terminal():
    """A line that wraps would push the others away: ends are cut off."""
    lines = shown(30, *EVENTS)
    assert len(lines) == 4
    assert lines[-1].startswith("  any key stops")


def test_before_the_first_force_nothing_is_made_up():
    """No target, no height, no time: those parts are left out."""
    lines = shown(80)
    assert session.MARK not in lines[1]
    assert lines[2].strip() == ""


@given(force_n=st.floats(-20.0, 20.0), target_n=st.floats(0.0, 8.0), width=st.integers(10, 200))
def test_a_bar_is_as_wide_as_asked(force_n, target_n, width):
    """Whatever the force: beyond the limit the bar is full, below nothing it is empty."""
    bar = session.force_bar(force_n, target_n, limit_n=6.0, width=width)
    assert len(bar) == width
    assert set(bar) <= {session.FULL, session.EMPTY, session.MARK}
    assert (session.MARK in bar) == (target_n <= 6.0)


def test_every_phase_has_words() -> None:
    """An operator reads no name of the program's."""
    assert set(session.PHASES) == {phase.value for phase in Phase}
    assert all(" " in words or words == "judging" for words in session.PHASES.values())
