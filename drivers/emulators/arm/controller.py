"""An emulated UR controller: a process of its own that real ur_rtde clients connect to.

It prints one JSON line when its ports are open, then serves until it is told to end.
"""

import functools
import json
import select
import sys
import time
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path

from drivers.arm.ur5_rtde import RuntimeState
from drivers.emulators.arm.coarse_force_estimate import ForceEstimate
from drivers.emulators.arm.rtde_and_dashboard_ports import DashboardPort, RtdePort, ScriptPort
from drivers.emulators.arm.safety_and_registers import (
    EMERGENCY_STOP,
    NORMAL,
    PROGRAM_END_DECELERATION,
    PROTECTIVE_STOP,
    SAFETY_STOP_DECELERATION,
    ControllerBody,
    Safety,
)
from drivers.emulators.faults import STOPS, Device, Fault, FaultKind, SilentArmFaults
from drivers.emulators.process import DeviceSettings, Service, keep_time, run_device
from drivers.emulators.shared_world import WORLD_FILE, SharedWorld, plant_of
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import Pose, Vector3, Vector6, vector6

# A starved process catches up on its arm's motion in one step, up to this long [s].
_CATCH_UP_S = 1.0


class UrController:
    """One emulated controller with its three ports."""

    def __init__(self, settings: DeviceSettings, service: Service) -> None:
        self._service, self._host = service, settings.host
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
        dashboard = DashboardPort(
            settings.host,
            self.body,
            stop_program=lambda: self._end_program("dashboard"),
            reset_safety=self._reset_safety,
        )
        script = ScriptPort(settings.host, start_program=self._start_program)
        self._ports = [self._rtde, dashboard, script]
        self._program: ControlProgram | None = None
        self._period_s = 1.0 / robot.model.rate_hz
        self._start_s = time.monotonic()
        self._cycle = 0
        self._fed_s = 0.0

    def serve(self) -> None:
        """Say where it listens and serve clients until its time is over."""
        self._service.announce(host=self._host, model=self.body.model.value)
        while not self._service.is_over:
            now_s = time.monotonic()
            if FaultKind.FREEZE not in self._active:
                self._answer(now_s)
            due = int((now_s - self._start_s) / self._period_s)
            if due > self._cycle:
                self._run_cycle(due, now_s)
            wait_s = self._start_s + (self._cycle + 1) * self._period_s - time.monotonic()
            if wait_s > 0.0:
                watched = () if FaultKind.FREEZE in self._active else self._ports
                links = [link for port in watched for link in port.sockets()]
                select.select(links, [], [], wait_s)

    def close(self) -> None:
        """Close every port and file."""
        for port in self._ports:
            port.drop()
        self._trace.close()
        self._world.close()

    def _answer(self, now_s: float) -> None:
        for port in self._ports:
            port.service(now_s)
        if self._program is not None and self._program.command_register in self._rtde.written:
            self._fed_s = now_s

    def _run_cycle(self, due: int, now_s: float) -> None:
        passed_s = min((due - self._cycle) * self._period_s, _CATCH_UP_S)
        self._cycle = due
        stamp_ns = time.monotonic_ns()
        self._update_faults(now_s)
        self._run_program(now_s)
        motion = self.body.motion
        motion.step(passed_s)
        silent, off_m = self._silent, self._silent.height_m
        silent.advance(self._active.values(), motion.velocity, duration_s=passed_s)
        if off_m and not silent.height_m:  # the controller learns where its arm is
            motion.pose = Pose.of(motion.pose).shifted(z=-off_m).as_vector()
        pose = Pose.of(motion.pose).shifted(z=-silent.height_m)
        force, moment = self._gel.wrench(pose, stamp_ns)
        if self.body.zero_ft_asked:
            self._estimate.zero()
            self.body.zero_ft_asked = False
        self.body.publish(
            time_s=round(due * self._period_s + silent.clock_s, 6),
            tcp_force=self._estimate.advance(
                (*force, *moment), motion.velocity, duration_s=passed_s
            ),
        )
        self._world.publish(pose, stamp_ns)
        self._trace.add(stamp_ns, pose.position, motion.velocity, self.body.runtime_state)
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
        if self.body.safety is not NORMAL or not self.body.remote_control:
            self._note("program-refused")
            return
        self._end_program("replaced")
        stop = functools.partial(self._stop, PROTECTIVE_STOP)
        self._program = ControlProgram(self.body, offset=offset, on_protective_stop=stop)
        self._fed_s = time.monotonic()
        self._note("program-started")

    def _end_program(self, reason: str) -> None:
        if self._program is not None:
            self._program.end()
            self._program = None
            self._note("program-ended", reason=reason)

    def _stop(self, safety: Safety) -> None:
        if self.body.safety is not EMERGENCY_STOP:
            self.body.safety = safety
        self._end_program(safety.name.lower().replace("_", " "))
        self.body.motion.brake(SAFETY_STOP_DECELERATION)
        self.body.runtime_state = RuntimeState.STOPPED

    def _reset_safety(self) -> None:
        mended = STOPS | {FaultKind.UNLOCK}
        self._service.end_faults(mended, now_s=time.monotonic())
        # Forgotten here too, or the same stop told of in the next cycle would pass for this one.
        self._active = {kind: on for kind, on in self._active.items() if kind not in mended}
        self.body.safety = NORMAL
        self._note("safety-reset")

    def _update_faults(self, now_s: float) -> None:
        before = self._active
        self._active = active = {fault.kind: fault for fault in self._service.faults_at(now_s)}
        # What ends comes first: a reset must not undo a stop that begins.
        for kind in sorted(active.keys() ^ before.keys(), key=lambda kind: kind in active):
            begins = kind in active
            self._note("fault-started" if begins else "fault-ended", kind=kind.value)
            self._switch(active[kind] if begins else before[kind], begins=begins)

    def _switch(self, fault: Fault, *, begins: bool) -> None:
        match fault.kind:
            case FaultKind.DROP:
                for port in self._ports:
                    (port.drop if begins else port.open)()
            case FaultKind.DELAY:
                for port in self._ports:
                    port.delay(fault.size if begins else 0.0)
            case FaultKind.STALL:
                self.body.motion.stalled = begins
            case FaultKind.PROTECTIVE_STOP if begins:
                self._stop(PROTECTIVE_STOP)
            case FaultKind.EMERGENCY_STOP if begins:
                self._stop(EMERGENCY_STOP)
            case FaultKind.PROTECTIVE_STOP | FaultKind.EMERGENCY_STOP:
                self._reset_safety()
            case FaultKind.UNLOCK if begins:
                self._reset_safety()

    def _note(self, name: str, **detail: object) -> None:
        z_m = self.body.motion.pose[2]
        self._trace.note(time.monotonic_ns(), name=name, z_m=z_m, **detail)


