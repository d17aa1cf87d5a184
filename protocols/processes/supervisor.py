"""The parent of a run's processes: starts them, watches them, and says plainly what became of it.

Nothing here can hold up a stop: an abort goes to control from the signal handler itself, control
listens in a thread of its own, and a child that stops answering is killed, upon which the arm's
own watchdog stops it.
"""

import logging
import select
import threading
import time
from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, field, replace
from typing import Any, Self

from drivers.interfaces import DeviceIdentity
from protocols.guard.abort import Abort
from protocols.processes.child_process import CONTROL_ENDED, Launched, Viewing, launch_children
from protocols.processes.ipc import AbortRequest, Ack, Job, Order, PageOptions, Ready, ViewerOptions
from protocols.trials.trial_sequence import ProgrammeResult, describe_safe, plan_session
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import AbortedError, DeviceError, RecordError, RigError, command_line
from tacauchy_rig.core.run import ExpectedPress, JournalEvent, Outcome, TrialRecord
from tacauchy_rig.core.store.journal import append_event
from tacauchy_rig.core.store.run_store import RunStore

logger = logging.getLogger(__name__)

POLL_S = 0.05
HEARTBEAT_S = 0.1
SILENT_S = 3.0
START_MARGIN_S = 30.0
ABORT_TIMEOUT_S = 30.0
END_TIMEOUT_S = 6.0
_CHECK_DISK = "check the disk, then `tacauchy-rig resume` tries them again"


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionResult(ProgrammeResult):
    """How a session ended."""

    died: dict[str, str]  # processes that ended before they were told to, and how
    # Samples, frames and events that the recorder acknowledged, by producer, as far as the producer
    # lived to tell.
    acknowledged: dict[str, int]
    # The page that was kept; None without one.
    page: Viewing | None = field(default=None, repr=False, compare=False)

    @property
    def exit_code(self) -> int:
        """0 pass, 1 criteria missed, 2 error, 3 aborted."""
        codes = {Outcome.PASSED: 0, Outcome.FAILED: 1, Outcome.FAULT: 2, Outcome.ABORTED: 3}
        return codes[self.outcome]


