"""The two ur_rtde interfaces of one arm: opened, read, called and closed within deadlines.

The first loss (old data, a broken connection, an ended program, a missed deadline) is final:
every later call raises it again. Its states tell whether an arm still counts as ours: data fresh,
connection whole, program running, no stop.
"""

import functools
import logging
import os
import queue
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

import psutil
from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface

from drivers.arm.ur5_rtde import RTDE_PORT, RobotMode, RuntimeState, in_words, safety_reason
from drivers.interfaces import ProgramEndedError
from tacauchy_rig.core.config.settings import RobotSection
from tacauchy_rig.core.errors import DeviceError, RigError
from tacauchy_rig.core.run import ArmSample, Pose, Vector6, vector6

_logger = logging.getLogger(__name__)

_DESCRIPTORS = "/proc/self/fd"
_CLOCK_JUMP_S = 1.0  # more than a busy network or computer bunches states that arrive


class ArmHealth:
    """Judges states as they come, and remembers the first thing that went wrong.

    Args:
        stale_limit_s: Age at which data count as lost [s].
        watchdog_hz: For the message of a program that was not fed [Hz].
    """

    def __init__(self, device: str, *, stale_limit_s: float, watchdog_hz: float) -> None:
        self._device = device
        self._limit_s = stale_limit_s
        self._watchdog_hz = watchdog_hz
        self._lost: DeviceError | None = None
        self._controller_time_s = -1.0
        self._changed_s = self._looked_s = time.monotonic()
        self._wall_offset_s = time.time() - time.monotonic()

    def require_alive(self) -> None:
        """Raise the first loss again, if there was one."""
        if self._lost is not None:
            raise self._lost

    def lose(self, reason: str, remedy: str) -> DeviceError:
        """Return the error to raise, and remember it: a lost arm stays lost.

        The client library times its connection by this computer's clock and date: where those were
        set meanwhile, neither network nor controller is to blame.
        """
        jump_s = time.time() - time.monotonic() - self._wall_offset_s
        if abs(jump_s) > _CLOCK_JUMP_S:
            reason += f", after this computer's clock was set by {jump_s:+.0f} s"
            remedy = (
                "let the time service adjust the clock slowly while a run goes on, then "
                "`tacauchy-rig resume`"
            )
        return self.remember(DeviceError(f"{self._device}: {reason}", remedy=remedy))

    def remember(self, error: DeviceError) -> DeviceError:
        """Keep ``error`` as the reason, unless there was an earlier one; return the reason."""
        self._lost = self._lost or error
        return self._lost

    def broken(self) -> DeviceError:
        """Return the loss of a connection that was closed or replaced."""
        return self.lose(
            "the connection broke",
            "check the network and the controller; nothing reconnects by itself",
        )

    def looked_away(self) -> bool:
        """Return whether the last look is so old that old data prove nothing."""
        return time.monotonic() - self._looked_s > 0.5 * self._limit_s

    def note(self, sample: ArmSample) -> bool:
        """Take in a state; return True when it is newer than the last one.

        Raises:
            DeviceError: The controller's clock ran back, or jumped against this computer's.
        """
        self._looked_s = time.monotonic()
        if sample.controller_time_s == self._controller_time_s:
            return False
        known_before = self._controller_time_s >= 0.0
        passed_s = sample.controller_time_s - self._controller_time_s
        jump_s = passed_s - (self._looked_s - self._changed_s)
        self._controller_time_s = sample.controller_time_s
        self._changed_s = self._looked_s
        if known_before and (passed_s < 0.0 or abs(jump_s) > _CLOCK_JUMP_S):
            raise self.lose(
                f"the controller's clock jumped by {jump_s:+.1f} s against this computer's",
                "see whether the controller was restarted or its time was set",
            )
        return True

    def require_fresh(self) -> None:
        """Refuse data whose time stamp stands still."""
        age_s = time.monotonic() - self._changed_s
        if age_s > self._limit_s:
            raise self.lose(
                f"no new data for {age_s * 1e3:.0f} ms (limit {self._limit_s * 1e3:.0f} ms)",
                "check the cable and the controller",
            )

    def require_running(self, sample: ArmSample) -> None:
        """Refuse an arm that was stopped, or whose program ended."""
        stopped = safety_reason(sample.safety_bits)
        if stopped is not None:
            raise self.lose(*stopped)
        if sample.robot_mode != RobotMode.RUNNING:
            mode = in_words(RobotMode, sample.robot_mode)
            raise self.lose(f"the arm is not running ({mode})", "power it on at the pendant")
        if sample.runtime_state != RuntimeState.PLAYING:
            state = in_words(RuntimeState, sample.runtime_state)
            raise self.remember(
                ProgramEndedError(
                    f"{self._device}: the program on the controller ended (runtime state {state})",
                    remedy=f"it ends when it is not fed for {1e3 / self._watchdog_hz:.0f} ms, or "
                    "at the pendant; see what held this computer up",
                )
            )