def _serve(settings: DeviceSettings, service: Service) -> None:
    keep_time(mostly_sleeps=True)
    try:
        controller = UrController(settings, service)
    except OSError as error:
        raise DeviceError(
            f"emulated robot at {settings.host}: {error.strerror or error}",
            remedy="another emulator may have that address: choose a free one such as 127.0.0.6; "
            f"see that {settings.folder} can be written",
        ) from error
    try:
        controller.serve()
    finally:
        controller.close()


TRACE_FILE = "arm_trace.jsonl"
_REST_PERIOD_NS = 1_000_000_000


class ArmTrace:
    """Keeps what the arm truly did, so that anyone can say how a fault ended.

    A JSON line for each cycle in which the arm moved, one a second while it rests, and one for each
    thing that happened.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._lines = (folder / TRACE_FILE).open("a", buffering=1, encoding="utf-8")
        self._last_row_ns = 0
        self._was_moving = True

    def add(self, stamp_ns: int, position: Vector3, velocity: Vector6, runtime_state: int) -> None:
        """Note one cycle."""
        moving = any(velocity[:3])
        if moving or self._was_moving or stamp_ns - self._last_row_ns >= _REST_PERIOD_NS:
            state = {"velocity": velocity[:3], "runtime_state": runtime_state}
            self.note(stamp_ns, position=position, **state)
            self._last_row_ns = stamp_ns
        self._was_moving = moving

    def note(self, stamp_ns: int, **what: object) -> None:
        """Note that something happened."""
        self._lines.write(json.dumps({"stamp_ns": stamp_ns, **what}) + "\n")

    def close(self) -> None:
        """Close the file."""
        self._lines.close()


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
        self._put_int(0, _READY)
        self._report_progress(running=False)

    def cycle(self) -> bool:
        """Run one controller cycle; return False when the program ended itself."""
        if self._blocked_until is not None:
            if not self._blocked_until():
                return True
            self._blocked_until = None
            self._put_int(0, _DONE)
        self._follow_motion()
        command = self._get_int(0)
        if command in _REAL_TIME:
            self._real_time(command)
            self._put_int(0, _READY)
        elif command == Command.NONE:
            self._executing = False
            self._put_int(0, _READY)
        elif command == Command.STOP_SCRIPT:
            return False
        elif not self._executing:
            self._executing = True
            self._blocked_until = self._process(command)
            if self._blocked_until is None:
                self._put_int(0, _DONE)
        return not self.failed

    def end(self) -> None:
        """End the program: threads die with it and the arm brakes."""
        self._body.motion.brake(PROGRAM_END_DECELERATION)
        self._body.runtime_state = RuntimeState.STOPPED

    def _follow_motion(self) -> None:
        motion = self._body.motion
        if self._asynchronous_move and motion.is_still:
            self._end_asynchronous_move()
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
        body = self._body
        match command:
            case Command.MOVE_L:
                return self._move()
            case Command.SPEED_STOP | Command.STOP_L:
                return self._stop(command)
            case Command.PROTECTIVE_STOP:
                self._on_protective_stop()
            case Command.SET_WATCHDOG:
                frequency = self._double(0)
                self.watchdog_period_s = 1.0 / frequency if frequency > 0.0 else None
            case Command.SET_TCP:
                body.tcp_offset = self._vector(0)
            case Command.SET_PAYLOAD:
                body.payload_kg = self._double(0)
            case Command.ZERO_FT_SENSOR:
                body.zero_ft_asked = True
            case Command.IS_POSE_WITHIN_LIMITS:
                self._put_int(1, int(body.admits_pose(self._vector(0))))
        return None

    def _move(self) -> Callable[[], bool] | None:
        if self._speeding is not None:
            # Two threads of the program driving the arm is a runtime error of the controller.
            self.failed = True
            return None
        self._end_asynchronous_move()
        speed, acceleration = self._double(6), self._double(7)
        self._body.motion.move_to(self._vector(0), speed=speed, acceleration=acceleration)
        return self._waits(asynchronous=self._get_int(1) == 1)

    def _stop(self, command: int) -> Callable[[], bool] | None:
        deceleration, asynchronous = self._double(0), False
        if command == Command.SPEED_STOP:
            self._speeding = None
        else:
            self._end_asynchronous_move()
            asynchronous = self._get_int(1) == 1
            if not asynchronous:  # a stopj then
                deceleration *= _STOPJ_LEVER_M
        self._body.motion.brake(max(deceleration, 1e-3))
        return self._waits(asynchronous=asynchronous)

    def _waits(self, *, asynchronous: bool) -> Callable[[], bool] | None:
        """Return what a motion that has begun waits for; None where it goes on by itself."""
        if not asynchronous:
            return lambda: self._body.motion.is_still
        self._asynchronous_move = True
        self._operation_id = (self._operation_id + 1) % 128
        self._report_progress(running=True)
        return None

    def _end_asynchronous_move(self) -> None:
        if self._asynchronous_move:
            self._asynchronous_move = False
            self._report_progress(running=False)

    def _report_progress(self, *, running: bool) -> None:
        self._write_count = (self._write_count + 1) % 128
        value = (self._write_count << 16) | (self._operation_id << 24)
        self._put_int(2, value | (_PROGRESS_RUNNING if running else 0))

    def _put_int(self, number: int, value: int) -> None:
        self._body.outputs[f"output_int_register_{self._offset + number}"] = (value,)

    def _get_int(self, number: int) -> int:
        return int(self._body.inputs[f"input_int_register_{self._offset + number}"][0])

    def _double(self, number: int) -> float:
        return self._body.inputs[f"input_double_register_{self._offset + number}"][0]

    def _vector(self, first: int) -> Vector6:
        return vector6(self._double(number) for number in range(first, first + 6))


if __name__ == "__main__":
    sys.exit(run_device(Device.ROBOT, _serve))
