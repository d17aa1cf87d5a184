"""Parts of the emulated controller that need no client library."""

import math
import socket
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.arm.ur5_rtde import DASHBOARD_PORT, SCRIPT_PORT
from drivers.emulators.arm.controller import TRACE_FILE, ArmTrace
from drivers.emulators.arm.rtde_and_dashboard_ports import Connection, DashboardPort, ScriptPort
from drivers.emulators.arm.safety_and_registers import NORMAL, PROTECTIVE_STOP, ControllerBody
from drivers.emulators.launch import free_loopback_host
from tacauchy_rig.core.config.settings import RobotModel
from tacauchy_rig.core.run import Pose
from tests.drivers.arm_notes import read_events, read_trace

_HOME = Pose(position=(0.3, -0.3, 0.2), rotation_vector=(math.pi, 0.0, 0.0))


@pytest.fixture
def pair() -> Iterator[tuple[Connection, socket.socket]]:
    """A connection of the controller's and the client at its other end."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        client = socket.create_connection(listener.getsockname())
        link, _ = listener.accept()
    connection = Connection(link)
    yield connection, client
    connection.close()
    client.close()


def test_a_client_that_does_not_read_loses_nothing_sent(
    pair: tuple[Connection, socket.socket],
) -> None:
    """What does not fit waits in order; until it is gone the connection calls itself congested."""
    connection, client = pair
    sent = b""
    for number in range(10_000):
        chunk = bytes([number % 251]) * 5000
        connection.send(chunk, 0.0)
        sent += chunk
        if connection.is_congested:
            break
    connection.send(b"tail", 0.0)
    got = b""
    while len(got) < len(sent) + 4:
        got += client.recv(1 << 20)
        connection.service(0.0)
    assert got == sent + b"tail"
    assert not connection.is_congested
    assert connection.alive


def test_a_client_that_never_reads_is_dropped(pair: tuple[Connection, socket.socket]) -> None:
    """A backlog beyond a megabyte ends the connection instead of growing for ever."""
    connection, _ = pair
    sent = 0
    while connection.alive and sent < 50_000_000:
        connection.send(bytes(5000), 0.0)
        sent += 5000
    assert not connection.alive, f"{sent} bytes are waiting"


def test_delay_holds_both_directions_in_order(pair: tuple[Connection, socket.socket]) -> None:
    """Delayed data come late, all of them, in order, also when the delay ends meanwhile."""
    connection, client = pair
    client.setblocking(False)
    connection.delay_s = 0.5
    connection.send(b"first", 10.0)
    connection.delay_s = 0.0
    connection.send(b"second", 10.1)
    connection.service(10.4)
    with pytest.raises(BlockingIOError):
        client.recv(100)
    connection.service(10.6)
    client.setblocking(True)
    assert _read(client, 11) == b"firstsecond"
    connection.delay_s = 0.5
    client.sendall(b"question")
    assert connection.receive(20.0) == b""
    assert connection.receive(20.4) == b""
    assert connection.receive(20.6) == b"question"


def _read(client: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        data += client.recv(size)
    return data


def test_trace_survives_a_cut_row(tmp_path: Path) -> None:
    """A row that a kill cut short is left out; events and rows come back as written."""
    trace = ArmTrace(tmp_path)
    trace.note(5, name="program-started", reason="x")
    for stamp_ns in (10, 20):
        trace.add(stamp_ns, (0.1, 0.2, 0.3), (0.0, 0.0, -0.001, 0.0, 0.0, 0.0), 2)
    trace.close()
    with (tmp_path / TRACE_FILE).open("a") as file:
        file.write('{"stamp_ns": 30, "pos')
    rows = read_trace(tmp_path)
    assert [row.stamp_ns for row in rows] == [10, 20]
    assert rows[0].position == (0.1, 0.2, 0.3)
    assert read_events(tmp_path) == [{"stamp_ns": 5, "name": "program-started", "reason": "x"}]


@pytest.mark.parametrize("model", list(RobotModel))
def test_dashboard_answers_as_its_generation_does(model: RobotModel) -> None:
    """A CB3 does not understand remote control; both stop programs and can be unlocked."""
    host = free_loopback_host()
    body = ControllerBody(model, _HOME)
    stopped: list[str] = []
    dashboard = DashboardPort(
        host,
        body,
        stop_program=lambda: stopped.append("program"),
        reset_safety=lambda: setattr(body, "safety", NORMAL),
    )
    body.safety = PROTECTIVE_STOP
    with socket.create_connection((host, DASHBOARD_PORT)) as client:
        client.sendall(b"robotmode\nsafetystatus\nis in remote control\nstop\nunlock protective ")
        dashboard.service(0.0)
        client.sendall(b"stop\nsafetystatus\nmake coffee\n")
        dashboard.service(0.0)
        lines = _read_lines(client, 8)
    dashboard.drop()
    assert lines[:3] == [
        "Connected: Universal Robots Dashboard Server",
        "Robotmode: RUNNING",
        "Safetystatus: PROTECTIVE_STOP",
    ]
    assert (lines[3] == "true") is (model is RobotModel.E_SERIES)
    assert lines[4:7] == ["Stopped", "Protective stop releasing", "Safetystatus: NORMAL"]
    assert "could not understand" in lines[7]
    assert stopped == ["program"]


def _read_lines(client: socket.socket, count: int) -> list[str]:
    data = b""
    while data.count(b"\n") < count:
        data += client.recv(4096)
    return data.decode().splitlines()


@given(cuts=st.lists(st.integers(1, 40), min_size=1, max_size=5), offset=st.sampled_from([0, 24]))
def test_a_program_starts_when_it_is_complete(cuts: list[int], offset: int) -> None:
    """However the upload is cut up, the program starts once, with its register offset."""
    text = (
        f"def rtde_control():\n  reg_offset_int = {offset}\n  if True:\n    x = 1\n  end\nend\n"
        "def something_else():\nend\n"
    ).encode()
    started: list[int] = []
    port = _TextOnly(started)
    while text:
        size = cuts[len(text) % len(cuts)]
        port.feed(text[:size])
        text = text[size:]
    assert started == [offset]


class _TextOnly(ScriptPort):
    """A script port fed by hand, without its socket."""

    def __init__(self, started: list[int]) -> None:
        self._start_program = started.append
        self._client: Any = SimpleNamespace(partial=b"")

    def feed(self, data: bytes) -> None:
        """Take in a piece."""
        self._hear(self._client, data, 0.0)


def test_script_port_listens() -> None:
    """An upload over a socket starts the program."""
    host, started = free_loopback_host(), list[int]()
    port = ScriptPort(host, start_program=started.append)
    with socket.create_connection((host, SCRIPT_PORT)) as client:
        client.sendall(b"def rtde_control():\nend\n")
        while not started:
            port.service(0.0)
    port.service(0.0)
    port.drop()
    assert started == [0]
