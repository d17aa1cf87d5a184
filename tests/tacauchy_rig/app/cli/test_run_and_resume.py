"""A run that went through, what it refuses before it moves, and what is computed meanwhile."""

import io
import json
import os
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from drivers.force_sensor.weighing import Load
from protocols.processes.supervisor import SessionResult
from tacauchy_rig.app.cli import emulated_calibration, run_and_resume
from tacauchy_rig.app.cli import replay_report_export_serve as run_folders
from tacauchy_rig.app.cli.app import app
from tacauchy_rig.app.cli.emulated_calibration import begin_calibration
from tacauchy_rig.app.cli.operator_prompts import ask_for_weight, confirm
from tacauchy_rig.app.session.record_run_and_weight_check import ForceCheckError, missed_lines
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.rules import ARM_REQUIRES
from tacauchy_rig.core.errors import AbortedError, ConfigError, RecordError, RigError
from tacauchy_rig.core.known_weight import Weight, parse_weight
from tacauchy_rig.core.run import Criterion, Outcome, TrialRecord
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.time_limit_and_progress import heard, say
from tests.recorded_run import empty_run
from tests.tacauchy_rig.core.test_force_sensor_gain import weighed

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
    store = empty_run(tmp_path)
    result = SessionResult(
        outcome=Outcome.FAILED,
        records=(MISSED,),
        reason="trials without a passed attempt: 3",
        remedy="",
        died={},
        acknowledged={},
    )
    monkeypatch.setattr(run_and_resume, "press", lambda *_, **__: result)
    with pytest.raises(typer.Exit) as caught:
        run_and_resume.resume(run_and_resume.Request(press_only=True), store.paths.root)
    assert caught.value.exit_code == 1
    told = capfd.readouterr().err.splitlines()
    assert told[:3] == [*LINES, "trials without a passed attempt: 3"]
    assert f"tacauchy-rig resume {store.paths.root}" in told[3]


@pytest.mark.parametrize(("is_emulated", "asked"), [(False, ["weight"]), (True, [])])
def test_a_person_hangs_the_weight_before_what_takes_long(
    monkeypatch: pytest.MonkeyPatch, is_emulated: bool, asked: list[str]
) -> None:
    """On an emulated cell it hangs once that cell has started."""
    done: list[str] = []
    monkeypatch.setattr(run_and_resume, "_check_force", lambda *_: done.append("weight"))
    expected = "tacauchy_rig.app.session.record_run_and_weight_check.kept_expectation"
    monkeypatch.setattr(expected, lambda _: done.append("expected"))
    ended: Any = SimpleNamespace(outcome=Outcome.PASSED, records=())
    monkeypatch.setattr(run_and_resume, "press", lambda *_: ended)
    cell: Any = SimpleNamespace(is_emulated=is_emulated)
    config: Any = SimpleNamespace(force_sensor=cell, moves_real_hardware=False)
    run_and_resume._press_confirmed(_store(), config, run_and_resume.Request(check_weight="200g"))
    assert done == [*asked, "expected"]


