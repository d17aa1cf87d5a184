"""The probe's diagnoses, each of a controller (or something else) that is really there."""

import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from drivers.arm.ur5_controller_check import ControllerReport, probe_controller, require_ready
from drivers.arm.ur5_rtde import DASHBOARD_PORT, RTDE_PORT, SCRIPT_PORT, RuntimeState, SafetyBit
from drivers.emulators.faults import FaultKind, parse_fault
from drivers.emulators.launch import free_loopback_host
from drivers.emulators.process import post_fault
from tacauchy_rig.core.config.settings import RobotModel
from tacauchy_rig.core.errors import DeviceError

_MODELS = list(RobotModel)
_GREETING = b"Connected: Universal Robots Dashboard Server\n1\ntrue\n"


@pytest.fixture
def host() -> str:
    """A loopback address of this test's own."""
    return free_loopback_host()


@pytest.mark.parametrize("model", _MODELS)
def test_a_ready_controller_is_described(emulate_ur: Callable[..., Any], model: RobotModel) -> None:
    """Version, remote control, state and data rate are found; only a wrong model is refused."""
    report = probe_controller(emulate_ur(model).host)
    assert report.model is model
    assert report.version[0] == model.major_version
    assert report.remote_control is (True if model is RobotModel.E_SERIES else None)
    assert report.runtime_state == RuntimeState.STOPPED
    assert report.safety_bits == SafetyBit.NORMAL
    assert report.pose[2] == pytest.approx(0.2)
    assert not report.in_use
    require_ready(report, model=model)
    other = next(m for m in _MODELS if m is not model)
    with pytest.raises(DeviceError, match=f"that of a {model.value}, configured is {other.value}"):
        require_ready(report, model=other)


def test_local_control_is_refused(emulate_ur: Callable[..., Any]) -> None:
    """An arm in local control is said to be, with the place of the switch."""
    report = probe_controller(emulate_ur(quirks={"local-control"}).host)
    with pytest.raises(DeviceError, match="is in local control") as caught:
        require_ready(report, model=RobotModel.E_SERIES)
    assert "remote control at the pendant" in caught.value.remedy


@pytest.mark.parametrize(
    ("kind", "message"),
    [(FaultKind.PROTECTIVE_STOP, "protective stop"), (FaultKind.EMERGENCY_STOP, "emergency stop")],
)
def test_a_stopped_arm_is_refused(
    emulate_ur: Callable[..., Any], kind: FaultKind, message: str
) -> None:
    """A stop that a person has to undo is named before anything connects."""
    robot = emulate_ur()
    post_fault(robot.folder, parse_fault(f"robot:{kind}"))
    report = next(r for r in _probes(robot.host) if r.safety_bits != SafetyBit.NORMAL)
    with pytest.raises(DeviceError, match=message):
        require_ready(report, model=RobotModel.E_SERIES)


def test_a_frozen_controller_is_silent(emulate_ur: Callable[..., Any]) -> None:
    """A controller that accepts connections and says nothing is found out by the deadline."""
    robot = emulate_ur()
    post_fault(robot.folder, parse_fault("robot:freeze"))
    with pytest.raises(DeviceError, match="does not answer"):
        list(_probes(robot.host))


def _probes(host: str) -> Iterator[ControllerReport]:
    # The emulator takes a fault at its next cycle, so the first looks may come too early.
    for _ in range(50):
        yield probe_controller(host, timeout_s=0.5)


def test_nobody_there(host: str) -> None:
    """A refused connection names the port and its purpose; a name that does not resolve itself."""
    with pytest.raises(DeviceError, match=rf"{host}: port 30003 \(the script port\) refuses"):
        probe_controller(host, timeout_s=1.0)
    with pytest.raises(DeviceError, match=r"name 'no-robot\.invalid' is unknown"):
        probe_controller("no-robot.invalid", timeout_s=1.0)


@pytest.mark.parametrize(
    ("dashboard", "rtde", "message"),
    [
        (b"SSH-2.0-OpenSSH_9.2\n", b"", "greets with 'SSH"),
        (b"", b"", "port 29999 .* closed the connection"),
        (_GREETING, b"HTTP/1.1 400 Bad Request\r\n\r\n", "port 30004 .* does not answer"),
        (_GREETING, b"\x00\x00\x00\x00", "is not a UR controller with RTDE"),
        (_GREETING, b"\x00\x04V\x00", "refuses protocol version 2"),
        (_GREETING, b"\x00\x04V\x01\x00\x05v\x00\x00", "is not a UR controller with RTDE"),
    ],
)
def test_something_else_answers(host: str, dashboard: bytes, rtde: bytes, message: str) -> None:
    """Other services at that address are recognised, not waited for."""
    says = {SCRIPT_PORT: b"", DASHBOARD_PORT: dashboard, RTDE_PORT: rtde}
    with _Impostor(host, says), pytest.raises(DeviceError, match=message) as caught:
        probe_controller(host, timeout_s=0.5)
    assert host in str(caught.value) or "not a UR controller" in str(caught.value)


class _Impostor:
    """Listens on all three ports, says its piece to whoever connects, and hangs up if mute."""

    def __init__(self, host: str, says: dict[int, bytes]) -> None:
        self._listeners = {socket.create_server((host, port)): text for port, text in says.items()}
        self._links: list[socket.socket] = []

    def __enter__(self) -> None:
        self._threads = [
            threading.Thread(target=self._serve, args=item) for item in self._listeners.items()
        ]
        for thread in self._threads:
            thread.start()

    def __exit__(self, *_: object) -> None:
        for listener in self._listeners:
            listener.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join()
        for link in (*self._links, *self._listeners):
            link.close()

    def _serve(self, listener: socket.socket, text: bytes) -> None:
        while True:
            try:
                link, _ = listener.accept()
            except OSError:
                return
            self._links.append(link)
            link.sendall(text)
            if not text:
                link.shutdown(socket.SHUT_RDWR)
