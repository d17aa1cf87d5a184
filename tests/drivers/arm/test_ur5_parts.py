"""The driver's parts that need no controller: deadlines, judgement, caps, words."""

import math
import signal
import socket
import struct
import subprocess
import sys
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.arm.ur5_connection import ArmHealth, Commander, RtdeSockets
from drivers.arm.ur5_motion_and_watchdog import Ur5
from drivers.arm.ur5_rtde import (
    INPUT_TYPES,
    OUTPUT_TYPES,
    RTDE_PORT,
    TYPE_FORMATS,
    PacketReader,
    Recipe,
    RobotMode,
    RuntimeState,
    SafetyBit,
    pack_packet,
    safety_reason,
)
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import DeviceError, SafetyError
from tacauchy_rig.core.run import ArmSample, Pose, Vector6

_STALE_S = 0.05

_HANG_HOLDING_THE_LOCK = """
import ctypes, threading
from drivers.arm.ur5_connection import Guardian

with Guardian("robot 10.0.0.9: connecting", timeout_s=30.0):
    pass
print("still alive", flush=True)
with Guardian("robot 10.0.0.9: connecting", timeout_s=0.3):
    ctypes.PyDLL(None).sleep(60)
print("never printed", flush=True)
"""


def test_guardian_ends_a_process_whose_native_call_hangs() -> None:
    """A call that holds the interpreter lock for ever is ended from outside, with the reason."""
    result = subprocess.run(
        [sys.executable, "-c", _HANG_HOLDING_THE_LOCK],
        capture_output=True,
        text=True,
        check=False,
        timeout=30,
    )
    assert result.returncode == -signal.SIGKILL
    assert result.stdout.split("\n") == ["still alive", ""]
    assert "robot 10.0.0.9: connecting: no answer within 0.3 s" in result.stderr


def test_commander_returns_and_reports() -> None:
    """Results and the library's errors come through, with what was being done."""
    commander = Commander("robot x")
    assert commander.call("adding", lambda: 1 + 1, deadline_s=5.0) == 2
    with pytest.raises(DeviceError, match="robot x: reading failed: no such register"):
        commander.call("reading", _fail, deadline_s=5.0)
    commander.close()


def test_commander_gives_up_for_good() -> None:
    """A call past its deadline fails, and so does every later one, at once."""
    commander = Commander("robot x")
    release = threading.Event()
    with pytest.raises(DeviceError, match=r"moving got no answer within 0\.02 s"):
        commander.call("moving", release.wait, deadline_s=0.02)
    with pytest.raises(DeviceError, match="stopping is not possible, moving still waits"):
        commander.call("stopping", lambda: None, deadline_s=60.0)
    assert commander.is_stuck
    release.set()
    commander.close()


def _fail() -> None:
    raise RuntimeError("no such register")


def _sample(
    *,
    time_s: float = 1.0,
    safety_bits: int = SafetyBit.NORMAL,
    runtime_state: int = RuntimeState.PLAYING,
    robot_mode: int = RobotMode.RUNNING,
) -> ArmSample:
    return ArmSample(
        stamp_ns=0,
        controller_time_s=time_s,
        pose=Pose(position=(0.0, 0.0, 0.0), rotation_vector=(0.0, 0.0, 0.0)),
        velocity=(0.0,) * 6,
        runtime_state=runtime_state,
        safety_bits=safety_bits,
        robot_mode=robot_mode,
    )


@pytest.mark.parametrize(
    ("sample", "message"),
    [
        (_sample(safety_bits=SafetyBit.PROTECTIVE_STOP), "protective stop"),
        (_sample(safety_bits=0xC0 | 0x400), r"emergency stop \(button"),
        (_sample(safety_bits=SafetyBit.SAFEGUARD_STOP), "safeguard stop"),
        (_sample(robot_mode=RobotMode.IDLE), r"not running \(idle\)"),
        (_sample(runtime_state=RuntimeState.STOPPED), r"ended \(runtime state stopped\)"),
        (_sample(runtime_state=99), "unknown: 99"),
    ],
)
def test_a_stop_is_named_and_stays(sample: ArmSample, message: str) -> None:
    """The reason is told in the pendant's words, and a lost arm stays lost."""
    health = ArmHealth("robot x", stale_limit_s=0.1, watchdog_hz=10.0)
    health.require_running(_sample())
    with pytest.raises(DeviceError, match=message) as caught:
        health.require_running(sample)
    assert caught.value.remedy
    with pytest.raises(DeviceError, match=message):
        health.require_alive()


def test_an_earlier_loss_outlives_a_later_one() -> None:
    """What went wrong first is what the operator is told."""
    health = ArmHealth("robot x", stale_limit_s=0.1, watchdog_hz=10.0)
    health.broken()
    with pytest.raises(DeviceError, match="the connection broke"):
        health.require_running(_sample(safety_bits=SafetyBit.PROTECTIVE_STOP))


