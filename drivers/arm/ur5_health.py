"""Whether an arm still counts as ours: data fresh, connection whole, program running, no stop."""

import os
import socket
import time

import psutil

from drivers.arm.ur5_rtde import RTDE_PORT, RobotMode, RuntimeState, in_words, safety_reason
from drivers.interfaces import ProgramEndedError
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import ArmSample

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