class RtdeSockets:
    """This process's connections to the RTDE port of one controller (Linux only).

    ur_rtde connects again by itself after any loss, without telling, and uploads its program
    again. This project wants a person to look first, so the connections in use are remembered by
    the kernel's numbers for them.
    """

    def __init__(self) -> None:
        self._names: dict[int, str] = {}

    def remember(self, host: str) -> None:
        """Take the connections to ``host`` that are open now as the ones to watch."""
        address = socket.gethostbyname(host)
        self._names = {
            link.fd: os.readlink(f"{_DESCRIPTORS}/{link.fd}")  # noqa: PTH115 - as below
            for link in psutil.Process().net_connections("tcp4")
            if link.raddr == (address, RTDE_PORT)
        }

    def are_unchanged(self) -> bool:
        """Return False once any of them was closed or replaced."""
        try:
            return all(
                os.readlink(f"{_DESCRIPTORS}/{number}") == name  # noqa: PTH115 - every cycle
                for number, name in self._names.items()
            )
        except OSError:
            return False


T = TypeVar("T")
_Job = tuple[Callable[[], object], Future[object]]

RECORD_RATE_HZ = 125.0
COMMAND_S = 1.0
_FIELDS = [
    "timestamp",
    "actual_TCP_pose",
    "actual_TCP_speed",
    "actual_TCP_force",
    "runtime_state",
    "safety_status_bits",
    "robot_mode",
]
_CONTROLLER_RATE = -1.0
_TORN_READS = 5
_SECOND_LOOK_S = 0.02
_REASON_S = 0.05
_POLL_S = 0.005
_FIRST_STATE_S = 1.0
_CLOSE_S = 5.0
_STOP_SCRIPT_S = 1.0
_MOVE_BEGINS_S = 0.5
_PROGRESS_POLL_S = 0.002


class Commander:
    """One thread that makes every call into ur_rtde's control interface, each with a deadline.

    The interface is not thread-safe and polls up to 300 s for a controller that fell silent. Its
    ordinary calls release the interpreter lock, so the caller can stop waiting. A call that misses
    its deadline cannot be taken back: the commander then refuses all others, and the process that
    owns it should end. ``device`` is its name in messages.
    """

    def __init__(self, device: str) -> None:
        self._device = device
        self._jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        self._stuck_in = ""
        # A daemon, because a stuck call must not hold up the end of the process.
        self._thread = threading.Thread(target=self._run, name="ur5-commander", daemon=True)
        self._thread.start()

    @property
    def is_stuck(self) -> bool:
        """True once a call missed its deadline."""
        return bool(self._stuck_in)

    def call(self, activity: str, function: Callable[[], T], *, deadline_s: float) -> T:
        """Return what ``function`` returns.

        Raises:
            DeviceError: No answer in time, now or earlier, or the library raised an error.
        """
        if self._stuck_in:
            raise DeviceError(
                f"{self._device}: {activity} is not possible, {self._stuck_in} still waits",
                remedy="the connection is lost: end this program and start it again",
            )
        future: Future[object] = Future()
        self._jobs.put((function, future))
        try:
            return future.result(timeout=deadline_s)  # type: ignore[return-value]
        except TimeoutError as error:
            self._stuck_in = activity
            raise DeviceError(
                f"{self._device}: {activity} got no answer within {deadline_s:g} s",
                remedy="look at the controller and the network; the watchdog stops the arm",
            ) from error
        except (RuntimeError, ValueError) as error:
            raise DeviceError(f"{self._device}: {activity} failed: {error}") from error

    def close(self) -> None:
        """End the thread, unless a call holds it."""
        self._jobs.put(None)
        if not self._stuck_in:
            self._thread.join(timeout=1.0)

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            function, future = job
            try:
                future.set_result(function())
            except BaseException as error:  # noqa: BLE001 - handed to the caller
                future.set_exception(error)
            # Otherwise the last call would keep the interface alive until the next one.
            del job, function, future


