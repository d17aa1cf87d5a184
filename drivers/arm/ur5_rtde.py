"""RTDE protocol version 2: packets, recipes, and what a UR controller's numbers mean.

Source: Universal Robots, "Real-Time Data Exchange (RTDE) Guide". The driver's probe and the
emulated controller share this file; that it is right is shown by the real client library.
"""

import struct
from collections.abc import Mapping
from enum import IntEnum, IntFlag
from itertools import chain, islice

from tacauchy_rig.core.errors import DeviceError

RTDE_PORT = 30004
DASHBOARD_PORT = 29999
SCRIPT_PORT = 30003
PROTOCOL_VERSION = 2

Value = tuple[float, ...]

_HEADER = struct.Struct(">HB")


class PacketKind(IntEnum):
    """Packet types: the ASCII letters of the guide."""

    REQUEST_PROTOCOL_VERSION = 86
    GET_URCONTROL_VERSION = 118
    TEXT_MESSAGE = 77
    DATA = 85
    SETUP_OUTPUTS = 79
    SETUP_INPUTS = 73
    START = 83
    PAUSE = 80


TYPE_FORMATS: dict[str, str] = {
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "INT32": "i",
    "UINT32": "I",
    "UINT64": "Q",
    "UINT8": "B",
    "BOOL": "?",
}

_REGISTER_COUNT = 48


def _typed(type_name: str, names: str) -> dict[str, str]:
    return dict.fromkeys(names.split(), type_name)


def _registers(direction: str) -> dict[str, str]:
    numbers = range(_REGISTER_COUNT)
    return (
        {f"{direction}_int_register_{number}": "INT32" for number in numbers}
        | {f"{direction}_double_register_{number}": "DOUBLE" for number in numbers}
        | _typed("UINT32", f"{direction}_bit_registers0_to_31 {direction}_bit_registers32_to_63")
    )


OUTPUT_TYPES: dict[str, str] = (
    _typed(
        "DOUBLE",
        "timestamp actual_execution_time speed_scaling target_speed_fraction actual_momentum"
        " actual_main_voltage actual_robot_voltage actual_robot_current tcp_force_scalar payload"
        " standard_analog_input0 standard_analog_input1 standard_analog_output0"
        " standard_analog_output1",
    )
    | _typed(
        "VECTOR6D",
        "target_q target_qd target_qdd target_current target_moment actual_q actual_qd"
        " actual_current joint_control_output actual_TCP_pose actual_TCP_speed actual_TCP_force"
        " target_TCP_pose target_TCP_speed joint_temperatures actual_joint_voltage"
        " payload_inertia ft_raw_wrench tcp_offset actual_current_as_torque",
    )
    | _typed("VECTOR3D", "actual_tool_accelerometer elbow_position elbow_velocity payload_cog")
    | _typed("VECTOR6INT32", "joint_mode")
    | _typed("INT32", "robot_mode safety_mode safety_status")
    | _typed("UINT32", "runtime_state robot_status_bits safety_status_bits analog_io_types")
    | _typed("UINT64", "actual_digital_input_bits actual_digital_output_bits")
    | _registers("output")
)

INPUT_TYPES: dict[str, str] = (
    _typed("DOUBLE", "speed_slider_fraction standard_analog_output_0 standard_analog_output_1")
    | _typed("VECTOR6D", "external_force_torque")
    | _typed("UINT32", "speed_slider_mask")
    | _typed(
        "UINT8",
        "standard_digital_output_mask standard_digital_output configurable_digital_output_mask"
        " configurable_digital_output tool_digital_output_mask tool_digital_output"
        " standard_analog_output_mask standard_analog_output_type",
    )
    | {f"input_bit_register_{number}": "BOOL" for number in range(64, 128)}
    | _registers("input")
)


def pack_packet(kind: int, body: bytes = b"") -> bytes:
    """Return a packet: total size including the header, type, body."""
    return _HEADER.pack(_HEADER.size + len(body), kind) + body


def split_names(text: bytes) -> list[str]:
    """Return the names of a comma-separated list; clients end it with a comma."""
    return [name for name in text.decode("latin-1").split(",") if name]


class PacketReader:
    """Cuts a byte stream into packets, however the bytes arrive."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Return (type, body) of every packet that ``data`` completes.

        Raises:
            DeviceError: A size below the header's, so this is not an RTDE stream.
        """
        self._buffer += data
        packets: list[tuple[int, bytes]] = []
        while len(self._buffer) >= _HEADER.size:
            size, kind = _HEADER.unpack_from(self._buffer)
            if size < _HEADER.size:
                raise DeviceError(f"RTDE packet says that it is {size} bytes long")
            if len(self._buffer) < size:
                break
            packets.append((kind, bytes(self._buffer[_HEADER.size : size])))
            del self._buffer[:size]
        return packets


class Recipe:
    """The fields of a data packet in either direction, which follow the recipe's number.

    Args:
        names: Fields, each known to ``types``.
        types: ``OUTPUT_TYPES`` from the controller, ``INPUT_TYPES`` to it.
    """

    def __init__(self, names: list[str], types: Mapping[str, str]) -> None:
        self.names = names
        self.types = [types[name] for name in names]
        layouts = [TYPE_FORMATS[each] for each in self.types]
        self._counts = [int(layout[:-1] or "1") for layout in layouts]
        self._fields = struct.Struct(">" + "".join(layouts))

    def pack(self, values: Mapping[str, Value]) -> bytes:
        """Return the fields; ``values`` holds a tuple for each name, scalars included."""
        return self._fields.pack(*chain.from_iterable(values[name] for name in self.names))

    def unpack(self, data: bytes) -> dict[str, Value]:
        """Return the values of the fields.

        Raises:
            DeviceError: The data have another length.
        """
        if len(data) != self._fields.size:
            raise DeviceError(f"RTDE data of {len(data)} bytes instead of {self._fields.size}")
        numbers = iter(self._fields.unpack(data))
        counted = zip(self.names, self._counts, strict=True)
        return {name: tuple(islice(numbers, count)) for name, count in counted}


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


def in_words(kind: type[IntEnum], value: int) -> str:
    """Return what a number of the controller means, for example ``power off``."""
    names = {each.value: each.name.lower().replace("_", " ") for each in kind}
    return names.get(value, f"unknown: {value}")
