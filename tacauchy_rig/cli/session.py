"""Commands that press: ``dry-run``, ``run``, ``resume``; and ``recover`` after them."""

from __future__ import annotations

import shutil
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from drivers.emulators.launch import EmulatedAddresses, Emulation, emulated_devices, with_addresses
from drivers.emulators.plant.truth import TRUTH_FILE
from protocols.confirmation import confirmation_screen, expected_answer
from protocols.guard.abort import AbortWatch
from protocols.processes.supervisor import SessionResult
from protocols.session import run_session
from sim.sensor.sensor import load_sensor
from tacauchy_rig.cli.emulated_unit import emulated_unit
from tacauchy_rig.cli.missed import missed_lines
from tacauchy_rig.cli.options import JsonFile, Overrides, RequiredConfigFile, RunFolder
from tacauchy_rig.cli.output import complain, console, say, write_json
from tacauchy_rig.cli.progress import SessionProgress
from tacauchy_rig.cli.versions import versions
from tacauchy_rig.config.load import LoadedConfig, default_text, load_config
from tacauchy_rig.config.model import CameraDriver, ForceSensorDriver, RigConfig, RobotDriver
from tacauchy_rig.errors import AbortedError, RecordError
from tacauchy_rig.loop.replay_settings import check_replay
from tacauchy_rig.loop.replaying import read_run, replay_run, report_run
from tacauchy_rig.run import Outcome
from tacauchy_rig.store.free_space import check_free_space
from tacauchy_rig.store.recording.recover import RecoveryReport, recover_run
from tacauchy_rig.store.run_store import RunStore


def dry_run(
    overrides: Overrides = None,
    json_file: JsonFile = None,
    press_only: Annotated[
        bool, typer.Option("--press-only", help="Record only; no replay, no report.")
    ] = False,
) -> None:
    """Run the whole loop on emulated hardware: six presses, their replay and the report."""
    loaded = load_config(None, overrides=overrides or ())
    if loaded.config.moves_real_hardware:
        raise AbortedError(
            "a dry run never moves a real arm, but robot.driver is ur5",
            remedy="use `tacauchy-rig run rig.toml`",
        )
    _new_run(loaded, default_text(), press_only=press_only, json_file=json_file)


def run(
    path: RequiredConfigFile,
    overrides: Overrides = None,
    json_file: JsonFile = None,
    press_only: Annotated[
        bool, typer.Option("--press-only", help="Record only; no replay, no report.")
    ] = False,
) -> None:
    """Press as a configuration says, replay and report."""
    loaded = load_config(path, overrides=overrides or ())
    _new_run(loaded, path.read_text("utf-8"), press_only=press_only, json_file=json_file)


def resume(
    folder: RunFolder,
    json_file: JsonFile = None,
    press_only: Annotated[
        bool, typer.Option("--press-only", help="Record only; no replay, no report.")
    ] = False,
) -> None:
    """Continue a run at its first trial without a passed attempt; nothing is overwritten."""
    store = RunStore.open(folder)
    if not press_only:
        check_replay(store.config)
    for mended in recover_run(folder):
        _say_recovered(mended)
    _press_and_report(store, press_only=press_only, json_file=json_file)


def recover(folder: RunFolder, json_file: JsonFile = None) -> None:
    """Repair recordings that were cut off; the torn originals are kept beside them."""
    RunStore.open(folder)
    reports = recover_run(folder)
    for report in reports:
        _say_recovered(report)
    if not any(report.changed or report.problems for report in reports):
        say(f"{folder}: every recording is whole")
    write_json(json_file, {"recordings": reports})


def _say_recovered(report: RecoveryReport) -> None:
    if report.changed:
        merged = f", {report.merged_count} of them from spills" if report.merged_count else ""
        say(
            f"{report.path}: was {report.before}; {report.message_count} messages readable"
            f"{merged}; the original is kept as {report.original}"
        )
    for problem in report.problems:
        say(f"{report.path}: {problem}")


def _new_run(loaded: LoadedConfig, text: str, *, press_only: bool, json_file: Path | None) -> None:
    config = loaded.config
    if not press_only:  # a wrong name here must not wait until six presses are done
        check_replay(config)
    parent = Path(config.run.output_directory)
    check_free_space(parent, config)
    store = RunStore.create(
        parent, loaded, config_text=text, simulated=_is_simulated(config), versions=versions()
    )
    say(f"run folder {store.paths.root}")
    _press_and_report(store, press_only=press_only, json_file=json_file)


def _is_simulated(config: RigConfig) -> bool:
    return (
        config.robot.driver is not RobotDriver.UR5
        or config.force_sensor.driver is not ForceSensorDriver.M3733C
        or config.camera.driver is not CameraDriver.UVC
    )


def _press_and_report(store: RunStore, *, press_only: bool, json_file: Path | None) -> None:
    config = store.config
    if config.moves_real_hardware:
        _confirm(config)
    result = press(store)
    if result.outcome in (Outcome.FAULT, Outcome.ABORTED):
        _end_badly(store, result)
    _tell_missed(store, result)
    if press_only:
        say(f"recorded in {store.paths.root}")
        raise typer.Exit(result.exit_code)
    recorded = read_run(store)
    replay_run(recorded)
    summary = report_run(recorded)
    write_json(json_file, summary.content)
    raise typer.Exit(0 if summary.passed else 1)


def press(store: RunStore) -> SessionResult:
    """Run the session of a run folder, with its emulated devices if it has any."""
    config = store.config
    chosen = emulated_devices(config)
    with ExitStack() as stack:
        addresses = EmulatedAddresses()
        if chosen:
            follow = config.robot.host if config.moves_real_hardware else None
            emulation = Emulation(
                config,
                folder=store.paths.emulation,
                devices=chosen,
                follow_host=follow,
                unit=emulated_unit(
                    load_sensor(config.sensor.name), markers=config.emulation.markers
                ),
            )
            stack.callback(emulation.stop)
            say(f"starting emulated {', '.join(sorted(chosen))}")
            addresses = emulation.start()
            shutil.copyfile(store.paths.emulation / TRUTH_FILE, store.paths.truth)
        watch = stack.enter_context(AbortWatch())
        progress = stack.enter_context(SessionProgress(len(config.protocol.force_targets)))
        return run_session(
            store, with_addresses(config, addresses), on_event=progress, abort=watch.abort
        )


def _confirm(config: RigConfig) -> None:
    say(confirmation_screen(config))
    console.print("> ", end="")
    answer = sys.stdin.readline().strip()
    if answer != expected_answer(config):
        raise AbortedError(
            f"not confirmed: {answer!r} is not {expected_answer(config)!r}; nothing moved",
            remedy="run the same command again and type the sensor's name",
        )


def _tell_missed(store: RunStore, result: SessionResult) -> None:
    """Say on standard error what a run that went through to its end did not reach."""
    for line in missed_lines(result.records):
        complain(line)
    if result.outcome is Outcome.FAILED:
        complain(f"{result.reason}\n  -> `tacauchy-rig resume {store.paths.root}` repeats them")


def _end_badly(store: RunStore, result: SessionResult) -> None:
    remedy = result.remedy or f"`tacauchy-rig resume {store.paths.root}` continues"
    error = AbortedError if result.outcome is Outcome.ABORTED else RecordError
    raise error(result.reason, remedy=f"{remedy}\n  -> run folder {store.paths.root}")