class UrLink:
    """Both interfaces of one controller; control calls go through one thread.

    Args:
        robot: Address; ``connect_timeout`` is how long ur_rtde's constructors may take before this
            process is ended.
        stale_limit_s: Age at which data count as lost [s].

    Raises:
        DeviceError: ur_rtde refused to connect, or no data came.
    """

    def __init__(self, robot: RobotSection, *, stale_limit_s: float) -> None:
        host = robot.host
        self.device = f"robot {host}"
        self._commander = Commander(self.device)
        self._receive: Any = None
        self._control: Any = None
        self._sockets = RtdeSockets()
        try:
            with Guardian(f"{self.device}: connecting", timeout_s=robot.connect_timeout):
                self._receive = RTDEReceiveInterface(host, RECORD_RATE_HZ, _FIELDS)
                # External force input is never used here, and CB3 controllers lack it.
                flags = (
                    RTDEControlInterface.FLAG_UPLOAD_SCRIPT | RTDEControlInterface.FLAG_NO_EXT_FT
                )
                self._control = RTDEControlInterface(host, _CONTROLLER_RATE, flags)
        except (RuntimeError, ValueError) as error:
            self.close()
            raise DeviceError(
                f"{self.device}: the client library could not connect: {error}",
                remedy="see that nothing else drives the robot and that it is in remote control",
            ) from error
        self._sockets.remember(host)
        self._await_first_state()
        self.health = ArmHealth(
            self.device, stale_limit_s=stale_limit_s, watchdog_hz=robot.watchdog
        )

    def state(self) -> tuple[ArmSample, bool]:
        """Return (newest state, whether it is newer than the last one).

        Raises:
            DeviceError: The arm is lost.
        """
        self.health.require_alive()
        sample = self.sample()
        is_new = self.health.note(sample)
        if not is_new and self.health.looked_away():
            # This process was held up, and with it the thread that receives: look again.
            time.sleep(_SECOND_LOOK_S)
            sample = self.sample()
            is_new = self.health.note(sample)
        if not self._sockets.are_unchanged():
            raise self.health.broken()
        self.health.require_fresh()
        self.health.require_running(sample)
        return sample, is_new

    def sample(self) -> ArmSample:
        """Return the newest state, all of it from one data packet."""
        receive = self._receive
        for _ in range(_TORN_READS):
            sample = ArmSample(
                stamp_ns=time.monotonic_ns(),
                controller_time_s=receive.getTimestamp(),
                pose=Pose.of(receive.getActualTCPPose()),
                velocity=vector6(receive.getActualTCPSpeed()),
                runtime_state=receive.getRuntimeState(),
                safety_bits=receive.getSafetyStatusBits(),
                robot_mode=receive.getRobotMode(),
                tcp_force=vector6(receive.getActualTCPForce()),
            )
            if receive.getTimestamp() == sample.controller_time_s:
                break
        return sample

    def command(
        self, activity: str, function: Callable[[Any], object], *, deadline_s: float = COMMAND_S
    ) -> None:
        """Make a control call that answers whether it was accepted; see ``Commander.call``."""
        self.health.require_alive()
        if not self.call(activity, function, deadline_s=deadline_s):
            # Commands travel faster than states: the reason may be a data packet or two behind.
            end_s = time.monotonic() + _REASON_S
            while time.monotonic() < end_s:
                if not self._sockets.are_unchanged():
                    raise self.health.broken()
                self.health.require_running(self.sample())
                time.sleep(_POLL_S)
            raise self.health.lose(f"refused {activity}", "read the pendant's message")

    def call(
        self, activity: str, function: Callable[[Any], T], *, deadline_s: float = COMMAND_S
    ) -> T:
        """Return what ``function`` returns of the control interface; works on a lost arm too.

        Raises:
            DeviceError: No answer in time, or the library complained; the arm is then lost.
        """
        control = self._control
        try:
            return self._commander.call(
                activity, functools.partial(function, control), deadline_s=deadline_s
            )
        except DeviceError as error:
            if not self._sockets.are_unchanged():
                raise self.health.broken() from error
            self.health.remember(error)
            raise

    def close(self) -> None:
        """End the program on the controller and disconnect; never raises."""
        with Guardian(f"{self.device}: disconnecting", timeout_s=_CLOSE_S):
            control = self._control
            # Over a broken connection there is nobody to tell, and the library would wait.
            reachable = self._sockets.are_unchanged() and not self._commander.is_stuck
            if control is not None and reachable:
                try:
                    self._commander.call(
                        "ending the program", control.stopScript, deadline_s=_STOP_SCRIPT_S
                    )
                except RigError as error:
                    _logger.warning("%s", error)
            # The destructors disconnect, each taking half a second.
            del control
            self._control = self._receive = None
        self._commander.close()

    def _await_first_state(self) -> None:
        end_s = time.monotonic() + _FIRST_STATE_S
        while True:
            sample = self.sample()
            if sample.controller_time_s > 0.0 and sample.runtime_state == RuntimeState.PLAYING:
                return
            if time.monotonic() > end_s:
                self.close()
                raise DeviceError(
                    f"{self.device}: its program did not start within {_FIRST_STATE_S:g} s",
                    remedy="read the pendant's message and log; is a program waiting there?",
                )
            time.sleep(_POLL_S)


