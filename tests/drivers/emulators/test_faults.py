"""Telling an emulated device to fail."""

from __future__ import annotations

import math
import socket
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.emulators.faults import FAULTS_OF_DEVICE, STOPS, Device, Fault, FaultKind, parse_fault
from drivers.emulators.process import DeviceSettings, Service, control_path, post_fault
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import ConfigError, DeviceError

_seconds = st.floats(1e-6, 1e6)


@contextmanager
def _listening(folder: Path, device: Device = Device.ROBOT) -> Iterator[Service]:
    with closing(
        Service(DeviceSettings(folder=folder, config=load_config().config), device)
    ) as service:
        yield service


@pytest.fixture(scope="module", params=list(Device))
def listener(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Path, Service]]:
    """A device that hears what it is told, and its folder."""
    folder = tmp_path_factory.mktemp("devices")
    with _listening(folder, request.param) as service:
        yield folder, service


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
    data=st.data(),
    start_s=st.just(0.0) | _seconds,
    duration_s=st.just(math.inf) | _seconds,
    share=st.floats(0.0, 1.0),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_sent_is_what_arrives(
    listener: tuple[Path, Service],
    data: st.DataObject,
    start_s: float,
    duration_s: float,
    share: float,
) -> None:
    """Any fault of any device survives the socket, and is on from its start for its duration."""
    folder, service = listener
    kind = data.draw(st.sampled_from(sorted(FAULTS_OF_DEVICE[service.device])))
    possible = FAULTS_OF_DEVICE[service.device][kind]
    amount = possible and possible.least + share * (possible.most - possible.least)
    fault = Fault(
        device=service.device, kind=kind, start_s=start_s, duration_s=duration_s, amount=amount
    )
    post_fault(folder, fault)
    assert service.faults_at(-1.0) == [fault] * (start_s == 0.0)
    assert service.faults_at(-1.0 + start_s) == [fault]
    service.end_faults(set(FaultKind), now_s=math.inf)


def test_faults_are_heard_without_blocking(tmp_path: Path) -> None:
    """Faults arrive in order, once; the folder's path may be long."""
    folder = tmp_path / ("long" * 40)
    with _listening(folder) as service:
        assert service.faults_at(0.0) == []
        told = [parse_fault(text) for text in ("robot:delay=100ms+2s", "robot:freeze")]
        for fault in told:
            post_fault(folder, fault)
        assert service.faults_at(0.0) == service.faults_at(1.0) == told
    assert not control_path(folder, Device.ROBOT).exists()


@pytest.mark.parametrize("nonsense", [b"[" * 60_000, b'{"kind":' * 8_000, b"\xff\x00", b""])
def test_nonsense_ends_no_emulator(tmp_path: Path, nonsense: bytes) -> None:
    """Whatever comes, the next fault is heard."""
    with _listening(tmp_path) as service:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.sendto(nonsense, str(control_path(tmp_path, Device.ROBOT)))
        post_fault(tmp_path, parse_fault("robot:stall"))
        assert [fault.kind for fault in service.faults_at(0.0)] == [FaultKind.STALL]


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
    with _listening(tmp_path, Device.CAMERA) as heir:
        post_fault(tmp_path, parse_fault("camera:unplug"))
        assert [fault.kind for fault in heir.faults_at(0.0)] == [FaultKind.UNPLUG]


def test_what_is_mended_is_over_and_what_is_to_come_stays(tmp_path: Path) -> None:
    """Unlocking ends the stop that is on, not the one that is planned."""
    with _listening(tmp_path) as service:
        for text in ("robot:protective-stop", "robot:protective-stop@9s", "robot:stall"):
            post_fault(tmp_path, parse_fault(text))
        service.faults_at(0.0)
        service.end_faults(STOPS, now_s=1.0)
        assert [fault.kind for fault in service.faults_at(1.0)] == [FaultKind.STALL]
        assert FaultKind.PROTECTIVE_STOP in {fault.kind for fault in service.faults_at(9.0)}


def test_a_fault_follows_the_clock(tmp_path: Path) -> None:
    """A fault is on from its start for its duration, counted from when it was told."""
    with _listening(tmp_path) as service:
        post_fault(tmp_path, parse_fault("robot:freeze@2s+3s"))
        on = [bool(service.faults_at(now_s)) for now_s in (100.0, 101.9, 102.0, 104.9, 105.0)]
    assert on == [False, False, True, True, False]
