"""A run that went through to its end, and what is asked of a person before and after it."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import pytest
import typer

from drivers.force_sensor.weighing import Load
from protocols.processes.supervisor import SessionResult
from tacauchy_rig.app.cli import session
from tacauchy_rig.app.cli.operator import ask_for_weight, confirm
from tacauchy_rig.app.session.cell import ForceCheckError
from tacauchy_rig.app.session.record import missed_lines
from tacauchy_rig.core.config.load import default_text, load_config
from tacauchy_rig.core.errors import AbortedError, RigError
from tacauchy_rig.core.force_check import Weight, parse_weight
from tacauchy_rig.core.run import Criterion, Outcome, TrialRecord
from tacauchy_rig.core.store.run_store import RunStore
from tests.tacauchy_rig.core.test_force_history import weighed

RATE = Criterion(
    name="image_rate_hz",
    passed=False,
    measured=16.6123,
    limit=">= 20 Hz",
    unit="Hz",
    remedy="see `tacauchy-rig doctor`: camera",
)
LOST = replace(RATE, name="image_lost_ratio", measured=0.2345, limit="<= 0.05", unit="", remedy="")
MISSED = TrialRecord(
    index=3,
    attempt=2,
    outcome=Outcome.FAILED,
    force_target_n=2.0,
    criteria=(RATE, LOST, replace(RATE, name="force_mean", passed=True)),
)
TRIAL = "missed: trial 3, attempt 2"
LINES = [
    f"{TRIAL}: image_rate_hz is 16.61 Hz, required: >= 20 Hz -> see `tacauchy-rig doctor`: camera",
    f"{TRIAL}: image_lost_ratio is 0.2345, required: <= 0.05",
]


def test_each_criterion_that_was_missed_has_a_line() -> None:
    """Trial, criterion, measured, asked, what to do; nothing of trials that passed."""
    passed = replace(MISSED, outcome=Outcome.PASSED, criteria=())
    assert list(missed_lines([passed, MISSED])) == LINES
    assert list(missed_lines([replace(MISSED, attempt=1)]))[1].startswith("missed: trial 3: image")


def test_the_program_tells_it_and_ends_with_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Standard error holds the lines and what to do next; the exit code is 1."""
    store = RunStore.create(
        tmp_path, load_config(), config_text=default_text(), simulated=True, versions={}
    )
    result = SessionResult(
        outcome=Outcome.FAILED,
        records=(MISSED,),
        reason="trials without a passed attempt: 3",
        remedy="",
        died={},
        acknowledged={},
    )
    monkeypatch.setattr(session, "press", lambda *_, **__: result)
    with pytest.raises(typer.Exit) as caught:
        session.resume(store.paths.root, press_only=True)
    assert caught.value.exit_code == 1
    told = capfd.readouterr().err.splitlines()
    assert told[:3] == [*LINES, "trials without a passed attempt: 3"]
    assert f"tacauchy-rig resume {store.paths.root}" in told[3]


def test_a_weight_that_had_to_be_hung_before_is_asked_for_again_after_the_last_trial(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A coarse arm, the weight of the kept check; an input that ends and a wrong cell are told."""
    loaded = load_config(overrides=['robot.model="cb3"'])
    store = RunStore.create(
        tmp_path, loaded, config_text=default_text(), simulated=True, versions={}
    )
    hung: list[str] = []

    def hang(_store: object, _config: object, weight: Weight, _emulation: object) -> None:
        hung.append(str(weight))

    monkeypatch.setattr(session, "_check_force", hang)
    session._check_force_after(store, store.config, None, None)
    assert hung == []
    store.force_check.save(weighed(1.0))
    session._check_force_after(store, store.config, None, None)
    assert hung == ["200 g"]

    def raising(error: RigError) -> None:
        def fail(*_: object) -> None:
            raise error

        monkeypatch.setattr(session, "_check_force", fail)

    raising(AbortedError("the input ended"))
    session._check_force_after(store, store.config, None, None)
    assert "force not checked at the end: the input ended" in capfd.readouterr().out
    raising(ForceCheckError("the cell is wrong"))
    with pytest.raises(ForceCheckError, match="after the last trial the cell is wrong"):
        session._check_force_after(store, store.config, None, None)


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
