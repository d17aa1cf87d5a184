"""A viewer that speaks Foxglove's protocol sees an emulated run, and can do nothing to it."""

import json
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import foxglove
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from protocols.processes.ipc import Shown
from protocols.trials.trial_sequence import PlannedTrial
from tacauchy_rig.app.viewers.foxglove_publisher import AXES, IMAGES, Topics
from tacauchy_rig.core.image_codec import encode_jpeg
from tacauchy_rig.core.run import JournalEvent

SUBPROTOCOL = "foxglove.sdk.v1"
JPEG = encode_jpeg(np.full((8, 8, 3), 90, np.uint8), quality=90)
PLAN = [PlannedTrial(index=1, force_target_n=1.26)]


@contextmanager
def watched() -> Iterator[tuple[Topics, ClientConnection]]:
    """Publish into a context of its own; a client is connected meanwhile."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    context = foxglove.Context()
    server = foxglove.start_server(
        host="127.0.0.1", port=port, capabilities=[], services=[], context=context
    )
    try:
        topics = Topics(PLAN, context)
        with connect(f"ws://127.0.0.1:{port}", subprotocols=[SUBPROTOCOL]) as client:
            yield topics, client
    finally:
        server.stop()


def told(client: ClientConnection, *, until: str) -> list[dict[str, Any]]:
    """Return what a client is told in JSON until a word comes."""
    found: list[dict[str, Any]] = []
    while not found or found[-1].get("op") != until:
        message = client.recv(timeout=10)
        if isinstance(message, str):
            found.append(json.loads(message))
    return found


def publish(topics: Topics, stamp_ns: int) -> None:
    """Show one of everything."""
    topics.note(
        JournalEvent(stamp_ns=1, name="phase", trial=1, attempt=1, detail={"phase": "press"})
    )
    force = {"stamp_ns": [stamp_ns], "force_n": [1.2], "wrench": [0.1, 0.2, -1.2, 0.0, 0.0, 0.0]}
    arm = {"position_m": (0.1, 0.2, 0.3), "rotation_rad": (0.0, np.pi, 0.0)}
    twin = {"force_n": 1.21, "force_error_n": None, "depth_mm": 0.2, "note": "late"}
    topics.show(Shown(stream="force", stamp_ns=stamp_ns, numbers=force))
    topics.show(Shown(stream="arm", stamp_ns=stamp_ns, numbers=arm))
    topics.show(Shown(stream="camera", stamp_ns=stamp_ns, numbers={}, picture=JPEG))
    topics.show(Shown(stream="twin", stamp_ns=stamp_ns, numbers=twin, picture=JPEG))


def test_a_viewer_gets_numbers_pictures_and_poses_at_their_times() -> None:
    """Every topic has a schema; what comes is what was shown, by the wall clock."""
    with watched() as (topics, client):
        info = told(client, until="serverInfo")[-1]
        assert info["capabilities"] == []
        channels: dict[str, dict[str, Any]] = {}
        while len(channels) < 5 + len(IMAGES):
            for each in told(client, until="advertise")[-1]["channels"]:
                channels[each["topic"]] = each
        assert all(each["schema"] for each in channels.values())
        assert channels["/camera/image"]["schemaName"] == "foxglove.CompressedImage"
        assert channels["/arm/tip"]["schemaName"] == "foxglove.PoseInFrame"
        names = dict(enumerate(sorted(channels), 1))
        asked = [{"id": k, "channelId": channels[topic]["id"]} for k, topic in names.items()]
        client.send(json.dumps({"op": "subscribe", "subscriptions": asked}))
        time.sleep(0.2)
        now_ns, stamp_ns = time.time_ns(), time.monotonic_ns()
        publish(topics, stamp_ns)
        found: dict[str, tuple[int, bytes]] = {}
        wanted = {"/force", "/wrench", "/run", "/arm/tip", "/camera/image", "/twin", "/twin/image"}
        while set(found) != wanted:
            message = client.recv(timeout=10)
            if isinstance(message, bytes) and message[0] == 1:
                key, at_ns = struct.unpack_from("<IQ", message, 1)
                found[names[key]] = at_ns, message[13:]
    assert json.loads(found["/force"][1]) == {"pressing_n": 1.2, "target_n": 1.26}
    assert list(json.loads(found["/wrench"][1])) == list(AXES)
    assert json.loads(found["/run"][1])["phase"] == "press"
    assert "note" not in json.loads(found["/twin"][1])
    assert JPEG in found["/camera/image"][1]
    assert b"jpeg" in found["/camera/image"][1]
    assert abs(found["/force"][0] - now_ns) < 10**9


@pytest.mark.parametrize(
    "message",
    [
        {"op": "advertise", "channels": [{"id": 1, "topic": "/stop", "encoding": "json"}]},
        {"op": "setParameters", "parameters": [{"name": "speed", "value": 1}]},
        {"op": "getParameters", "parameterNames": []},
        {"op": "subscribeConnectionGraph"},
        {"op": "fetchAsset", "uri": "file:///etc/passwd", "requestId": 1},
    ],
)
def test_a_viewer_can_neither_say_nor_set_nor_fetch(message: dict[str, Any]) -> None:
    """What it asks for is refused or overheard; publishing goes on."""
    with watched() as (topics, client):
        told(client, until="serverInfo")
        client.send(json.dumps(message))
        publish(topics, time.monotonic_ns())
        answers = []
        try:
            while True:
                answer = client.recv(timeout=0.5)
                answers.append(answer if isinstance(answer, bytes) else answer.encode())
        except (TimeoutError, ConnectionClosed):
            pass
        assert not any(b"root:" in answer or b"parameterValues" in answer for answer in answers)
        publish(topics, time.monotonic_ns())
