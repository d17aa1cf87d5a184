"""Commands that press: ``dry-run``, ``run``, ``resume``."""

from __future__ import annotations

import os
import resource
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drivers.device_checks import require_devices
from tacauchy_rig.app.cli import output
from tacauchy_rig.app.cli.live_viewing import TWIN_WORDS, port_of, told_of_errors, viewers_of
from tacauchy_rig.core.config.load import default_text, load_config, resumed_config
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.doctor_check import CheckStatus
from tacauchy_rig.core.errors import AbortedError, ConfigError, RecordError, RigError, command_line
from tacauchy_rig.core.known_weight import Weight, parse_weight
from tacauchy_rig.core.run import ExpectedPress, Outcome
from tacauchy_rig.core.time_limit_and_progress import doing

if TYPE_CHECKING:
    from protocols.processes.supervisor import SessionResult
    from tacauchy_rig.core.store.run_store import RunStore

EMULATED_WEIGHT = "200g"
"""Hung on an emulated cell if the arm requires a check; it weighs about 2 N."""
LOWEST_PRIORITY = 19
"""Niceness of what is computed while devices are served."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What the options of a command that presses ask for, as they are written.

    Args:
        press_only: Record only; no replay, no report.
        check_weight (MASS): Check the cell with a weight of this mass before anything moves: 200g,
            200g+-1g.
        page (PORT|off): Port of the operator's page; `off` serves none, `auto` takes a free one.
        open_page: Open the page in a browser.
        twin (on|depth|off): A simulation that follows the measured force (on) or the arm's depth
            (depth).
        foxglove (PORT|off): Show the run to Foxglove, Lichtblick or PlotJuggler on this machine;
            8765 is usual.

    Attributes:
        again: Trials to press once more though they have a passed attempt.
        is_whole: Nothing of the run's earlier sessions is lost.

    Raises:
        ConfigError: ``--page`` or ``--foxglove`` is no port, ``--twin`` no word for one, or
            ``--check-weight`` no mass.
    """

    press_only: bool = False
    check_weight: str | None = None
    page: str = "auto"
    open_page: Annotated[bool, typer.Option("--open")] = False
    twin: str = "off"
    foxglove: str = "off"
    again: frozenset[int] = frozenset()
    is_whole: bool = True

    def __post_init__(self) -> None:
        if self.twin not in TWIN_WORDS:
            raise ConfigError(
                f"--twin {self.twin}: no such twin", remedy="give `on`, `depth` or `off`"
            )
        _ = self.page_port, self.foxglove_port, self.weight

    @property
    def page_port(self) -> int | None:
        """Of the page; 0 is a free one, None no page."""
        return port_of("--page", self.page)

    @property
    def foxglove_port(self) -> int | None:
        """That Foxglove's protocol is spoken at; None for none."""
        return port_of("--foxglove", self.foxglove)

    @property
    def weight(self) -> Weight | None:
        """Checks the cell before anything moves; None leaves that out."""
        return None if self.check_weight is None else parse_weight(self.check_weight)


def dry_run(request: Request, overrides: output.Overrides = None) -> output.Found:
    """Make six presses on emulated hardware, replay them and report.

    Example: tacauchy-rig dry-run --set protocol.force_targets='["1 N", "3 N"]'
    """
    config = load_config(None, overrides=overrides or ()).config
    if config.moves_real_hardware:
        raise AbortedError(
            f"a dry run never moves a real arm, but robot.driver is {config.robot.driver}",
            remedy="use `tacauchy-rig run rig.toml`",
        )
    store = _created(None, overrides or (), press_only=request.press_only)
    return _press_and_report(store, store.config, request)


def run(
    request: Request, path: output.RequiredConfigFile, overrides: output.Overrides = None
) -> output.Found:
    """Make the presses of a configuration, replay them and report.

    Example: tacauchy-rig run rig.toml --page 8080
    """
    store = _created(path, overrides or (), press_only=request.press_only)
    return _press_and_report(store, store.config, request)


def resume(
    request: Request,
    folder: output.RunFolder,
    *,
    overrides: output.Overrides = None,
    again: list[int] | None = None,
) -> output.Found:
    """Continue a run at its first trial without a passed attempt; nothing is overwritten.

    Example: tacauchy-rig resume runs/20261123-gelsight-mini

    Args:
        overrides (TABLE.FIELD=VALUE): Change a device's address or a limit; may be repeated. Noted
            in the journal.
        again (TRIAL): Press a passed trial once more.
    """
    from tacauchy_rig.app.cli.replay_report_export_serve import say_recovered
    from tacauchy_rig.app.session.record_run_and_weight_check import note_changes
    from tacauchy_rig.core.store.recovery import recover_run
    from tacauchy_rig.core.store.run_store import RunStore

    store = RunStore.open(folder)
    config, changes = resumed_config(store.description["written"], overrides or ())
    _check_before(config, press_only=request.press_only)
    with store.lock():  # refuses a run that is busy or read-only before anybody is asked
        pass
    count = len(config.protocol.force_targets)
    for trial in again or ():
        if not 1 <= trial <= count:
            raise ConfigError(
                f"--again {trial}: this run has the trials 1 to {count}",
                remedy="protocol.force_targets lists them in order",
            )
    recovery = recover_run(store)
    say_recovered(recovery)
    require_devices(config)
    for change in changes:
        output.say(f"changed: {change}")
    note_changes(store, changes)
    return _press_and_report(
        store, config, replace(request, again=frozenset(again or ()), is_whole=recovery.is_whole)
    )