class Supervisor:
    """One session's processes; a context that leaves none of them behind.

    The caller has locked the run's folder; for the arguments see ``run_session``.
    """

    def __init__(
        self,
        store: RunStore,
        job: Job,
        viewing: Viewing,
        *,
        on_event: Callable[[JournalEvent], None],
        abort: Abort,
        keep_page: bool = False,
    ) -> None:
        self._store, self._job, self._viewing = store, job, viewing
        self._keep_page = keep_page
        self._on_event = on_event
        self._abort = abort
        self._children: dict[str, Launched] = {}
        self._devices: dict[str, DeviceIdentity] = {}
        self._ready: set[str] = set()
        self._failures: dict[str, RigError] = {}
        self._acknowledged: dict[str, int] = {}
        self._died: dict[str, str] = {}
        self._begun: list[JournalEvent] = []
        self._finished: ProgrammeResult | None = None
        self._ended = threading.Event()

    def __enter__(self) -> Self:
        self._children = launch_children(self._job, self._viewing.feeds)
        self._viewing.start()
        control = self._children["control"].channel
        self._abort.on_request(lambda reason: control.send(AbortRequest(reason=reason)))
        threading.Thread(target=self._send_heartbeats, name="heartbeat", daemon=True).start()
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        if error is not None:
            # Whoever watches has failed; the arm is still to be made safe and the record finished.
            self._on_event = _discard
            self._end_children()
            reason = f"the watching program failed: {error}"
            complete_results(self._store, self._begun, reason=reason)
        self._ended.set()
        if error is not None or not self._keep_page:
            self._viewing.close()
        for child in self._children.values():
            child.close()

    def run(self) -> SessionResult:
        """Connect, run the programme, end every process, and say how it went."""
        if self._viewing.address:
            # Shown and not kept: whoever has it can stop the arm.
            self._show(JournalEvent.now("page", address=self._viewing.address))
        self._await_ready()
        if self._abort.count:
            self._end_children()
            reason = f"aborted before anything moved: {self._abort.reason}."
            return self._result(Outcome.ABORTED, reason)
        everyone = [*self._children.values(), *self._viewing.running()]
        pids = {child.name: child.process.pid for child in everyone}
        self._note("run-start", pids=pids)
        self._children["control"].channel.send(Order.GO)
        self._watch()
        self._viewing.send(JournalEvent.now(CONTROL_ENDED))
        self._end_children()
        reason = "; ".join(self._died.values()) or "the attempt was cut off"
        complete_results(self._store, self._begun, reason=reason)
        result = self._conclude()
        how = {"outcome": result.outcome.value, "reason": result.reason}
        self._note("run-end", **how, acknowledged=result.acknowledged)
        went_through = result.outcome in (Outcome.PASSED, Outcome.FAILED)
        self._keep_page &= went_through and bool(self._viewing.address)
        self._viewing.end(keep_page=self._keep_page)
        return replace(result, page=self._viewing) if self._keep_page else result

    def _send_heartbeats(self) -> None:
        while not self._ended.wait(HEARTBEAT_S):
            self._children["control"].channel.send(Order.ALIVE)

    def _await_ready(self) -> None:
        config = self._job.config
        arm_side_s = config.robot.connect_timeout * 2 + config.force_sensor.connect_timeout
        connect_s = max(arm_side_s, config.camera.connect_timeout)
        deadline = time.monotonic() + START_MARGIN_S + connect_s
        while (
            len(self._ready) + len(self._failures) < len(self._children) and not self._abort.count
        ):
            self._listen()
            is_late = time.monotonic() > deadline
            for name, child in self._children.items():
                if name in self._ready or name in self._failures:
                    continue
                why = f"{name}: not ready before its deadline" if is_late else ""
                if child.has_ended:
                    self._listen()
                    why = child.describe_end()
                if why:
                    self._failures.setdefault(name, DeviceError(why, remedy=f"read {child.log}"))
        if self._failures and not self._abort.count:
            self._end_children()
            raise DeviceError(
                "\n".join(failure.message for failure in self._failures.values()),
                remedy="; ".join(f.remedy for f in self._failures.values() if f.remedy),
            )
        if self._devices:
            self._store.set_devices(self._devices)

    def _watch(self) -> None:
        """Listen until control has finished or is gone."""
        control = self._children["control"]
        control.last_message_s = time.monotonic()
        aborted_s: float | None = None
        while self._finished is None:
            self._listen()
            if control.has_ended:
                self._listen()
                return
            for child in (self._children["recorder"], self._children["camera"]):
                if child.has_ended and child.name not in self._died:
                    self._note_death(child)
            for name, happened in self._viewing.restart_ended():
                self._note("process-died", process=name, how=happened)
            now_s = time.monotonic()
            if self._abort.count and aborted_s is None:
                aborted_s = now_s
            overdue = aborted_s is not None and now_s - aborted_s > ABORT_TIMEOUT_S
            if now_s - control.last_message_s > SILENT_S or overdue:
                logger.error("control does not answer; ending it")
                control.kill()

    def _note_death(self, child: Launched) -> None:
        failure = self._failures.get(child.name)
        gave_up = failure and f"the {child.name} process gave up: {failure.message}"
        self._died[child.name] = gave_up or child.describe_end()
        self._note("process-died", process=child.name, how=self._died[child.name])

    def _listen(self) -> None:
        """Wait for messages, at most ``POLL_S``, and take them."""
        everyone = [*self._children.values(), *self._viewing.running()]
        heard = {one.channel.fileno(): one for one in everyone if not one.channel.closed}
        if not heard:
            time.sleep(POLL_S)
            return
        for descriptor in select.select(list(heard), [], [], POLL_S)[0]:
            for message in heard[descriptor].receive():
                self._take(heard[descriptor].name, message)

    def _take(self, name: str, message: Any) -> None:
        match message:
            case JournalEvent():
                if message.name == "attempt-start":
                    self._begun.append(message)
                self._show(message)
            case Ack(kept_count=count):
                self._acknowledged[name] = count
            case Ready(devices=devices) if name in self._children:
                self._ready.add(name)
                self._devices.update(devices)
            case AbortRequest(reason=reason):
                self._abort.request(reason)
            case RigError() if name in self._children:
                self._failures[name] = message
            case ProgrammeResult():
                self._finished = message

    def _end_children(self) -> None:
        """Let each finish in the order in which they depend on one another."""
        if self._finished is None:
            self._children["control"].channel.send(AbortRequest(reason="the session ends"))
        for name in ("control", "camera", "recorder"):
            child = self._children[name]
            child.channel.send(Order.STOP)
            deadline = time.monotonic() + END_TIMEOUT_S
            while not child.has_ended and time.monotonic() < deadline:
                self._listen()
            child.kill()
            died = child.process.returncode < 0 or (name == "control" and not self._finished)
            if died and name not in self._died and len(self._ready) == len(self._children):
                self._note_death(child)
        self._listen()

    def _conclude(self) -> SessionResult:
        finished = self._finished
        if finished is None:
            deaths = "; ".join(self._died[n] for n in self._died if n not in self._failures)
            return self._without_control(self._failures.get("control"), deaths)
        result = self._result(finished.outcome, finished.reason, remedy=finished.remedy)
        kept, passed = (
            {(r.index, r.attempt) for r in each.records if r.passed} for each in (result, finished)
        )
        unsaved = sorted(index for index, _ in passed - kept)
        if unsaved:
            text = f"the results of trials {unsaved} could not be kept. {self._safe_trials()}"
            return replace(result, outcome=Outcome.FAULT, reason=text, remedy=_CHECK_DISK)
        if finished.outcome is Outcome.PASSED:
            return result
        unreported, remedies = [], []
        for name, death in self._died.items():
            failure = self._failures.get(name)
            # One that gave up may have told control why, and control says it again.
            if failure is None or failure.message not in result.reason:
                unreported.append(death)
                remedies += [failure.remedy] if failure else []
        if not unreported:
            return result
        reason, remedy = f"{'; '.join(unreported)}. {result.reason}", "; ".join(remedies)
        return replace(result, reason=reason, remedy=remedy or result.remedy)

    def _without_control(self, failure: RigError | None, deaths: str) -> SessionResult:
        """Conclude where control left no result: it said why, or it was killed."""
        if failure is not None:
            aborted = failure.exit_code == AbortedError.exit_code
            outcome = Outcome.ABORTED if aborted else Outcome.FAULT
            return self._result(
                outcome, f"{failure.message}. {self._safe_trials()}", remedy=failure.remedy
            )
        watchdog = "Without control the robot's own watchdog stops the arm: go and look at it."
        return self._result(Outcome.FAULT, f"{deaths}. {watchdog} {self._safe_trials()}")

    def _safe_trials(self) -> str:
        return describe_safe([trial.index for trial in plan_session(self._store) if trial.done])

    def _result(self, outcome: Outcome, reason: str, *, remedy: str = "") -> SessionResult:
        resume = f"`{command_line('resume', self._store.paths.root)}` continues"
        last = {event.trial: event.attempt for event in self._begun}
        loaded = (self._store.load_result(trial, attempt) for trial, attempt in last.items())
        return SessionResult(
            outcome=outcome,
            records=tuple(filter(None, loaded)),
            reason=reason,
            remedy="" if outcome is Outcome.PASSED else remedy or resume,
            died=dict(self._died),
            acknowledged=dict(self._acknowledged),
        )

    def _note(self, name: str, **detail: Any) -> None:
        event = JournalEvent.now(name, **detail)
        try:
            append_event(self._store.paths.journal, event)
        except RecordError as error:
            logger.error("%s", error)
        self._show(event)

    def _show(self, event: JournalEvent) -> None:
        self._viewing.send(event)
        try:
            self._on_event(event)
        except OSError as error:
            # A terminal that is gone refuses every word; the run must end safely all the same.
            logger.error("nobody can be told any more: %s", error)
            self._on_event = _discard
            self._abort.request("the terminal was lost")


