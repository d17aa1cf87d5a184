"""Who may come in, and what the server refuses."""

import http.client
import json
import socket
from urllib.parse import urlsplit

import pytest
from starlette.datastructures import Headers

from protocols.processes.page.access_token import AccessRule
from protocols.processes.page.server import CONNECTIONS_MAX, WATCHERS_MAX
from tacauchy_rig.core.run import Outcome

HOST, ORIGIN = "127.0.0.1:8000", "http://127.0.0.1:8000"
ACCESS = AccessRule("token", port=8000)


@pytest.mark.parametrize(
    ("method", "path", "headers", "admitted"),
    [
        ("GET", "/token/", {"host": HOST}, True),
        ("GET", "/token/events", {"host": "localhost:8000", "origin": ORIGIN}, True),
        ("POST", "/token/stop", {"host": HOST, "origin": ORIGIN}, True),
        ("GET", "/", {"host": HOST}, False),
        ("GET", "/tokem/events", {"host": HOST}, False),
        ("GET", "/tokentoken/events", {"host": HOST}, False),
        ("GET", "token/events", {"host": HOST}, False),
        ("GET", "/tok\u00e9n/", {"host": HOST}, False),
        ("GET", "/token/events", {}, False),
        ("GET", "/token/events", {"host": "127.0.0.1"}, False),
        ("GET", "/token/events", {"host": "evil.example:8000"}, False),
        ("GET", "/token/events", {"host": HOST, "origin": "http://evil.example"}, False),
        ("GET", "/token/events", {"host": HOST, "origin": "null"}, False),
        ("POST", "/token/stop", {"host": HOST}, False),
        ("POST", "/token/stop", {"host": HOST, "origin": "http://evil.example"}, False),
        ("POST", "/token/stop", {"host": HOST, "origin": "http://127.0.0.1:8001"}, False),
    ],
)
def test_the_door_wants_token_host_and_origin(method, path, headers, admitted):
    """What changes something has to say where it comes from; reading may be silent."""
    assert ACCESS.admits(method=method, path=path, headers=Headers(headers)) is admitted


def ask(address, path="", *, method="GET", headers=None, token=None):
    """Return (status, body, headers) of one request."""
    parts = urlsplit(address)
    connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=20)
    place = parts.path if token is None else f"/{token}/"
    try:
        connection.request(method, f"{place}{path}", headers=headers or {})
        answer = connection.getresponse()
        return answer.status, answer.read(), answer.headers
    finally:
        connection.close()


def test_what_is_refused_gets_no_data_and_stops_nothing(long_session):
    """Wrong token, Host or Origin: 403 and one word, for reading and for stopping."""
    address = long_session.address
    good = {"Origin": address.rsplit("/", 2)[0]}
    for changes in (
        {"token": "x" * 32},
        {"headers": {"Host": "evil.example"}},
        {"headers": {**good, "Host": "evil.example"}},
        {"headers": {"Origin": "http://evil.example"}},
    ):
        for method, path in (("GET", ""), ("GET", "picture/camera"), ("POST", "stop")):
            status, body, _ = ask(address, path, method=method, **changes)
            assert (status, body) == (403, b"refused\n")
    assert ask(address, "stop", method="POST")[0] == 403
    assert ask(address, "stop", headers=good)[0] == 405
    assert long_session.abort.count == 0


def test_the_page_may_load_from_its_own_address_alone(long_session):
    """Headers say so, and nothing in its files leads elsewhere."""
    _, page, headers = ask(long_session.address)
    assert "default-src 'self'" in headers["content-security-policy"]
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cache-control"] == "no-store"
    files = [page, *(ask(long_session.address, name)[1] for name in ("page.js", "page.css"))]
    assert all(b"://" not in content for content in files)


def test_it_listens_on_the_loopback_address_alone(long_session):
    """No other address of this computer answers at its port."""
    port = urlsplit(long_session.address).port
    with socket.socket() as probe:
        probe.bind(("127.0.0.2", port))  # would be taken by a listener on every address


def test_one_more_page_than_allowed_is_refused_the_events(long_session):
    """A browser would have no connection left for the stop."""
    parts = urlsplit(long_session.address)
    held = []
    try:
        statuses = []
        for _ in range(WATCHERS_MAX + 1):
            connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=20)
            held.append(connection)
            connection.request("GET", f"{parts.path}events")
            answer = connection.getresponse()
            statuses.append(answer.status)
            if answer.status == 200:
                assert answer.readline() == b"event: setup\n"
                assert json.loads(answer.readline().removeprefix(b"data: "))["simulated"] is True
        assert statuses == [200] * WATCHERS_MAX + [503]
    finally:
        for connection in held:
            connection.close()


@pytest.mark.slow
def test_idle_connections_leave_room_for_a_stop(session):
    """Flooded, the server still hears the button, and the arm comes off the gel."""
    parts = urlsplit(session.address)
    session.wait_for("phase", phase="home")
    flood = [
        socket.create_connection((parts.hostname, parts.port)) for _ in range(CONNECTIONS_MAX + 100)
    ]
    try:
        headers = {"Origin": session.address.rsplit("/", 2)[0]}
        session.wait_for("phase", phase="press")
        status, body, _ = ask(session.address, "stop", method="POST", headers=headers)
        assert (status, json.loads(body)) == (200, {"asked": True})
        assert session.end().outcome is Outcome.ABORTED
    finally:
        for connection in flood:
            connection.close()
