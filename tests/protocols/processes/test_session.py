"""Real processes over mocks, in real time, killed in the middle."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import psutil
import pytest

from protocols.guard.abort import Abort
from protocols.processes.supervisor import run_session
from protocols.trials.trial_sequence import plan_session
from tacauchy_rig.core.errors import DeviceError, RecordError
from tacauchy_rig.core.run import Outcome
from tacauchy_rig.core.store.check.run_and_press_check import check_run
from tacauchy_rig.core.store.journal import Journal
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.recovery import recover_run
from tests.drivers.conftest import changed

ONE = 'protocol.force_targets=["1.2 N"]'


class Watcher:
    """Keeps a session's events and does something when a phase begins."""

    def __init__(self, *, phase="", action=None):
        self.events, self.pids = [], {}
        self._phase, self._action = phase, action

    def __call__(self, event):
        """Take an event."""
        self.events.append(event)
        if event.name == "run-start":
            self.pids = event.detail["pids"]
        if event.detail.get("phase") == self._phase and event.name == "phase" and self._action:
            action, self._action = self._action, None
            threading.Timer(0.3, action, [self]).start()


def run(store, on_event, abort=None):
    """Run a session."""
    return run_session(store, store.config, on_event=on_event, abort=abort or Abort())


def kill(name, number=signal.SIGKILL):
    """Return an action that kills a process of the session."""
    return lambda watcher: os.kill(watcher.pids[name], number)


def readable(store, trial=1):
    """Return how many messages of a first attempt can be read, spills included."""
    paths = store.paths
    files = [paths.recording(trial, 1), *paths.spills(trial, 1)]
    return sum(Recording.open(path).message_count for path in files)


def assert_all_gone(pids):
    """No process of the session is left."""
    alive = [name for name, pid in pids.items() if psutil.pid_exists(pid)]
    assert alive == []


def test_a_session_passes_and_leaves_a_complete_run(make_store):
    """One trial through all processes: recorded, acknowledged, nothing left running."""
    store, watcher = make_store(ONE), Watcher()
    result = run(store, watcher)
    assert (result.outcome, result.exit_code, result.died) == (Outcome.PASSED, 0, {})
    assert store.accepted(1) == result.records[0]
    recording = Recording.open(store.paths.recording(1, 1))
    assert recording.finished
    counters = recording.force.counter.tolist()
    assert counters == list(range(counters[0], counters[-1] + 1))
    assert sum(result.acknowledged.values()) == recording.message_count
    assert {event.name for event in Journal.read(store.paths.journal).events} >= {
        "run-start",
        "attempt-start",
        "attempt-end",
        "run-end",
    }
    assert any(event.name == "progress" for event in watcher.events)
    assert_all_gone(watcher.pids)


@pytest.mark.parametrize("name", [pytest.param("camera", marks=pytest.mark.slow), "control"])
def test_a_killed_process_ends_the_session_and_loses_nothing_acknowledged(make_store, name):
    """Kill -9 of any child: told plainly, attempt kept and marked, no process left."""
    store, watcher = make_store(ONE), Watcher(phase="press", action=kill(name))
    result = run(store, watcher)
    assert result.outcome is Outcome.FAULT
    assert f"the {name} process died (killed by SIGKILL)" in result.reason
    assert result.remedy
    assert store.load_result(1, 1).outcome is Outcome.FAULT
    assert result.records == (store.load_result(1, 1),)
    assert readable(store) >= sum(result.acknowledged.values()) > 0
    assert store.next_attempt(1) == 2
    assert_all_gone(watcher.pids)
    assert recover_run(store).is_whole


@pytest.mark.slow
def test_resume_starts_at_the_first_trial_without_a_passed_attempt(make_store):
    """After a killed recorder the same run goes on; the torn attempt stays beside the new one."""
    store = make_store('protocol.force_targets=["1.2 N", "1.5 N"]')
    watcher = Watcher()

    def on_event(event):
        watcher(event)
        if event.trial == 2 and event.detail.get("phase") == "press" and event.name == "phase":
            os.kill(watcher.pids["recorder"], signal.SIGKILL)

    result = run(store, on_event)
    assert result.outcome is Outcome.FAULT
    assert "the recorder process died (killed by SIGKILL)" in result.reason
    assert "Trial 1 is safe" in result.reason
    assert readable(store, 1) + readable(store, 2) >= sum(result.acknowledged.values())
    assert Recording.open(store.paths.spill(2, 1, "control")).finished
    assert_all_gone(watcher.pids)
    torn = store.paths.recording(2, 1).read_bytes()
    plan = plan_session(store)
    assert [(p.index, p.done, p.next_attempt) for p in plan] == [(1, True, 2), (2, False, 2)]
    assert [p.contact_z_m for p in plan] == [store.accepted(1).contact_z_m, None]
    assert plan_session(store, again={1})[0].contact_z_m == plan[0].contact_z_m

    result = run(store, Watcher())
    assert result.outcome is Outcome.PASSED
    assert [(record.index, record.attempt) for record in result.records] == [(2, 2)]
    assert store.paths.recording(2, 1).read_bytes() == torn
    assert list(check_run(store).missed()) == []
    assert recover_run(store).is_whole