def _discard(_: JournalEvent) -> None:
    """Show nothing: nobody is there to see it."""


def run_session(
    store: RunStore,
    config: RigConfig,
    *,
    on_event: Callable[[JournalEvent], None],
    abort: Abort,
    expected: ExpectedPress | None = None,
    again: Set[int] = frozenset(),
    page: PageOptions | None = None,
    viewers: Sequence[ViewerOptions] = (),
    keep_page: bool = False,
) -> SessionResult:
    """Run every trial without a passed attempt, with a process each for control, camera, record.

    Args:
        config: Its configuration, with the addresses of emulated devices filled in.
        on_event: Told of every journal event, and of ``progress`` five times a second, in this
            thread.
        abort: Asked at every turn of the control loop; see ``protocols.guard.abort``.
        again: Trials to press once more though they have a passed attempt.
        page: The operator's page; None for none. Its address comes as the event ``page``.
        keep_page: Leave the page open after a run that went through to its end; ``page`` of the
            result is then for the caller to release.

    Raises:
        ConfigError: The page's port is taken.
        RecordError: Another program works on the run.
        DeviceError: Devices did not connect; all of them are named.
    """
    with store.lock():
        job = Job(
            root=store.paths.root.resolve(),
            config=config,
            plan=plan_session(store, again=again),
            descriptors={},
            expected=expected,
        )
        viewing = Viewing(page, job, viewers)
        with Supervisor(
            store, job, viewing, on_event=on_event, abort=abort, keep_page=keep_page
        ) as parent:
            return parent.run()


def complete_results(store: RunStore, begun: Sequence[JournalEvent], *, reason: str) -> None:
    """Mark each attempt that was begun and has no result as a fault, and seal the others."""
    for event in begun:
        record = store.load_result(event.trial, event.attempt) or TrialRecord(
            index=event.trial,
            attempt=event.attempt,
            outcome=Outcome.FAULT,
            force_target_n=float(event.detail["force_target_n"]),
            reason=reason,
        )
        try:
            store.save_result(record)
        except RecordError as error:
            logger.error("%s", error)
