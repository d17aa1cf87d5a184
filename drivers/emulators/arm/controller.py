"""An emulated UR controller: a process of its own that real ur_rtde clients connect to.

Run it with ``python -m drivers.emulators.arm.controller --help``. It prints one JSON line when
its ports are open, then serves until it is told to end.
"""

from __future__ import annotations

import errno
import json
import logging
import os
import random
import select
import signal
import socket
import sys
import time
from types import FrameType

from drivers.arm.ur5_safety import RuntimeState
from drivers.device.faults import Device, Fault, FaultKind
from drivers.emulators.arm.body import SAFETY_STOP_DECELERATION, VERSIONS, ControllerBody
from drivers.emulators.arm.program import ControlProgram
from drivers.emulators.arm.rtde_port import RtdePort
from drivers.emulators.arm.settings import ControllerSettings, parse_arguments
from drivers.emulators.arm.text_ports import DashboardPort, ScriptPort
from drivers.emulators.arm.trace import ArmTrace
from drivers.emulators.faults import FaultInbox, FaultSchedule
from drivers.emulators.process import keep_time
from drivers.emulators.shared_world import WORLD_FILE, SharedWorld
from tacauchy_rig.errors import DeviceError
from tacauchy_rig.run import Pose, Vector3, Vector6

_logger = logging.getLogger(__name__)
_DEFAULT_DELAY_S = 0.2
# A starved process catches up on its arm's motion in one step, up to this long [s].
_CATCH_UP_S = 1.0
_PARENT_CHECK_S = 1.0