class LineMove:
    """One asynchronous moveL, followed through the controller's numbers for such operations."""

    def __init__(self, link: UrLink) -> None:
        self._link = link
        self._operation_before = -1
        self._start_s = 0.0

    def start(self, target: Vector6, *, speed: float, acceleration: float) -> None:
        """Send the move [m, rad; m/s; m/s^2] and return at once."""
        _, self._operation_before = self._link.call("reading progress", _progress)
        self._start_s = time.monotonic()
        self._link.command(
            "starting a move", lambda c: c.moveL(list(target), speed, acceleration, True)
        )

    def is_running(self) -> bool:
        """Return True until the move has ended.

        Raises:
            DeviceError: The move never began, or the arm is lost.
        """
        running, operation = self._link.call("reading progress", _progress)
        if running or operation != self._operation_before:
            return running
        if time.monotonic() - self._start_s > _MOVE_BEGINS_S:
            raise self._link.health.lose("the move never began", "read the pendant's message")
        return True

    def stop(self, deceleration: float, *, deadline_s: float) -> None:
        """Brake the tip at ``deceleration`` [m/s^2] and wait for it, at most ``deadline_s`` [s]."""
        end_s = time.monotonic() + deadline_s
        # Only the asynchronous form brakes the tip at [m/s^2]; the other one is a stopj.
        self._link.call("stopping", lambda c: c.stopL(deceleration, True), deadline_s=deadline_s)
        while (left_s := end_s - time.monotonic()) > 0.0:
            running, _ = self._link.call(
                "reading progress", _progress, deadline_s=left_s + _PROGRESS_POLL_S
            )
            if not running:
                return
            time.sleep(_PROGRESS_POLL_S)


def _progress(control: Any) -> tuple[bool, int]:
    """Return (whether an asynchronous operation runs, its number)."""
    status = control.getAsyncOperationProgressEx()
    return bool(status.isAsyncOperationRunning()), int(status.operationId())


_RELEASE_S = 1.0
_GUARD = """
import os, select, signal, sys
process_id, timeout_s, activity = int(sys.argv[1]), float(sys.argv[2]), sys.argv[3]
signal.signal(signal.SIGINT, signal.SIG_IGN)
ready, _, _ = select.select([sys.stdin], [], [], timeout_s)
if not ready and os.getppid() == process_id:
    print(
        f"{activity}: no answer within {timeout_s:g} s, so this process is ended\\n"
        "  -> look at the device, then start again; an arm in motion is stopped by its watchdog",
        file=sys.stderr, flush=True,
    )
    os.kill(process_id, signal.SIGKILL)
"""


class Guardian:
    """A context: if its body takes longer than ``timeout_s`` [s], this process is killed.

    ur_rtde's constructors and destructors hold Python's interpreter lock: while one hangs, no
    Python thread and no signal handler of the process runs, so a deadline inside it cannot work. A
    tiny second process can: it holds the reading end of a pipe, which closes when the call returns.
    Killing is safe for the arm, whose watchdog stops it once nobody feeds the controller. Forking
    instead of starting a fresh interpreter would copy locks that native threads hold.

    Args:
        activity: What hangs, for the message on stderr.
    """

    def __init__(self, activity: str, *, timeout_s: float) -> None:
        self._arguments = (str(os.getpid()), str(timeout_s), activity)

    def __enter__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-S", "-c", _GUARD, *self._arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
        )

    def __exit__(self, *_: object) -> None:
        if self._process.stdin is not None:
            self._process.stdin.close()
        try:
            self._process.wait(_RELEASE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
