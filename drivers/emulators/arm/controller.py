"""An emulated UR controller: a process of its own that real ur_rtde clients connect to.

It prints one JSON line when its ports are open, then serves until it is told to end.
"""

from __future__ import annotations

import errno
import json
import select
import socket
import struct
import sys
import time
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path

from drivers.arm.ur5_wire import RuntimeState
from drivers.emulators.arm.body import (
    PROGRAM_END_DECELERATION,
    SAFETY_STOP_DECELERATION,
    VERSIONS,
    ControllerBody,
)
from drivers.emulators.arm.ports import DashboardPort, RtdePort, ScriptPort
from drivers.emulators.faults import STOPS, Device, Fault, FaultKind
from drivers.emulators.force_estimate import ForceEstimate
from drivers.emulators.process import DeviceSettings, Service, keep_time, run_device
from drivers.emulators.shared_world import WORLD_FILE, SharedWorld, plant_of
from drivers.emulators.silent_faults import SilentArmFaults
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import Pose, Vector3, Vector6, vector6

# A starved process catches up on its arm's motion in one step, up to this long [s].
_CATCH_UP_S = 1.0


class UrController:
    """One emulated controller with its three ports."""

    def __init__(self, settings: DeviceSettings, service: Service) -> None:
        self._settings = settings
        self._service = service
        robot = settings.config.robot
        self.body = ControllerBody(
            robot.model,
            Pose(position=robot.home, rotation_vector=robot.tool_rotation),
            remote_control="local-control" not in settings.quirks,
        )
        self._world = SharedWorld.create(settings.folder / WORLD_FILE)
        self._gel = plant_of(settings)
        self._estimate = ForceEstimate(
            robot.model, seed=settings.config.emulation.seed, sign=robot.force_sign
        )
        self._trace = ArmTrace(settings.folder)
        self._active: dict[FaultKind, Fault] = {}
        self._silent = SilentArmFaults()
        self._rtde = RtdePort(settings.host, self.body)
        self._dashboard = DashboardPort(
            settings.host,
            self.body,
            stop_program=lambda: self._end_program("dashboard"),
            reset_safety=self._reset_safety,
        )
        self._script = ScriptPort(settings.host, start_program=self._start_program)
        self._ports = [self._rtde, self._dashboard, self._script]
        self._program: ControlProgram | None = None
        self._period_s = 1.0 / robot.model.rate_hz
        self._start_s = time.monotonic()
        self._cycle = 0
        self._fed_s = 0.0

    def serve(self) -> None:
        """Say where it listens and serve clients until its time is over."""
        settings, model = self._settings, self.body.model
        self._service.announce(
            host=settings.host,
            ports=[port.number for port in self._ports],
            model=model.value,
            version=".".join(str(part) for part in VERSIONS[model]),
            rate_hz=model.rate_hz,
            folder=str(settings.folder),
            world=str(self._world.path),
        )
        while not self._service.is_over:
            now_s = time.monotonic()
            self._answer(now_s)
            due = int((now_s - self._start_s) / self._period_s)
            if due > self._cycle:
                self._run_cycle(due, now_s)
            wait_s = self._start_s + (self._cycle + 1) * self._period_s - time.monotonic()
            if wait_s > 0.0:
                select.select(self._watched(), [], [], wait_s)

    def close(self) -> None:
        """Close every port and file."""
        for port in self._ports:
            port.drop()
        self._trace.close()
        self._world.close()

    def _watched(self) -> list[socket.socket]:
        if FaultKind.FREEZE in self._active:
            return []
        return [link for port in self._ports for link in port.sockets()]

    def _answer(self, now_s: float) -> None:
        if FaultKind.FREEZE in self._active:
            return
        self._rtde.service(now_s)
        if self._program is not None and self._program.command_register in self._rtde.written:
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
        self._apply_silent_faults(passed_s)
        pose = Pose.of(motion.pose).shifted(z=-self._silent.height_m)
        self.body.publish(
            time_s=round(due * self._period_s + self._silent.clock_s, 6),
            pose=motion.pose,
            velocity=motion.velocity,
            tcp_force=self._tool_force(pose, stamp_ns, passed_s),
        )
        self._world.publish(pose, motion.velocity, stamp_ns)
        self._trace.add(stamp_ns, pose.position, motion.velocity, self.body.runtime_state)
        if FaultKind.FREEZE not in self._active:
            self._rtde.send_state(due, now_s)

    def _apply_silent_faults(self, passed_s: float) -> None:
        """Drift off the true pose; where that ends, the controller learns where its arm is."""
        off_m = self._silent.height_m
        self._silent.advance(self._active.values(), self.body.motion.velocity, duration_s=passed_s)
        if off_m and not self._silent.height_m:
            motion = self.body.motion
            motion.pose = Pose.of(motion.pose).shifted(z=-off_m).as_vector()

    def _tool_force(self, pose: Pose, stamp_ns: int, passed_s: float) -> Vector6:
        force, moment = self._gel.wrench(pose, stamp_ns)
        if self.body.zero_ft_asked:
            self._estimate.zero()
            self.body.zero_ft_asked = False
        velocity = self.body.motion.velocity
        return self._estimate.advance((*force, *moment), velocity, duration_s=passed_s)

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
        mended = STOPS | {FaultKind.UNLOCK}
        self._service.end_faults(mended, now_s=time.monotonic())
        # Forgotten here too, or the same stop told of in the next cycle would pass for this one.
        self._active = {kind: on for kind, on in self._active.items() if kind not in mended}
        self.body.safety.reset()
        self._note("safety-reset")

    def _update_faults(self, now_s: float) -> None:
        active = {fault.kind: fault for fault in self._service.faults_at(now_s)}
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
            self._delay(fault.size)
        elif fault.kind is FaultKind.PROTECTIVE_STOP:
            self._protective_stop()
        elif fault.kind is FaultKind.EMERGENCY_STOP:
            self.body.safety.emergency_stop()
            self._safety_stop("emergency stop")
        elif fault.kind is FaultKind.STALL:
            self.body.motion.stalled = True
        elif fault.kind is FaultKind.UNLOCK:
            self._reset_safety()

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

    def _note(self, name: str, **detail: object) -> None:
        self._trace.note(time.monotonic_ns(), name, self.body.motion.pose, **detail)


