"""One fault case from start to finish: run, fault, what became of it, mend, resume."""

import logging
import math
import shutil
import time
from contextlib import closing
from pathlib import Path

from drivers.emulators.faults import Fault
from drivers.emulators.process import post_fault
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import Phase
from tacauchy_rig.core.store.run_store import RunStore
from tests.studies.fault_table.cases import (
    Blow,
    Cause,
    Crowd,
    FaultCase,
    HostTrouble,
    Moment,
    Rival,
    Trouble,
    Visitors,
)
from tests.studies.fault_table.emulated_rig import EmulatedRig
from tests.studies.fault_table.observation import (
    KILLED_EXIT_CODE,
    ArmOutcome,
    CommandEnd,
    Observation,
    acknowledged_messages,
    arm_after,
    force_rise,
    is_at_rest,
    kept_messages,
    true_forces,
)
from tests.studies.fault_table.watched_run import CommandProcess, WatchedRun

logger = logging.getLogger(__name__)

TRIES = 4
PHASE_TIMEOUT_S = 120.0
END_TIMEOUT_S = 60.0
RESUME_TIMEOUT_S = 180.0
RESUME_TRIES = 3
REST_TIMEOUT_S = 5.0
VERDICT = "passed"
_DISK = (Trouble.READ_ONLY, Trouble.DISK_FULL, Trouble.DISK_SLOW)
FORCE_WINDOW_NS = 60_000_000_000


def observe_case(case: FaultCase, folder: Path) -> Observation:
    """Run one case in ``folder`` and return what it showed.

    A run that ends before the moment of the fault, on a computer that is too busy to emulate,
    is repeated.
    """
    for number in range(1, TRIES + 1):
        shutil.rmtree(folder, ignore_errors=True)
        rig = EmulatedRig(folder, target_n=case.target_n, dwell_s=case.dwell_s)
        try:
            rig.devices.start()
            if case.moment is Moment.START and isinstance(case.cause, Fault):
                post_fault(rig.devices.folder, case.cause)
            with closing(_Case(case, rig)) as under_way:
                return under_way.observe(tries=number)
        except DeviceError as error:
            logger.warning("%s, try %d: %s", case.name, number, error)
        finally:
            rig.devices.stop()
    raise DeviceError(
        f"fault case {case.name}: no run of {TRIES} reached its {case.moment.value}",
        remedy="close what else keeps this computer busy; the last run is in " + str(folder),
    )