def recorded(path: Path | None, overrides: Sequence[str]) -> RunStore:
    """Return a run, or a new one of what a configuration says, without replay and report.

    Args:
        path: A run's folder, or a rig.toml; the dry run's if absent.

    Raises:
        RecordError: It could not be pressed; also where a trial missed a criterion.
    """
    from tacauchy_rig.core.store.run_store import RunStore

    if path is not None and path.is_dir():
        return RunStore.open(path)
    store = _created(path, overrides, press_only=True)
    result = _press_confirmed(store, store.config, Request(page="off", press_only=True))
    if result.exit_code:
        raise RecordError(result.reason, remedy=f"see the journal of {store.paths.root}")
    return store


@doing("preparing the run")
def _created(path: Path | None, overrides: Sequence[str], *, press_only: bool) -> RunStore:
    """Make a run's folder of a configuration, the dry run's if there is no file."""
    from tacauchy_rig.app.session.record_run_and_weight_check import create_run

    loaded = load_config(path, overrides=overrides)
    text = default_text() if path is None else path.read_text("utf-8")
    _check_before(loaded.config, press_only=press_only)
    require_devices(loaded.config)
    store = create_run(loaded, text)
    output.say(f"run folder {store.paths.root}")
    return store


@doing("checking simulator and gel")
def _check_before(config: RigConfig, *, press_only: bool) -> None:
    """Refuse what must not wait until six presses are done, or until the gel is torn."""
    from tacauchy_rig.app.host_checks import descriptor_check
    from tacauchy_rig.app.replay.simulator_inputs import check_gel, check_replay, inputs_of

    descriptors = descriptor_check(resource.getrlimit(resource.RLIMIT_NOFILE)[0])
    if descriptors.status is CheckStatus.FAIL:
        raise RecordError(descriptors.finding, remedy=descriptors.remedy)
    inputs_of(config)
    check_gel(config)
    if not press_only:
        check_replay(config)


def _press_and_report(store: RunStore, config: RigConfig, request: Request) -> output.Found:
    from tacauchy_rig.app.cli.emulated_calibration import begin_calibration
    from tacauchy_rig.app.cli.replay_report_export_serve import replay_and_show, reported
    from tacauchy_rig.app.replay.open_run import open_run
    from tacauchy_rig.core.parallel import worker_process

    if request.press_only:
        result = _press_confirmed(store, config, request)
        output.say(f"recorded in {store.paths.root}")
        raise typer.Exit(result.exit_code or int(not request.is_whole))
    with worker_process() as worker:
        begun = []

        def begin() -> None:
            begun.append(begin_calibration(store, worker, niceness=LOWEST_PRIORITY))

        # A twin takes what the devices leave of the processors.
        is_busy = request.twin != "off" or len(os.sched_getaffinity(0)) < 2
        result = _press_confirmed(store, config, request, None if is_busy else begin)
        with told_of_errors(result.page):
            calibrate = begun[0] if begun else begin_calibration(store, worker)
            reading = open_run(store.paths.root)
            replay_and_show(reading, calibrate, page=result.page)
            return reported(reading, page=result.page)


def _press_confirmed(
    store: RunStore, config: RigConfig, request: Request, on_start: Callable[[], None] | None = None
) -> SessionResult:
    """Press once a person has agreed; end the program where a fault or a person ended the run."""
    from tacauchy_rig.app.cli.operator_prompts import confirm
    from tacauchy_rig.app.session import record_run_and_weight_check as session

    if request.weight is None and session.needs_weight(config) and config.force_sensor.is_emulated:
        request = replace(request, check_weight=EMULATED_WEIGHT)  # hung without a hand
    if request.weight is None:
        session.require_bounded_force(store, config)
        if note := session.standing_check(store):
            output.say(note)
    elif not config.force_sensor.is_emulated:  # while the person who called this is still there
        _check_force(store, config, request.weight)
    with doing("computing the force expected of the gel"):
        expected = session.kept_expectation(store)  # here, so that what is confirmed moves at once
    made = expected.made if expected else "unknown; the arm's estimate and the camera are left"
    output.say(f"force expected of the gel: {made}")
    if config.moves_real_hardware:
        confirm(config)
    result = press(store, config, request, expected, on_start)
    resumed = f"`{command_line('resume', store.paths.root)}`"
    if result.outcome in (Outcome.FAULT, Outcome.ABORTED):
        error = AbortedError if result.outcome is Outcome.ABORTED else RecordError
        remedy = f"{result.remedy or f'{resumed} continues'}\n  -> run folder {store.paths.root}"
        raise error(result.reason, remedy=remedy)
    for line in session.missed_lines(result.records):
        output.complain(line)
    if result.outcome is Outcome.FAILED:
        output.complain(f"{result.reason}\n  -> {resumed} repeats them")
    return result