def _refusal(settings: DeviceSettings, error: OSError) -> DeviceError:
    if error.errno == errno.EADDRINUSE:
        remedy = "another emulator has that address: choose a free one such as 127.0.0.6"
    elif error.errno == errno.EADDRNOTAVAIL:
        remedy = "choose a loopback address such as 127.0.0.6"
    else:
        remedy = f"see that {settings.folder} can be created and written"
    return DeviceError(
        f"emulated robot at {settings.host}: {error.strerror or error}", remedy=remedy
    )


def _serve(settings: DeviceSettings, service: Service) -> None:
    keep_time(mostly_sleeps=True)
    try:
        controller = UrController(settings, service)
    except OSError as error:
        raise _refusal(settings, error) from error
    try:
        controller.serve()
    finally:
        controller.close()


TRACE_FILE = "arm_trace.bin"
EVENTS_FILE = "arm_events.jsonl"

TRACE_ROW = struct.Struct("<q6dB7x")  # stamp, position, velocity, program state, padding
_REST_PERIOD_NS = 1_000_000_000
_FLUSH_PERIOD_NS = 100_000_000


class ArmTrace:
    """Keeps what the arm truly did, so that anyone can say how a fault ended.

    ``arm_trace.bin`` holds one row for each cycle in which the arm moved and one a second while it
    rests, buffered for at most 0.1 s; ``arm_events.jsonl`` one line for each thing that happened.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._rows = (folder / TRACE_FILE).open("ab")
        self._events = (folder / EVENTS_FILE).open("a", encoding="utf-8")
        self._last_row_ns = 0
        self._last_flush_ns = 0
        self._was_moving = True

    def add(self, stamp_ns: int, position: Vector3, velocity: Vector6, runtime_state: int) -> None:
        """Note one cycle."""
        moving = velocity[0] != 0.0 or velocity[1] != 0.0 or velocity[2] != 0.0
        if moving or self._was_moving or stamp_ns - self._last_row_ns >= _REST_PERIOD_NS:
            self._rows.write(TRACE_ROW.pack(stamp_ns, *position, *velocity[:3], runtime_state))
            self._last_row_ns = stamp_ns
        self._was_moving = moving
        if stamp_ns - self._last_flush_ns >= _FLUSH_PERIOD_NS:
            self._rows.flush()
            self._last_flush_ns = stamp_ns

    def note(self, stamp_ns: int, name: str, pose: Vector6, **detail: object) -> None:
        """Note that something happened."""
        line = {"stamp_ns": stamp_ns, "name": name, "z_m": pose[2], **detail}
        self._events.write(json.dumps(line) + "\n")
        self._events.flush()

    def close(self) -> None:
        """Write what is buffered."""
        self._rows.close()
        self._events.close()


_READY, _DONE = 1, 2
_PROGRESS_RUNNING = 1 << 15
# Lever arm that turns the rad/s^2 of stopj into a tip deceleration [m].
_STOPJ_LEVER_M = 0.5


class Command(IntEnum):
    """Command numbers of input_int_register_0; those not listed end at once, doing nothing."""

    NONE = 0
    MOVE_L = 3
    ZERO_FT_SENSOR = 8
    SPEED_L = 10
    SPEED_STOP = 15
    SET_PAYLOAD = 17
    SET_TCP = 29
    PROTECTIVE_STOP = 31
    STOP_L = 33
    SET_WATCHDOG = 35
    IS_POSE_WITHIN_LIMITS = 36
    STOP_SCRIPT = 255


_REAL_TIME = frozenset({6, 9, 10, 11, 24, 25, 26, 27, 38, 58, *range(66, 72)})


class ControlProgram:
    """One running control program of ur_rtde 1.6.5, as it behaves; no URScript is interpreted.

    Args:
        offset: First register it uses: 0 or 24.
    """

    def __init__(
        self, body: ControllerBody, *, offset: int, on_protective_stop: Callable[[], None]
    ) -> None:
        self._body = body
        self._offset = offset
        self._on_protective_stop = on_protective_stop
        self._executing = False
        self._blocked_until: Callable[[], bool] | None = None
        self._speeding: tuple[Vector6, float] | None = None
        self._asynchronous_move = False
        self._write_count = 0
        self._operation_id = 0
        self.failed = False  # true once it made a runtime error; it then ends
        # Longest silence of the command register it accepts [s], None while no watchdog is set.
        self.watchdog_period_s: float | None = None
        self.command_register = f"input_int_register_{offset}"
        body.inputs[self.command_register] = (0,)
        body.runtime_state = RuntimeState.PLAYING
        self._signal(_READY)
        self._report_progress(running=False)

    def cycle(self) -> bool:
        """Run one controller cycle; return False when the program ended itself."""
        if self._blocked_until is not None:
            if not self._blocked_until():
                return True
            self._blocked_until = None
            self._signal(_DONE)
        self._follow_motion()
        command = self._body.get_int(self._offset)
        if command in _REAL_TIME:
            self._real_time(command)
            self._signal(_READY)
        elif command == Command.NONE:
            self._executing = False
            self._signal(_READY)
        elif command == Command.STOP_SCRIPT:
            return False
        elif not self._executing:
            self._executing = True
            self._blocked_until = self._process(command)
            if self._blocked_until is None:
                self._signal(_DONE)
        return not self.failed

    def end(self) -> None:
        """End the program: threads die with it and the arm brakes."""
        self._body.motion.brake(PROGRAM_END_DECELERATION)
        self._body.runtime_state = RuntimeState.STOPPED

    def _follow_motion(self) -> None:
        motion = self._body.motion
        if self._asynchronous_move and motion.is_still:
            self._asynchronous_move = False
            self._report_progress(running=False)
        # stopL brakes the arm but leaves the speed thread alive, which then drives on.
        if self._speeding is not None and motion.is_still and any(self._speeding[0]):
            motion.set_velocity(self._speeding[0], acceleration=self._speeding[1])

    def _real_time(self, command: int) -> None:
        if command != Command.SPEED_L:
            return
        target, acceleration = self._vector(0), self._double(6)
        self.failed = self._asynchronous_move
        if self._speeding != (target, acceleration) and not self.failed:
            self._speeding = (target, acceleration)
            self._body.motion.set_velocity(target, acceleration=acceleration)

    def _process(self, command: int) -> Callable[[], bool] | None:
        """Start a command; return what it waits for, or None when it is done at once."""
        if command == Command.MOVE_L:
            return self._move()
        if command in (Command.SPEED_STOP, Command.STOP_L):
            return self._stop(command)
        if command == Command.PROTECTIVE_STOP:
            self._on_protective_stop()
        elif command == Command.SET_WATCHDOG:
            frequency = self._double(0)
            self.watchdog_period_s = 1.0 / frequency if frequency > 0.0 else None
        elif command == Command.SET_TCP:
            self._body.tcp_offset = self._vector(0)
        elif command == Command.SET_PAYLOAD:
            self._body.payload_kg = self._double(0)
        elif command == Command.ZERO_FT_SENSOR:
            self._body.zero_ft_asked = True
        elif command == Command.IS_POSE_WITHIN_LIMITS:
            admitted = self._body.admits_pose(self._vector(0))
            self._body.put_int(self._offset + 1, int(admitted))
        return None

    def _move(self) -> Callable[[], bool] | None:
        speed, acceleration = self._double(6), self._double(7)
        asynchronous = self._body.get_int(self._offset + 1) == 1
        if self._speeding is not None:
            # Two threads of the program driving the arm is a runtime error of the controller.
            self.failed = True
            return None
        self._end_asynchronous_move()
        self._body.motion.move_to(self._vector(0), speed=speed, acceleration=acceleration)
        if not asynchronous:
            return lambda: self._body.motion.is_still
        self._begin_asynchronous()
        return None

    def _stop(self, command: int) -> Callable[[], bool] | None:
        deceleration = self._double(0)
        asynchronous = False
        if command == Command.SPEED_STOP:
            self._speeding = None
        else:
            self._end_asynchronous_move()
            asynchronous = self._body.get_int(self._offset + 1) == 1
            if not asynchronous:  # a stopj then
                deceleration *= _STOPJ_LEVER_M
        self._body.motion.brake(max(deceleration, 1e-3))
        if asynchronous:
            self._begin_asynchronous()
            return None
        return lambda: self._body.motion.is_still

    def _begin_asynchronous(self) -> None:
        self._asynchronous_move = True
        self._operation_id = (self._operation_id + 1) % 128
        self._report_progress(running=True)

    def _end_asynchronous_move(self) -> None:
        if self._asynchronous_move:
            self._asynchronous_move = False
            self._report_progress(running=False)

    def _report_progress(self, *, running: bool) -> None:
        self._write_count = (self._write_count + 1) % 128
        value = (self._write_count << 16) | (self._operation_id << 24)
        self._body.put_int(self._offset + 2, value | (_PROGRESS_RUNNING if running else 0))

    def _signal(self, state: int) -> None:
        if self._body.outputs[f"output_int_register_{self._offset}"][0] != state:
            self._body.put_int(self._offset, state)

    def _double(self, number: int) -> float:
        return self._body.inputs[f"input_double_register_{self._offset + number}"][0]

    def _vector(self, first: int) -> Vector6:
        return vector6(self._double(number) for number in range(first, first + 6))


if __name__ == "__main__":
    sys.exit(run_device(Device.ROBOT, _serve))
