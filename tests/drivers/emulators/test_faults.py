"""Telling an emulated device to fail."""

from __future__ import annotations

import math
import socket
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.emulators.faults import (
    AMOUNTS,
    FAULTS_OF_DEVICE,
    STOPS,
    Device,
    Fault,
    FaultKind,
    parse_fault,
)
from drivers.emulators.process import (
    FaultInbox,
    FaultSchedule,
    control_path,
    decode_message,
    encode_message,
    post_fault,
)
from tacauchy_rig.core.errors import ConfigError, DeviceError

_POSSIBLE = [(device, kind) for device, kinds in FAULTS_OF_DEVICE.items() for kind in kinds]
_seconds = st.floats(1e-6, 1e6)


def test_parses_device_kind_start_and_duration() -> None:
    """The full form and the short form mean what they say."""
    fault = parse_fault("force_sensor:freeze@12s+2s")
    assert fault == Fault(
        device=Device.FORCE_SENSOR, kind=FaultKind.FREEZE, start_s=12.0, duration_s=2.0
    )
    assert parse_fault("robot:stall+500ms").duration_s == 0.5
    assert parse_fault("robot:protective-stop@3s").start_s == 3.0
    assert math.isinf(parse_fault("camera:unplug").duration_s)
    assert parse_fault("force_sensor:scale=0.1@3s").amount == 0.1
    assert parse_fault("robot:wrong-pose=-0.2 mm/s+4s").amount == -0.2e-3
    assert parse_fault("camera:drop").size == 0.3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("robot", "is not understood"),
        ("robot:freeze@12", "has no unit"),
        ("lamp:freeze", "device 'lamp' is unknown"),
        ("robot:melt", "kind 'melt' is unknown"),
        ("robot:garble@1s", "a robot cannot garble"),
        ("camera:emergency-stop", "a camera cannot emergency-stop"),
        ("robot:freeze@1s+0s", "impossible"),
        ("robot:freeze@-1s", "impossible"),
        ("robot:freeze=2", "robot:freeze takes no amount"),
        ("force_sensor:drop=120%", "1.2 is not from 0 to 1"),
        ("robot:clock-jump=10", "has no unit"),
        ("camera:freeze", "a camera cannot freeze"),
    ],
)
def test_refuses_with_the_reason(text: str, message: str) -> None:
    """A bad plan is refused, saying why and what would do."""
    with pytest.raises(ConfigError, match=message) as caught:
        parse_fault(text)
    assert caught.value.remedy


@given(
    pair=st.sampled_from(_POSSIBLE),
    start_s=st.just(0.0) | _seconds,
    duration_s=st.just(math.inf) | _seconds,
    share=st.floats(0.0, 1.0),
)
def test_message_round_trip(
    pair: tuple[Device, FaultKind], start_s: float, duration_s: float, share: float
) -> None:
    """What is sent is what arrives."""
    possible = AMOUNTS.get(pair)
    amount = possible and possible.least + share * (possible.most - possible.least)
    fault = Fault(
        device=pair[0],
        kind=pair[1],
        start_s=start_s,
        duration_s=duration_s,
        amount=amount,
    )
    assert decode_message(encode_message(fault)) == fault


def test_inbox_receives_without_blocking(tmp_path: Path) -> None:
    """Faults arrive in order, once; the folder's path may be long."""
    folder = tmp_path / ("long" * 40)
    inbox = FaultInbox(folder, Device.ROBOT)
    assert inbox.poll() == []
    late = parse_fault("robot:delay=100ms+2s")
    post_fault(folder, late)
    post_fault(folder, parse_fault("robot:freeze"))
    first, second = inbox.poll()
    assert first == late
    assert math.isinf(second.duration_s)
    assert inbox.poll() == []
    inbox.close()
    assert not control_path(folder, Device.ROBOT).exists()


@pytest.mark.parametrize("nonsense", [b"[" * 60_000, b'{"kind":' * 8_000, b"\xff\x00", b""])
def test_nonsense_ends_no_emulator(tmp_path: Path, nonsense: bytes) -> None:
    """Whatever comes, the next fault is heard."""
    inbox = FaultInbox(tmp_path, Device.ROBOT)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.sendto(nonsense, str(control_path(tmp_path, Device.ROBOT)))
    post_fault(tmp_path, parse_fault("robot:stall"))
    assert [fault.kind for fault in inbox.poll()] == [FaultKind.STALL]
    inbox.close()


def test_nobody_listens(tmp_path: Path) -> None:
    """Sending to an emulator that is not there says where it was looked for."""
    with pytest.raises(DeviceError, match=r"emulated robot: nothing listens at .*robot\.control"):
        post_fault(tmp_path, parse_fault("robot:freeze+1s"))


def test_a_dead_emulators_socket_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A socket file left behind by a kill does not stop the next emulator."""
    monkeypatch.chdir(tmp_path)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as dead:
        dead.bind(control_path(Path(), Device.CAMERA).name)
    assert control_path(tmp_path, Device.CAMERA).exists()
    heir = FaultInbox(tmp_path, Device.CAMERA)
    post_fault(tmp_path, parse_fault("camera:unplug"))
    assert [fault.kind for fault in heir.poll()] == [FaultKind.UNPLUG]
    heir.close()


def test_what_is_forgotten_is_over_and_what_is_to_come_stays() -> None:
    """Unlocking ends the stop that is on, not the one that is planned."""
    schedule = FaultSchedule()
    for text in ("robot:protective-stop", "robot:protective-stop@9s", "robot:stall"):
        schedule.add(parse_fault(text), now_s=0.0)
    schedule.forget(STOPS, now_s=1.0)
    assert [fault.kind for fault in schedule.active(1.0)] == [FaultKind.STALL]
    assert FaultKind.PROTECTIVE_STOP in {fault.kind for fault in schedule.active(9.0)}


def test_schedule_follows_the_clock() -> None:
    """A fault is on from its start for its duration, counted from when it was told."""
    schedule = FaultSchedule()
    schedule.add(parse_fault("robot:freeze@2s+3s"), now_s=100.0)
    on = [bool(schedule.active(now_s)) for now_s in (100.0, 101.9, 102.0, 104.9, 105.0)]
    assert on == [False, False, True, True, False]
