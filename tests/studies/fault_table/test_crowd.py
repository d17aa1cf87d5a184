"""Visitors who besiege a page."""

from __future__ import annotations

import socket
from contextlib import closing

import pytest

from tests.studies.fault_table.crowd import CONNECTIONS, SLOW_CLIENTS, Crowd, Visitors


@pytest.mark.parametrize(
    ("crowd", "count"), [(Crowd.FLOOD, CONNECTIONS), (Crowd.SLOW_CLIENT, SLOW_CLIENTS)]
)
def test_so_many_come_and_go_when_they_are_told(crowd, count):
    """Half of them ask for events; closed, all are gone."""
    with socket.create_server(("127.0.0.1", 0), backlog=count) as server:
        host, port = server.getsockname()
        with closing(Visitors(f"http://{host}:{port}/token/").come(crowd)):
            taken = [server.accept()[0] for _ in range(count)]
        said = [each.recv(1 << 16) for each in taken]
        for each in taken:
            each.close()
    events = [text for text in said if text.startswith(b"GET /token/events HTTP/1.1\r\nHost: 127")]
    assert len(events) == count // 2
