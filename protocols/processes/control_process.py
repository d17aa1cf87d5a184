"""The control process: owns the arm, the force sensor, the guard and the protocol."""

import ctypes
import logging
import math
import signal
import sys
import threading
import time

from drivers.interfaces import (
    Arm,
    Clock,
    DeviceIdentity,
    ForceTorqueSensor,
    Rig,
    build_arm_and_force_sensor,
)
from protocols.control.cycle import Cycle, Entry, Journal, Samples, Sink
from protocols.guard.abort import Abort
from protocols.processes.child_process import ask_for_priority, run_child
from protocols.processes.ipc import VIEWERS, AbortRequest, Channel, FeedWriters, Job, Order, Ready
from protocols.processes.recorder_process import RecorderLink, RemoteCamera
from protocols.trials.trial_sequence import ProgrammeResult, run_programme
from tacauchy_rig.core.errors import AbortedError, DeviceError, RigError
from tacauchy_rig.core.run import ArmSample, ForceSample
from tacauchy_rig.core.store.run_store import RunStore

logger = logging.getLogger(__name__)

NICENESS = -10
SHOW_S = 0.2
SILENT_S = 2.0
GO_TIMEOUT_S = 120.0
FIRST_IMAGE_S = 2.0
CLOSE_S = 4.0
_PR_SET_PDEATHSIG = 1


class Orders:
    """Listens to the supervisor in a thread of its own, so that no step can hold an abort up."""

    def __init__(self, supervisor: Channel, abort: Abort) -> None:
        self.go = threading.Event()
        self._supervisor = supervisor
        self._abort = abort
        threading.Thread(target=self._listen, name="orders", daemon=True).start()

    def _listen(self) -> None:
        last_message_s = time.monotonic()
        while True:
            self._supervisor.wait(0.1)
            messages = self._supervisor.receive()
            for message in messages:
                if isinstance(message, AbortRequest):
                    self._abort.request(message.reason)
                elif message is Order.GO:
                    self.go.set()
            if self._supervisor.closed:
                self._abort.request("the program that watches the run is gone")
                return
            now_s = time.monotonic()
            last_message_s = now_s if messages else last_message_s
            if self.go.is_set() and now_s - last_message_s > SILENT_S:
                self._abort.request(f"the supervisor has been silent for {SILENT_S:g} s")
                return


def control(job: Job, supervisor: Channel) -> None:
    """Do the job of control."""
    _die_with_parent(signal.SIGKILL)
    ask_for_priority(NICENESS)
    arm, force_sensor = build_arm_and_force_sensor(job.config)
    camera = RemoteCamera(Channel.inherited(job.descriptors["camera-status"]))
    store = RunStore.open(job.root)
    link = RecorderLink(job.descriptors, store=store, source="control", on_attempt=camera.ask)
    try:
        devices = _connect(arm, force_sensor)
        _die_with_parent(0)
        abort = Abort()
        abort.handle_signals()
        orders = Orders(supervisor, abort)
        supervisor.send(Ready(devices=devices))
        rig = Rig(arm=arm, force_sensor=force_sensor, camera=camera, clock=Clock())
        _wait_for_go(orders, rig, abort)
        result = _run(rig, job, link, supervisor, abort)
    finally:
        arm.close()
        force_sensor.close()
        link.close(timeout_s=CLOSE_S)
        supervisor.send(link.kept)
    deadline = time.monotonic() + 2.0
    while not supervisor.send(result) and not supervisor.closed and time.monotonic() < deadline:
        time.sleep(0.02)
    logger.info("ended: %s", result.outcome)


def _connect(arm: Arm, force_sensor: ForceTorqueSensor) -> dict[str, DeviceIdentity]:
    """Connect both, and name every device that does not answer at once."""
    devices: dict[str, DeviceIdentity] = {}
    errors: list[RigError] = []
    for name, device in (("force_sensor", force_sensor), ("robot", arm)):
        try:
            devices[name] = device.connect()
        except RigError as error:
            errors.append(error)
    if errors:
        raise DeviceError(
            "\n".join(error.message for error in errors),
            remedy="; ".join(error.remedy for error in errors if error.remedy),
        )
    return devices