class _Case:
    """One case under way."""

    def __init__(self, case: FaultCase, rig: EmulatedRig) -> None:
        self._case = case
        self._rig = rig
        self._commands: list[CommandProcess] = []
        runs = rig.folder / "runs"
        self._trouble = None
        self._visitors: Visitors | None = None
        if isinstance(case.cause, Trouble):
            self._trouble = HostTrouble(rig.folder / "host", disk=runs)
        self._run = WatchedRun(self._begun(["run", str(rig.rig_toml)], name="run"), runs)

    def close(self) -> None:
        """End every command that still runs, and send visitors away."""
        if self._visitors is not None:
            self._visitors.close()
        for command in self._commands:
            command.close()

    def _begun(self, arguments: list[str], *, name: str) -> CommandProcess:
        """Return a command that moves the arm, with its confirmation typed."""
        trouble = None if self._trouble is None else self._trouble.environment
        command = CommandProcess(arguments, folder=self._rig.folder, name=name, environment=trouble)
        self._commands.append(command)
        command.confirm(self._rig.config)
        return command

    def observe(self, *, tries: int) -> Observation:
        """Wait for the moment, let it happen, and measure."""
        fault_ns = self._strike()
        exit_code = self._run.command.wait(END_TIMEOUT_S)
        hung = ["supervisor"] if self._run.command.hung else []
        hung += self._run.wait_until_gone()
        rivals = tuple(self._ended(command, END_TIMEOUT_S) for command in self._commands[1:])
        ended_after_s = (time.monotonic_ns() - fault_ns) * 1e-9
        arm, force_n, rise_n = self._look_at_arm(fault_ns)
        paths, attempts = self._run.paths, self._run.paths.attempts()
        acknowledged = acknowledged_messages(self._run.journal())
        kept = kept_messages(paths, attempts, acknowledged)
        told, measured = self._told(exit_code), self._measured()
        resumed = self._resume(paths.root)
        return Observation(
            name=self._case.name,
            force_target_n=self._case.target_n,
            tries=tries,
            arm=arm,
            force_at_fault_n=force_n,
            force_rise_n=rise_n,
            exit_code=exit_code,
            ended_after_s=ended_after_s,
            hung=tuple(hung),
            told=told,
            measured=measured,
            kept=kept,
            kept_after_resume=kept_messages(paths, attempts, acknowledged),
            resumed=resumed,
            rivals=rivals,
        )

    def _strike(self) -> int:
        """Wait for the moment and break something; return when that was [ns]."""
        moment, cause = self._case.moment, self._case.cause
        if moment is Moment.START:
            return self._search_or_end_ns()
        begun = self._run.wait_for_phase(moment.phase, timeout_s=PHASE_TIMEOUT_S)
        due_ns = begun.stamp_ns + round(moment.delay_s * 1e9)
        time.sleep(max(0.0, (due_ns - time.monotonic_ns()) * 1e-9))
        if self._run.command.process.poll() is not None:
            raise DeviceError(f"the run ended by itself: {self._run.command.error_text()}")
        fault_ns = time.monotonic_ns()
        self._do(cause)
        return fault_ns

    def _do(self, cause: Cause) -> None:
        match cause:
            case Fault():
                post_fault(self._rig.devices.folder, cause)
            case Blow():
                self._run.strike(cause)
            case Rival():
                self._begun(["run", str(self._rig.rig_toml)], name=cause.value)
            case Crowd():
                self._visitors = Visitors(self._run.page_address()).come(cause)
            case Trouble() if self._trouble is not None:
                self._trouble.begin(cause)

    def _search_or_end_ns(self) -> int:
        """Wait for the search, or for the end of a run that came to none; return when [ns]."""
        try:
            begun = self._run.wait_for_phase(Moment.START.phase, timeout_s=PHASE_TIMEOUT_S)
        except DeviceError:
            if self._run.command.process.poll() is None or not self._run.journal():
                raise
            return time.monotonic_ns()
        # At its very begin the arm still stands, which is no stop.
        return begun.stamp_ns + round(Moment.START.delay_s * 1e9)

    def _look_at_arm(self, fault_ns: int) -> tuple[ArmOutcome, float, float]:
        deadline = time.monotonic() + REST_TIMEOUT_S
        time.sleep(0.3)
        rows = self._rig.arm_trace()
        while not is_at_rest(rows, now_ns=time.monotonic_ns()) and time.monotonic() < deadline:
            time.sleep(0.1)
            rows = self._rig.arm_trace()
        now_ns = time.monotonic_ns()
        forces = true_forces(
            self._rig.devices.gel(),
            rows,
            rotation=self._rig.config.robot.tool_rotation,
            start_ns=self._search_start_ns(fault_ns),
            end_ns=min(now_ns, fault_ns + FORCE_WINDOW_NS),
        )
        return arm_after(rows, fault_ns, now_ns=now_ns), *force_rise(
            forces, fault_ns, until_ns=now_ns
        )

    def _search_start_ns(self, fault_ns: int) -> int:
        """Return when the first search began [ns]; the fault's moment where none did."""
        phases = [event for event in self._run.journal() if event.name == "phase"]
        searches = (e.stamp_ns for e in phases if e.detail["phase"] == Phase.SEARCH.value)
        return next(searches, fault_ns)

    def _told(self, exit_code: int) -> str:
        """Return what the operator read last.

        That is the last error; of a run that went on its verdict or each criterion that it missed;
        of a killed program what its journal says.
        """
        command = self._run.command
        if exit_code == 0:
            return "".join(_starting_with(VERDICT, command.output())[-1:])
        if exit_code == 1:
            return self._rig.without_places("\n".join(_starting_with("missed: ", command.errors())))
        if exit_code != KILLED_EXIT_CODE:
            return self._rig.without_places(command.error_text())
        ends = [e for e in self._run.journal() if e.name in ("fault", "abort")]
        return f"{ends[-1].detail['reason']}. {ends[-1].detail['arm']}" if ends else ""

    def _measured(self) -> dict[str, float]:
        record = RunStore.open(self._run.paths.root).latest(1)
        rates = {} if record is None else dict(record.rates)
        return {name: value for name, value in rates.items() if math.isfinite(value)}

    def _resume(self, run: Path) -> tuple[CommandEnd, ...]:
        cause = self._case.cause
        self._rig.mend(cause if isinstance(cause, Fault) else None)
        if self._trouble is not None and cause in _DISK:  # a clock stays as it is
            self._trouble.end()
        resumed: list[CommandEnd] = []
        while len(resumed) < RESUME_TRIES and not (resumed and resumed[-1].exit_code == 0):
            command = self._begun(["resume", str(run)], name=f"resume-{len(resumed) + 1}")
            resumed.append(self._ended(command, RESUME_TIMEOUT_S))
        return tuple(resumed)

    def _ended(self, command: CommandProcess, timeout_s: float) -> CommandEnd:
        exit_code = command.wait(timeout_s)
        return CommandEnd(exit_code=exit_code, told=self._rig.without_places(command.error_text()))


def _starting_with(start: str, text: str) -> list[str]:
    lines = (line.strip() for line in text.splitlines())
    return [line for line in lines if line.startswith(start)]
