"""The control program that ur_rtde uploads, as it behaves: commands come through registers.

No URScript is interpreted. The behaviour was read in the program that ur_rtde 1.6.5 carries:
which command numbers run every cycle and which once, what ends which motion, and how progress
of asynchronous moves is reported.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum

from drivers.arm.ur5_wire import RuntimeState
from drivers.emulators.arm.body import PROGRAM_END_DECELERATION, ControllerBody
from tacauchy_rig.core.run import Vector6, vector6

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
    """One running control program.

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