class UrController:
    """One emulated controller with its three ports."""

    def __init__(self, settings: ControllerSettings) -> None:
        self._settings = settings
        self._random = random.Random(settings.seed)  # noqa: S311 - imitates a device
        self.body = ControllerBody.at_home(
            settings.model, settings.home, remote_control=settings.remote_control
        )
        self._world = SharedWorld.create(settings.folder / WORLD_FILE)
        self._trace = ArmTrace(settings.folder)
        self._inbox = FaultInbox(settings.folder, Device.ROBOT)
        self._schedule = FaultSchedule()
        self._active: dict[FaultKind, Fault] = {}
        self._rtde = RtdePort(settings.host, self.body)
        self._dashboard = DashboardPort(
            settings.host,
            self.body,
            stop_program=lambda: self._end_program("dashboard"),
            reset_safety=self._reset_safety,
        )
        self._script = ScriptPort(settings.host, start_program=self._start_program)
        self._ports = [self._rtde.port, self._dashboard.port, self._script.port]
        self._program: ControlProgram | None = None
        self._period_s = 1.0 / settings.model.rate_hz
        self._start_s = time.monotonic()
        self._cycle = 0
        self._fed_s = 0.0
        self._error: tuple[float, float, float] = (0.0, 0.0, 0.0)
        self._was_on_line = False

    def ready_line(self) -> str:
        """Return the JSON line that says where it listens."""
        settings = self._settings
        return json.dumps(
            {
                "device": Device.ROBOT.value,
                "pid": os.getpid(),
                "host": settings.host,
                "ports": [port.number for port in self._ports],
                "model": settings.model.value,
                "version": ".".join(str(part) for part in VERSIONS[settings.model]),
                "rate_hz": settings.model.rate_hz,
                "folder": str(settings.folder),
                "world": str(settings.folder / WORLD_FILE),
            }
        )

    def serve_until(self, stop: StopFlag) -> None:
        """Serve clients until ``stop`` is set or the parent process ends."""
        next_parent_check_s = 0.0
        while not stop.is_set:
            now_s = time.monotonic()
            self._service(now_s)
            due = int((now_s - self._start_s) / self._period_s)
            if due > self._cycle:
                self._run_cycle(due, now_s)
            if now_s >= next_parent_check_s:
                next_parent_check_s = now_s + _PARENT_CHECK_S
                if self._settings.parent_pid not in (None, os.getppid()):
                    return
            wait_s = self._start_s + (self._cycle + 1) * self._period_s - time.monotonic()
            if wait_s > 0.0:
                select.select(self._watched(), [], [], wait_s)

    def close(self) -> None:
        """Close every port and file."""
        for port in self._ports:
            port.drop()
        self._inbox.close()
        self._trace.close()
        self._world.close()

    def _watched(self) -> list[socket.socket]:
        if FaultKind.FREEZE in self._active:
            return []
        return [link for port in self._ports for link in port.sockets()]

    def _service(self, now_s: float) -> None:
        if FaultKind.FREEZE in self._active:
            return
        written = self._rtde.service(now_s)
        if self._program is not None and self._program.command_register in written:
            self._fed_s = now_s
        self._dashboard.service(now_s)
        self._script.service(now_s)

    def _run_cycle(self, due: int, now_s: float) -> None:
        passed_s = min((due - self._cycle) * self._period_s, _CATCH_UP_S)
        self._cycle = due
        stamp_ns = time.monotonic_ns()
        self._update_faults(now_s)
        self._run_program(now_s)
        motion = self.body.motion
        motion.step(passed_s)
        self._draw_repeatability()
        reported = self._reported(motion.pose)
        self.body.publish(
            time_s=round(due * self._period_s, 6), pose=reported, velocity=motion.velocity
        )
        x, y, z, *turn = motion.pose
        true: Vector3 = (x + self._error[0], y + self._error[1], z + self._error[2])
        self._world.publish(
            Pose(position=true, rotation_vector=(turn[0], turn[1], turn[2])),
            motion.velocity,
            stamp_ns,
        )
        self._trace.add(stamp_ns, true, motion.velocity, self.body.runtime_state)
        if FaultKind.FREEZE not in self._active:
            self._rtde.send_state(due, now_s)

    def _run_program(self, now_s: float) -> None:
        program = self._program
        if program is None:
            return
        period_s = program.watchdog_period_s
        if period_s is not None and now_s - self._fed_s > period_s:
            self._end_program("watchdog")
        elif not program.cycle():
            self._end_program("runtime error" if program.failed else "stopped by the client")

    def _start_program(self, offset: int) -> None:
        if not self.body.safety.admits_programs or not self.body.remote_control:
            self._note("program-refused")
            return
        self._end_program("replaced")
        self._program = ControlProgram(
            self.body, offset=offset, on_protective_stop=self._protective_stop
        )
        self._fed_s = time.monotonic()
        self._note("program-started")

    def _end_program(self, reason: str) -> None:
        if self._program is not None:
            self._program.end()
            self._program = None
            self._note("program-ended", reason=reason)

    def _protective_stop(self) -> None:
        self.body.safety.protective_stop()
        self._safety_stop("protective stop")

    def _safety_stop(self, reason: str) -> None:
        self._end_program(reason)
        self.body.motion.brake(SAFETY_STOP_DECELERATION)
        self.body.runtime_state = RuntimeState.STOPPED

    def _reset_safety(self) -> None:
        self.body.safety.reset()
        self._note("safety-reset")

    def _update_faults(self, now_s: float) -> None:
        for fault in self._inbox.poll():
            self._schedule.add(fault, now_s=now_s)
        active = {fault.kind: fault for fault in self._schedule.active(now_s)}
        if active.keys() == self._active.keys():
            return
        started = [fault for kind, fault in active.items() if kind not in self._active]
        ended = [kind for kind in self._active if kind not in active]
        self._active = active
        for fault in started:
            self._note("fault-started", kind=fault.kind.value)
            self._begin(fault)
        for kind in ended:
            self._finish(kind)
            self._note("fault-ended", kind=kind.value)

    def _begin(self, fault: Fault) -> None:
        if fault.kind is FaultKind.DROP:
            for port in self._ports:
                port.drop()
        elif fault.kind is FaultKind.DELAY:
            self._delay(fault.parameters.get("delay_s", _DEFAULT_DELAY_S))
        elif fault.kind is FaultKind.PROTECTIVE_STOP:
            self._protective_stop()
        elif fault.kind is FaultKind.EMERGENCY_STOP:
            self.body.safety.emergency_stop()
            self._safety_stop("emergency stop")
        elif fault.kind is FaultKind.STALL:
            self.body.motion.stalled = True

    def _finish(self, kind: FaultKind) -> None:
        if kind is FaultKind.DROP:
            for port in self._ports:
                port.open()
        elif kind is FaultKind.DELAY:
            self._delay(0.0)
        elif kind in (FaultKind.PROTECTIVE_STOP, FaultKind.EMERGENCY_STOP):
            self._reset_safety()
        elif kind is FaultKind.STALL:
            self.body.motion.stalled = False

    def _delay(self, delay_s: float) -> None:
        for port in self._ports:
            port.delay(delay_s)

    def _draw_repeatability(self) -> None:
        # A new error for each move, drawn when it ends its line; slow presses keep theirs.
        on_line = self.body.motion.on_line
        if self._was_on_line and not on_line and self._settings.repeatability_m > 0.0:
            draw = [self._random.uniform(-1.0, 1.0) for _ in range(3)]
            scale = self._settings.repeatability_m / max(1.0, sum(d * d for d in draw) ** 0.5)
            self._error = (draw[0] * scale, draw[1] * scale, draw[2] * scale)
        self._was_on_line = on_line

    def _reported(self, pose: Vector6) -> Vector6:
        sigma = self._settings.pose_noise_m
        if sigma <= 0.0:
            return pose
        x, y, z = (value + self._random.gauss(0.0, sigma) for value in pose[:3])
        return (x, y, z, *pose[3:])

    def _note(self, name: str, **detail: object) -> None:
        self._trace.note(time.monotonic_ns(), name, self.body.motion.pose, **detail)


class StopFlag:
    """Set by SIGTERM and SIGINT."""

    def __init__(self) -> None:
        self.is_set = False
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._set)

    def _set(self, _number: int, _frame: FrameType | None) -> None:
        self.is_set = True


def _refusal(settings: ControllerSettings, error: OSError) -> DeviceError:
    if error.errno == errno.EADDRINUSE:
        remedy = "another emulator has that address: choose a free one such as 127.0.0.6"
    elif error.errno == errno.EADDRNOTAVAIL:
        remedy = "choose a loopback address such as 127.0.0.6"
    else:
        remedy = f"see that {settings.folder} can be created and written"
    return DeviceError(
        f"emulated robot at {settings.host}: {error.strerror or error}", remedy=remedy
    )


def main() -> int:
    """Serve as an emulated controller until told to end."""
    settings = parse_arguments(sys.argv[1:])
    stop = StopFlag()
    keep_time(mostly_sleeps=True)
    try:
        controller = UrController(settings)
    except OSError as error:
        print(_refusal(settings, error), file=sys.stderr)
        return DeviceError.exit_code
    try:
        print(controller.ready_line(), flush=True)
        controller.serve_until(stop)
    finally:
        controller.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