def test_an_abort_ends_the_session_with_the_arm_off_the_gel(make_store):
    """Exit code 3, the attempt is marked, the recording is whole."""
    store = make_store(ONE)
    abort = Abort()
    watcher = Watcher(phase="press", action=lambda _: abort.request("a key was pressed"))
    result = run(store, watcher, abort)
    assert (result.outcome, result.exit_code) == (Outcome.ABORTED, 3)
    assert "a key was pressed" in result.reason
    assert "off the gel" in result.reason
    assert store.load_result(1, 1).outcome is Outcome.ABORTED
    assert Recording.open(store.paths.recording(1, 1)).finished


@pytest.mark.slow
@pytest.mark.parametrize(
    ("error", "outcome_reason"), [(OSError, "the terminal was lost"), (ValueError, "session ends")]
)
def test_a_watcher_that_fails_does_not_leave_the_arm_in_the_gel(make_store, error, outcome_reason):
    """A terminal that is gone aborts; any other failure ends the session in the same safe way."""
    store = make_store(ONE)

    def on_event(event):
        if event.detail.get("phase") == "press":
            raise error("no such terminal")

    if error is OSError:
        result = run(store, on_event)
        assert result.outcome is Outcome.ABORTED
    else:
        with pytest.raises(ValueError, match="no such terminal"):
            run(store, on_event)
    record = store.load_result(1, 1)
    assert record.outcome is Outcome.ABORTED
    assert outcome_reason in record.reason
    assert "off the gel" in record.reason
    assert Recording.open(store.paths.recording(1, 1)).finished


def test_an_abort_while_connecting_moves_nothing(make_store):
    """Asked before the programme began, it never begins."""
    store, abort = make_store(ONE), Abort()
    abort.request("Ctrl-C")
    result = run(store, Watcher(), abort)
    assert result.outcome is Outcome.ABORTED
    assert "before anything moved" in result.reason
    assert store.paths.attempt_indices(1) == []


@pytest.mark.slow
def test_a_control_process_that_hangs_is_ended(make_store):
    """SIGSTOP instead of a kill: its silence is noticed and nothing waits for it for ever."""
    store = make_store(ONE)
    watcher = Watcher(phase="press", action=kill("control", signal.SIGSTOP))
    result = run(store, watcher)
    assert result.outcome is Outcome.FAULT
    assert "the control process died (it had stopped answering" in result.reason
    assert_all_gone(watcher.pids)


def test_a_device_fault_travels_to_the_operator(make_store):
    """A force sensor that stalls in the middle ends the session with the limit's name."""
    store = make_store(ONE, 'emulation.faults=["force_sensor:stall@3s"]')
    result = run(store, Watcher())
    assert result.outcome is Outcome.FAULT
    assert "limits.stale_force" in result.reason


def test_devices_that_do_not_connect_are_all_named(make_store):
    """A robot and a camera that are not there: one error names both, and nothing was begun."""
    store = make_store(ONE)
    config = changed(
        store.config,
        robot={"driver": "emulated", "host": "127.0.0.99", "connect_timeout": 1.0},
        force_sensor={"driver": "emulated", "port": "/dev/no-such-port"},
        camera={"driver": "emulated", "device": "http://127.0.0.99:1/", "width": 640},
    )
    with pytest.raises(DeviceError) as caught:
        run_session(store, config, on_event=Watcher(), abort=Abort())
    for word in ("127.0.0.99", "/dev/no-such-port", "camera"):
        assert word in caught.value.message
    assert store.paths.attempt_indices(1) == []


def test_a_run_can_be_worked_on_by_one_program_only(make_store):
    """A second session on the same folder is refused."""
    store = make_store(ONE)
    with store.lock(), pytest.raises(RecordError, match="is working on this run"):
        run(store, Watcher())


PARENT = """
import sys
from pathlib import Path
from protocols.guard.abort import Abort
from protocols.processes.supervisor import run_session
from tacauchy_rig.core.run import JournalEvent
from tacauchy_rig.core.store.json_codec import dumps
from tacauchy_rig.core.store.run_store import RunStore

def tell(event):
    sys.stdout.write(dumps(event, indent=None).decode().strip() + "\\n")
    sys.stdout.flush()

store = RunStore.open(Path(sys.argv[1]))
run_session(store, store.config, on_event=tell, abort=Abort())
"""


def test_a_killed_supervisor_stops_the_arm_and_every_child(make_store):
    """Kill -9 of the parent: control makes the arm safe, the record is finished, all end."""
    store = make_store(ONE)
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT, str(store.paths.root)], stdout=subprocess.PIPE, text=True
    )
    pids = {}
    for line in parent.stdout:
        event = json.loads(line)
        if event["name"] == "run-start":
            pids = event["detail"]["pids"]
        if event["detail"].get("phase") == "press":
            break
    parent.kill()
    parent.stdout.close()
    parent.wait()
    deadline = time.monotonic() + 20.0
    while any(psutil.pid_exists(pid) for pid in pids.values()):
        assert time.monotonic() < deadline, "a child was left behind"
        time.sleep(0.05)
    record = store.load_result(1, 1)
    assert record.outcome is Outcome.ABORTED
    assert "the program that watches the run is gone" in record.reason
    assert "off the gel" in record.reason
    assert Recording.open(store.paths.recording(1, 1)).finished
