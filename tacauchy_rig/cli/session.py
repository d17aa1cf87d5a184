"""Commands that press: ``dry-run``, ``run``, ``resume``."""

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
from protocols.processes.supervisor import SessionResult
from sim.sensor.sensor import load_sensor
from tacauchy_rig.cli.emulation import emulated_unit
from tacauchy_rig.cli.folders import replay_and_show, report_and_exit, say_recovered
from tacauchy_rig.cli.options import JsonFile, Overrides, RequiredConfigFile, RunFolder
from tacauchy_rig.cli.output import complain, console, say
from tacauchy_rig.cli.progress import SessionProgress
from tacauchy_rig.config.load import LoadedConfig, default_text, load_config
from tacauchy_rig.config.model import RigConfig
from tacauchy_rig.errors import AbortedError, RecordError
from tacauchy_rig.loop.gel_limits import check_gel
from tacauchy_rig.loop.opening import open_run
from tacauchy_rig.loop.record import create_run, missed_lines, record_run
from tacauchy_rig.loop.settings import check_names, check_replay
from tacauchy_rig.run import Outcome
from tacauchy_rig.store.recording.recover import recover_run
from tacauchy_rig.store.run_store import RunStore

PressOnly = Annotated[bool, typer.Option("--press-only", help="Record only; no replay, no report.")]


def dry_run(
    overrides: Overrides = None,
    json_file: JsonFile = None,
    press_only: PressOnly = False,
) -> None:
    """Run the whole loop on emulated hardware: six presses, their replay and the report."""
    loaded = load_config(None, overrides=overrides or ())
    if loaded.config.moves_real_hardware:
        raise AbortedError(
            f"a dry run never moves a real arm, but robot.driver is {loaded.config.robot.driver}",
            remedy="use `tacauchy-rig run rig.toml`",
        )
    _new_run(loaded, default_text(), press_only=press_only, json_file=json_file)


def run(
    path: RequiredConfigFile,
    overrides: Overrides = None,
    json_file: JsonFile = None,
    press_only: PressOnly = False,
) -> None:
    """Press as a configuration says, replay and report."""
    loaded = load_config(path, overrides=overrides or ())
    _new_run(loaded, path.read_text("utf-8"), press_only=press_only, json_file=json_file)


def resume(
    folder: RunFolder,
    json_file: JsonFile = None,
    press_only: PressOnly = False,
) -> None:
    """Continue a run at its first trial without a passed attempt; nothing is overwritten."""
    store = RunStore.open(folder)
    _check_before(store.config, press_only=press_only)
    for mended in recover_run(folder):
        say_recovered(mended)
    _press_and_report(store, press_only=press_only, json_file=json_file)


def _new_run(loaded: LoadedConfig, text: str, *, press_only: bool, json_file: Path | None) -> None:
    _check_before(loaded.config, press_only=press_only)
    store = create_run(loaded, text)
    say(f"run folder {store.paths.root}")
    _press_and_report(store, press_only=press_only, json_file=json_file)


def _check_before(config: RigConfig, *, press_only: bool) -> None:
    """Refuse what must not wait until six presses are done, or until the gel is torn."""
    check_names(config)
    check_gel(config)
    if not press_only:
        check_replay(config)


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
    recorded = open_run(store.paths.root)
    replay_and_show(recorded)
    report_and_exit(recorded, json_file)


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
        progress = stack.enter_context(SessionProgress(len(config.protocol.force_targets)))
        return record_run(store, with_addresses(config, addresses), on_event=progress)


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
