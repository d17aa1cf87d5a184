"""What is asked of a person, answered from a pipe."""

from __future__ import annotations

import io

import pytest

from drivers.force_sensor.weighing import Load
from tacauchy_rig.app.cli.operator import ask_for_weight, confirm
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import AbortedError
from tacauchy_rig.core.force_check import parse_weight

WEIGHT = parse_weight("200g")


def test_the_weight_is_asked_for_line_by_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each step waits for a line; the weight and its force are named."""
    monkeypatch.setattr("sys.stdin", io.StringIO("\n\n\n"))
    ask = ask_for_weight(WEIGHT)
    for load in Load:
        ask(load)
    told = capsys.readouterr().out
    assert "200 g (1.962 N)" in told
    assert "2 of 3: hang 200 g on the tool" in told


def test_an_input_that_ends_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither a weight nor a name was given by a pipe that is empty."""
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    with pytest.raises(AbortedError, match="was not finished"):
        ask_for_weight(WEIGHT)(Load.NONE)
    with pytest.raises(AbortedError, match="not confirmed"):
        confirm(load_config().config)