def _wait_for_go(orders: Orders, rig: Rig, abort: Abort) -> None:
    """Keep the devices' buffers empty until the supervisor says go and images arrive."""
    deadline = time.monotonic() + GO_TIMEOUT_S
    while not orders.go.wait(0.02) or math.isinf(rig.camera.health().age_s):
        if abort.count:
            raise AbortedError(f"aborted before anything moved: {abort.reason}")
        if time.monotonic() > deadline:
            raise DeviceError(
                f"control: no order and no image to start with within {GO_TIMEOUT_S:g} s"
            )
        if orders.go.is_set():
            deadline = min(deadline, time.monotonic() + FIRST_IMAGE_S)
        rig.arm.kick_watchdog()
        rig.arm.state()
        rig.arm.drain()
        rig.force_sensor.drain()
        rig.camera.poll()


def _run(
    rig: Rig, job: Job, link: RecorderLink, supervisor: Channel, abort: Abort
) -> ProgrammeResult:
    broadcast = Broadcast(link, FeedWriters(job.descriptors, VIEWERS))
    cycle = Cycle(rig, job.config, sink=broadcast, abort=abort, expected=job.expected)
    journal = Journal(link, rig.clock, listener=supervisor.send)
    shown_s = 0.0

    def show() -> None:
        nonlocal shown_s
        broadcast.show(cycle)
        if time.monotonic() - shown_s >= SHOW_S:
            shown_s = time.monotonic()
            height_m = cycle.last_state.pose.position[2] if cycle.last_state else None
            journal.show(force_n=cycle.last_force_n, height_m=height_m)
            supervisor.send(link.kept)

    cycle.observers.append(show)
    return run_programme(cycle, journal, job.plan)


def _die_with_parent(number: int) -> None:
    """Ask the kernel for a signal when the parent dies; 0 takes it back.

    Only while connecting, when a native call may hang with the interpreter's lock held. Once
    connected, the loss of the parent is heard as an end of file and the arm is made safe first.
    """
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number)


PERIOD_NS = 25_000_000
PENDING_MAX = 1000


class Broadcast:
    """A ``Sink`` that hands everything on and, forty times a second, shows what passed."""

    def __init__(self, sink: Sink, feeds: FeedWriters) -> None:
        self._feeds = feeds
        self._waiting: Samples = ()
        self._shown_ns = 0
        self._sink = sink
        self.problem, self.lag_s = sink.problem, sink.lag_s

    def put(self, entry: Entry) -> None:
        """Hand an entry on, and remember what is to be shown of it."""
        if self._feeds and isinstance(entry, tuple):
            self._waiting = (*self._waiting, *entry)[-PENDING_MAX:]
        self._sink.put(entry)

    def show(self, cycle: Cycle) -> None:
        """Show what passed since the last time, if it is time."""
        now_ns = cycle.rig.clock.now_ns()
        if not self._feeds or now_ns - self._shown_ns < PERIOD_NS:
            return
        self._shown_ns = now_ns
        forces = [sample for sample in self._waiting if isinstance(sample, ForceSample)]
        states = [sample for sample in self._waiting if isinstance(sample, ArmSample)]
        self._waiting = ()
        if forces:
            wrenches = [cycle.force_guard.tared(sample) for sample in forces]
            numbers = {
                "stamp_ns": [sample.stamp_ns for sample in forces],
                "counter": [sample.counter for sample in forces],
                "force_n": [cycle.force_guard.pressing(wrench) for wrench in wrenches],
                "wrench": wrenches[-1],
                "is_tared": cycle.force_guard.is_tared,
            }
            self._feeds.show("force", forces[-1].stamp_ns, numbers)
        if states:
            newest = states[-1]
            numbers = {
                "count": len(states),
                "position_m": newest.pose.position,
                "rotation_rad": newest.pose.rotation_vector,
                "velocity": newest.velocity,
            }
            self._feeds.show("arm", newest.stamp_ns, numbers)


if __name__ == "__main__":
    sys.exit(run_child("control", control))
