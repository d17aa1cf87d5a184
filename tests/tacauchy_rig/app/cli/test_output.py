"""What every command prints and writes."""

from __future__ import annotations

import json
import logging
from enum import StrEnum
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tacauchy_rig.app.cli.app import app
from tacauchy_rig.app.cli.output import Steps, compilation_told, writable_folder, write_json
from tacauchy_rig.core.errors import RecordError


class _Colour(StrEnum):
    RED = "red"


def test_not_a_number_becomes_null(tmp_path: Path) -> None:
    """JSON knows no NaN, and a reader must not meet one."""
    path = tmp_path / "deep" / "out.json"
    write_json(path, {"a": float("nan"), "b": np.array([1.0, np.inf]), "c": _Colour.RED})
    assert json.loads(path.read_text()) == {"a": None, "b": [1.0, None], "c": "red"}


def test_unwritable_file_is_explained(tmp_path: Path) -> None:
    """The message names the file."""
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordError, match="cannot be written"):
        write_json(tmp_path / "file" / "out.json", {})


SOURCE = logging.getLogger("sim.device.compiled")


def test_the_first_compiled_kernel_is_announced_and_the_sum_is_told(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """One line when it begins to matter, one in the end; kernels that are found need no words."""
    with compilation_told():
        for seconds in (30.0, 7.6):
            SOURCE.info("compiled", extra={"compiled_s": seconds})
    told = capsys.readouterr()
    assert not told.out
    assert told.err.splitlines() == [
        "compiling kernels once for this computer; later presses find them",
        "compiling kernels once: 38 s",
    ]
    with compilation_told():
        pass
    assert not capsys.readouterr().err


def test_steps_are_plain_lines_without_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    """Each says what was done, of how many, and how long it goes on."""
    with Steps() as steps:
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
    folder = writable_folder(tmp_path / "a" / "b")
    assert list(folder.iterdir()) == []
