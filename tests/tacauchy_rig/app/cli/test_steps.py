"""Steps of a long command."""

from __future__ import annotations

import pytest

from tacauchy_rig.app.cli.output import Steps


def test_steps_are_plain_lines_without_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    """Each says what was done, of how many, and how long it goes on."""
    with Steps() as steps:
        for done in range(3):
            steps("fit", done, 2)
    lines = [line.strip() for line in capsys.readouterr().err.splitlines()]
    assert lines == ["0/2 fit", "1/2 fit, about 0 s left", "2/2 fit"]