def press(
    store: RunStore,
    config: RigConfig,
    request: Request,
    expected: ExpectedPress | None = None,
    on_start: Callable[[], None] | None = None,
) -> SessionResult:
    """Press every trial without a passed attempt, on emulated devices if the run has any.

    A real arm moves, and nothing here asks whether it may. Ctrl-C, SIGTERM and a lost terminal end
    the session.

    Args:
        config: The run's configuration, with what was changed since it began.
        expected: Force against depth that the gel should give; None if unknown.
        on_start: Called when the emulated devices have started and the cell was checked.
    """
    from drivers.emulators.launch import Emulation, emulated_devices
    from drivers.emulators.plant.truth import TRUTH_FILE
    from protocols.guard.abort import AbortWatch
    from protocols.processes.child_process import listen
    from protocols.processes.ipc import PageOptions
    from protocols.processes.supervisor import run_session
    from protocols.trials.trial_sequence import plan_session
    from sim.sensor.sensor import load_sensor
    from tacauchy_rig.app.cli.emulated_calibration import emulated_unit
    from tacauchy_rig.app.cli.live_viewing import contact_outline
    from tacauchy_rig.app.cli.session_progress import SessionProgress
    from tacauchy_rig.app.session.record_run_and_weight_check import require_bounded_force

    port = request.page_port
    if port:  # one that is taken is refused before anything is started for nothing
        listen(port).close()
    viewers = viewers_of(twin=TWIN_WORDS[request.twin], foxglove=request.foxglove_port)
    chosen = emulated_devices(config)
    with ExitStack() as stack:
        running = config
        if chosen:
            follow = config.robot.host if config.moves_real_hardware else None
            sensor = load_sensor(config.sensor.name)
            emulation = Emulation(
                config,
                folder=store.paths.emulation,
                devices=chosen,
                follow_host=follow,
                unit=emulated_unit(sensor, markers=config.emulation.markers),
            )
            output.say(f"starting emulated {', '.join(sorted(chosen))}")
            with doing("starting emulated devices"):
                running = stack.enter_context(emulation).running
            with store.lock():
                store.truth.write((store.paths.emulation / TRUTH_FILE).read_bytes())
        if request.weight is None or config.force_sensor.is_emulated:
            _check_force(store, running, request.weight)
        if on_start is not None:
            on_start()
        progress = SessionProgress(
            config,
            plan=plan_session(store, again=request.again),
            expected=expected,
            open_page=request.open_page,
        )
        page = None if port is None else PageOptions(port=port, outline=contact_outline(config))
        require_bounded_force(store, running)
        with progress, AbortWatch() as watch:
            result = run_session(
                store,
                running,
                on_event=progress,
                abort=watch.abort,
                expected=expected,
                again=request.again,
                page=page,
                viewers=viewers,
                keep_page=not request.press_only,
            )
        if result.outcome is Outcome.PASSED:
            try:
                _check_force_after(store, running, request.weight)
            except RigError:
                with told_of_errors(result.page):
                    raise
        return result


def _check_force(store: RunStore, config: RigConfig, weight: Weight | None) -> None:
    """Check the cell by the weight; without one, mark an earlier check that has expired."""
    from tacauchy_rig.app.cli.operator_prompts import ask_for_weight, hang_emulated
    from tacauchy_rig.app.session.record_run_and_weight_check import check_cell, mark_expired

    if weight is None:
        mark_expired(store)
        return
    is_emulated, folder = config.force_sensor.is_emulated, store.paths.emulation
    ask = hang_emulated(weight, folder) if is_emulated else ask_for_weight(weight)
    check = check_cell(store, config, weight, ask=ask)
    output.say(f"force checked: {check.finding}")


def _check_force_after(store: RunStore, config: RigConfig, weight: Weight | None) -> None:
    """Check the cell once more after the last trial where it had to be, or was, checked before."""
    from tacauchy_rig.app.session.record_run_and_weight_check import ForceCheckError, needs_weight

    before = store.force_check.load()
    if weight is None and before is not None and needs_weight(config):
        weight = before.weight
    if weight is None:
        return
    try:
        _check_force(store, config, weight)
    except ForceCheckError as error:
        error.message = f"after the last trial {error.message}. No trial of this run is safe."
        raise
    except AbortedError as error:
        output.say(f"force not checked at the end: {error.message}")
