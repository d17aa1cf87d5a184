"""Commands that compute for minutes say at once that their results could not be written."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from tacauchy_rig.app.cli.app import app
from tacauchy_rig.app.cli.output import writable_folder
from tacauchy_rig.core.errors import RecordError


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