def test_a_clock_that_was_set_is_named_instead_of_the_network(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The client library's connection ends when the computer's clock is set by an hour."""
    health = ArmHealth("robot x", stale_limit_s=0.1, watchdog_hz=10.0)
    now_s = time.time()
    monkeypatch.setattr(time, "time", lambda: now_s + 3600.0)
    error = health.broken()
    assert "clock was set by +3600 s" in error.message
    assert "network" not in f"{error.message} {error.remedy}"


def test_a_standing_time_stamp_is_a_loss() -> None:
    """Data are judged by the controller's clock, not by their being there."""
    health = ArmHealth("robot x", stale_limit_s=_STALE_S, watchdog_hz=10.0)
    assert health.note(_sample(time_s=1.0))
    assert not health.note(_sample(time_s=1.0))
    assert health.note(_sample(time_s=1.008))
    health.require_fresh()
    time.sleep(_STALE_S * 1.5)
    assert health.looked_away()
    with pytest.raises(DeviceError, match=r"no new data for \d+ ms \(limit 50 ms\)"):
        health.require_fresh()


@given(bits=st.integers(0, 0xFFF))
def test_no_stop_goes_unnamed(bits: int) -> None:
    """Every bit but normal, reduced and the three-position switch means that something stopped."""
    harmless = SafetyBit.NORMAL | SafetyBit.REDUCED | (1 << 11)
    assert (safety_reason(bits) is None) == (bits & ~harmless == 0)


_speed = st.floats(-0.1, 0.1) | st.sampled_from([math.nan, math.inf])


@given(velocity=st.tuples(*[_speed] * 6), acceleration=_speed)
def test_nothing_beyond_a_cap_passes(velocity: Vector6, acceleration: float) -> None:
    """Whatever is not refused is finite and within every cap."""
    config = load_config().config
    caps = {"retract_speed": 0.02, "approach_speed": 0.02, "acceleration": 0.08}
    robot = config.robot.model_copy(update=caps)
    arm = Ur5(config.model_copy(update={"robot": robot}))
    speed, turn_speed = math.hypot(*velocity[:3]), math.hypot(*velocity[3:])
    is_within = speed <= 0.02 and turn_speed <= 0.2 and 0.0 <= acceleration <= 0.08
    with pytest.raises(DeviceError if is_within else SafetyError) as caught:
        arm.set_velocity(velocity, acceleration=acceleration)
    assert is_within or "is beyond the limit of" in str(caught.value)


@pytest.mark.parametrize(
    ("x", "speed", "message"),
    [
        (0.0, 3.0, r"speed 3000 mm/s is beyond the limit of [\d.]+ mm/s"),
        (math.nan, 0.01, "is not a pose"),
    ],
)
def test_caps_name_the_value_and_the_limit(x: float, speed: float, message: str) -> None:
    """A refusal says what was asked and what is allowed, whatever is connected or not."""
    target = Pose(position=(x, 0.0, 0.0), rotation_vector=(0.0, 0.0, 0.0))
    with pytest.raises(SafetyError, match=message):
        Ur5(load_config().config).start_move(target, speed=speed, acceleration=0.1)


def test_a_replaced_connection_is_noticed() -> None:
    """Closing a connection, or one new in its place, is seen at once."""
    with socket.socket() as listener:
        listener.bind((f"127.7.{time.monotonic_ns() % 250}.9", RTDE_PORT))
        listener.listen()
        host = listener.getsockname()[0]
        sockets = RtdeSockets()
        link = socket.create_connection((host, RTDE_PORT))
        sockets.remember(host)
        assert sockets.are_unchanged()
        number = link.fileno()
        link.close()
        assert not sockets.are_unchanged()
        with socket.create_connection((host, RTDE_PORT)) as again:
            assert again.fileno() == number
            assert not sockets.are_unchanged()


_SCALARS = {
    "d": st.floats(allow_nan=False),
    "i": st.integers(-(2**31), 2**31 - 1),
    "I": st.integers(0, 2**32 - 1),
    "Q": st.integers(0, 2**64 - 1),
    "B": st.integers(0, 255),
    "?": st.booleans(),
}


def _values(types: dict[str, str]) -> st.SearchStrategy[dict[str, tuple[float, ...]]]:
    def of(names: list[str]) -> st.SearchStrategy[dict[str, tuple[float, ...]]]:
        fields = {}
        for name in names:
            layout = TYPE_FORMATS[types[name]]
            count = int(layout[:-1] or "1")
            fields[name] = st.tuples(*[_SCALARS[layout[-1]]] * count)
        return st.fixed_dictionaries(fields)

    names = st.lists(st.sampled_from(sorted(types)), unique=True, min_size=1, max_size=12)
    return names.flatmap(of)


@given(
    packets=st.lists(st.tuples(st.integers(0, 255), st.binary(max_size=60)), max_size=6),
    cuts=st.lists(st.integers(1, 7), min_size=1, max_size=400),
)
def test_packets_survive_any_cutting(packets: list[tuple[int, bytes]], cuts: list[int]) -> None:
    """However the stream is cut up, the same packets come out."""
    stream = b"".join(pack_packet(kind, body) for kind, body in packets)
    reader = PacketReader()
    got: list[tuple[int, bytes]] = []
    while stream:
        size = cuts[len(got) % len(cuts)]
        got += reader.feed(stream[:size])
        stream = stream[size:]
    assert got == packets


@given(values=_values(OUTPUT_TYPES | INPUT_TYPES))
def test_fields_round_trip(values: dict[str, tuple[float, ...]]) -> None:
    """What one side packs is what the other unpacks, each field in its own format."""
    types = OUTPUT_TYPES | INPUT_TYPES
    recipe = Recipe(list(values), types)
    packed = [struct.pack(">" + TYPE_FORMATS[types[name]], *values[name]) for name in values]
    assert recipe.pack(values) == b"".join(packed)
    assert recipe.unpack(b"".join(packed)) == values


def test_says_what_is_wrong() -> None:
    """A size below the header's, and bodies of another length, are refused."""
    with pytest.raises(DeviceError, match="2 bytes long"):
        PacketReader().feed(b"\x00\x02U")
    with pytest.raises(DeviceError, match="2 bytes instead of 8"):
        Recipe(["timestamp"], OUTPUT_TYPES).unpack(b"\x00\x00")