def test_a_weight_that_had_to_be_hung_before_is_asked_for_again_after_the_last_trial(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A coarse arm, the weight of the kept check; an input that ends and a wrong cell are told."""
    loaded = load_config(overrides=['robot.model="cb3"'])
    store = empty_run(tmp_path, loaded)
    hung: list[str] = []

    def hang(_store: object, _config: object, weight: Weight) -> None:
        hung.append(str(weight))

    monkeypatch.setattr(run_and_resume, "_check_force", hang)
    run_and_resume._check_force_after(store, store.config, None)
    assert hung == []
    store.force_check.save(weighed(1.0))
    run_and_resume._check_force_after(store, store.config, None)
    assert hung == ["200 g"]

    def raising(error: RigError) -> None:
        def fail(*_: object) -> None:
            raise error

        monkeypatch.setattr(run_and_resume, "_check_force", fail)

    raising(AbortedError("the input ended"))
    run_and_resume._check_force_after(store, store.config, None)
    assert "force not checked at the end: the input ended" in capfd.readouterr().out
    raising(ForceCheckError("the cell is wrong"))
    with pytest.raises(ForceCheckError, match="after the last trial the cell is wrong"):
        run_and_resume._check_force_after(store, store.config, None)


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


runner = CliRunner()


def refuse(*arguments: str) -> None:
    """Run the command; its error comes out."""
    runner.invoke(app, list(arguments), catch_exceptions=False)


@pytest.mark.parametrize("content", [None, b"", b"no calibration"])
def test_lost_calibration_is_refused_before_the_presses(
    tmp_path: Path, content: bytes | None
) -> None:
    """A missing, an empty and a damaged file are named before a run folder is made."""
    file, runs = tmp_path / "calibration.npz", tmp_path / "runs"
    if content is not None:
        file.write_bytes(content)
    settings = [f"sensor.optics_calibration={file}", f"run.output_directory={runs}"]
    with pytest.raises(ConfigError, match=r"calibration\.npz") as caught:
        refuse("dry-run", *(part for text in settings for part in ("--set", text)))
    assert "tacauchy-rig calibrate optics" in caught.value.remedy
    assert not runs.exists()


@pytest.mark.parametrize("command", ["replay", "resume"])
def test_lost_calibration_of_a_recorded_run_is_told_at_once(tmp_path: Path, command: str) -> None:
    """Neither the simulation nor the missing presses come first."""
    loaded = load_config(overrides=[f"sensor.optics_calibration={tmp_path / 'gone.npz'}"])
    store = RunStore.create(tmp_path, loaded, config_text="", simulated=True, versions={})
    with pytest.raises(ConfigError, match=r"gone\.npz does not exist"):
        refuse(command, str(store.paths.root))
    assert not list(store.paths.root.glob("trials/*/*"))


def test_dry_run_never_moves_a_real_arm(tmp_path: Path) -> None:
    """robot.driver = "ur5" belongs to ``run``."""
    settings = ["robot.driver=ur5", "robot.host=192.0.2.1", f"run.output_directory={tmp_path}"]
    written = load_config().written
    settings += [f"{field}={json.dumps(written[field])}" for field in ARM_REQUIRES]
    with pytest.raises(AbortedError, match="never moves a real arm"):
        refuse("dry-run", *(part for text in settings for part in ("--set", text)))


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_folder_without_permission_is_named(tmp_path: Path) -> None:
    """The folder and what to do stand in the message."""
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    with pytest.raises(RecordError, match="closed"):
        refuse("dry-run", "--set", f"run.output_directory={closed}")


def test_output_folder_that_is_a_file_is_named(tmp_path: Path) -> None:
    """A file in the way is no fault of the program."""
    (tmp_path / "runs").write_text("")
    with pytest.raises(RecordError, match="runs"):
        refuse("dry-run", "--set", f"run.output_directory={tmp_path / 'runs'}")


def test_a_lost_calibration_fails_with_what_to_do(tmp_path: Path) -> None:
    """The replay is looked at like a device: what would fail after the presses fails here."""
    settings = ["--set", "sensor.optics_calibration=gone.npz"]
    settings += ["--set", f"run.output_directory={tmp_path}"]
    done = CliRunner().invoke(app, ["doctor", "--host-only", *settings])
    assert done.exit_code == 1
    assert "FAIL  replay: optics calibration gone.npz does not exist" in done.stdout
    assert "-> write one with: tacauchy-rig calibrate optics" in done.stdout


FOUND: Any = object()
HERE: Any = SimpleNamespace(name="here")


def _store(*overrides: str) -> Any:
    config = load_config(None, overrides=overrides).config
    return SimpleNamespace(config=config, paths=SimpleNamespace(root="runs/7"))


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Each calibration of a sensor, by name."""
    made: list[str] = []

    def calibrate(sensor: Any) -> Any:
        made.append(sensor.name)
        say("calibrating")
        return FOUND

    monkeypatch.setattr(emulated_calibration, "emulated_calibration", lambda _: calibrate)
    return made


def test_what_began_while_recording_is_not_done_again(calls: list[str]) -> None:
    """What it said is said when it is asked for."""
    said: list[str] = []
    with ThreadPoolExecutor(1) as worker:
        calibrate = begin_calibration(_store(), worker)
        assert calibrate is not None
        with heard(said.append):
            assert calibrate(HERE) is FOUND
    assert (calls, said) == (["gelsight-mini"], ["calibrating"])


def test_a_killed_worker_is_named_and_the_calibration_done_here(calls: list[str]) -> None:
    """The replay does not end because of it."""
    gone: Future[Any] = Future()
    gone.set_exception(BrokenProcessPool("gone"))
    broken: Any = SimpleNamespace(submit=lambda *_: gone)
    calibrate = begin_calibration(_store(), broken)
    said: list[str] = []
    assert calibrate is not None
    with heard(said.append):
        assert calibrate(HERE) is FOUND
    assert calls == ["here"]
    assert "calibrating again" in said[0]


def test_a_calibration_file_leaves_nothing_to_begin(calls: list[str]) -> None:
    """Its optics are read, not fitted."""
    with ThreadPoolExecutor(1) as worker:
        store = _store('sensor.optics_calibration="optics.npz"')
        begin_calibration(store, worker)
    assert calls == []


def test_ctrl_c_tells_how_the_replay_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was recorded is whole, and the command names it."""

    def replay_run(*_: Any, **__: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr("tacauchy_rig.app.replay.replay.replay_run", replay_run)
    run: Any = SimpleNamespace(store=_store())
    with pytest.raises(AbortedError, match="Ctrl-C during the replay") as ended:
        run_folders.replay_and_show(run, None)
    assert "tacauchy-rig replay runs/7" in ended.value.remedy
