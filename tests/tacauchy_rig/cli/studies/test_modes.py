"""``modes``: what it refuses before any work is done."""

from __future__ import annotations

from typer.testing import CliRunner

from tacauchy_rig.cli.app import app


def test_a_folder_for_the_figures_is_asked_for() -> None:
    """Nothing is pressed without a place for the figures."""
    done = CliRunner().invoke(app, ["modes"])
    assert done.exit_code == 2
    assert "--out" in done.output


def test_only_round_bodies_are_moved() -> None:
    """A plane has no axis to turn about."""
    done = CliRunner().invoke(app, ["modes", "--out", "nowhere", "--indenter", "plane"])
    assert done.exit_code != 0
    assert "only round bodies" in str(done.exception)
