"""What the numbers of a UR controller mean, in words an operator knows from the pendant.

Source: Universal Robots, "Real-Time Data Exchange (RTDE) Guide", controller output fields.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag


class SafetyBit(IntFlag):
    """Bits of ``safety_status_bits``."""

    NORMAL = 1 << 0
    REDUCED = 1 << 1
    PROTECTIVE_STOP = 1 << 2
    RECOVERY = 1 << 3
    SAFEGUARD_STOP = 1 << 4
    SYSTEM_EMERGENCY_STOP = 1 << 5
    ROBOT_EMERGENCY_STOP = 1 << 6
    EMERGENCY_STOP = 1 << 7
    VIOLATION = 1 << 8
    FAULT = 1 << 9
    STOPPED_FOR_SAFETY = 1 << 10


class RobotMode(IntEnum):
    """Values of ``robot_mode``."""

    NO_CONTROLLER = -1
    DISCONNECTED = 0
    CONFIRM_SAFETY = 1
    BOOTING = 2
    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    BACKDRIVE = 6
    RUNNING = 7
    UPDATING_FIRMWARE = 8


class RuntimeState(IntEnum):
    """Values of ``runtime_state``."""

    STOPPING = 0
    STOPPED = 1
    PLAYING = 2
    PAUSING = 3
    PAUSED = 4
    RESUMING = 5


_STOPS: tuple[tuple[SafetyBit, str, str], ...] = (
    (
        SafetyBit.ROBOT_EMERGENCY_STOP,
        "emergency stop (button of the pendant or the robot)",
        "release the button, make sure nobody is near, power the arm on at the pendant",
    ),
    (
        SafetyBit.SYSTEM_EMERGENCY_STOP,
        "emergency stop (from a device wired to the controller)",
        "find out which device stopped it, release it, power the arm on at the pendant",
    ),
    (
        SafetyBit.EMERGENCY_STOP,
        "emergency stop",
        "release the button, make sure nobody is near, power the arm on at the pendant",
    ),
    (
        SafetyBit.VIOLATION,
        "safety limit violated",
        "read the pendant's message, then restart the safety system there",
    ),
    (SafetyBit.FAULT, "safety system fault", "read the pendant's message; restart the controller"),
    (
        SafetyBit.PROTECTIVE_STOP,
        "protective stop",
        "look at the arm, clear what it touched, unlock it at the pendant; never automatically",
    ),
    (SafetyBit.SAFEGUARD_STOP, "safeguard stop", "close the guard, then reset it"),
    (SafetyBit.RECOVERY, "recovery mode", "move the arm back inside its limits at the pendant"),
    (SafetyBit.STOPPED_FOR_SAFETY, "stopped for safety", "read the pendant's message"),
)


def safety_reason(safety_bits: int) -> tuple[str, str] | None:
    """Return (what stopped the arm, what a person has to do), or None when nothing did."""
    for bit, reason, remedy in _STOPS:
        if safety_bits & bit:
            return reason, remedy
    return None


def robot_mode_name(robot_mode: int) -> str:
    """Return the mode in words, for example ``power off``."""
    try:
        return RobotMode(robot_mode).name.lower().replace("_", " ")
    except ValueError:
        return f"unknown mode {robot_mode}"


def runtime_state_name(runtime_state: int) -> str:
    """Return the program's state in words, for example ``stopped``."""
    try:
        return RuntimeState(runtime_state).name.lower()
    except ValueError:
        return f"unknown state {runtime_state}"
