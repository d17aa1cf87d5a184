"""Devices for the drivers' tests: emulated controllers and force sensors, an MJPEG stream."""

from __future__ import annotations

import http.server
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from drivers.emulators.arm.controller import ControllerSettings
from drivers.emulators.force_sensor.box import BoxSettings
from drivers.emulators.launch import free_loopback_host
from drivers.emulators.process import EmulatedProcess
from tacauchy_rig.core.config.model import RobotModel
from tacauchy_rig.core.run import Vector3


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedUr:
    """A running emulated controller."""

    host: str
    folder: Path
    model: RobotModel
    process: EmulatedProcess


EmulateUr = Callable[..., EmulatedUr]


@pytest.fixture
def emulate_ur(tmp_path: Path) -> Iterator[EmulateUr]:
    """Return a function that starts a controller; those it started end with the test."""
    started: list[EmulatedProcess] = []

    def start(model: RobotModel = RobotModel.E_SERIES, **more: Any) -> EmulatedUr:
        host = free_loopback_host()
        settings = ControllerSettings(folder=tmp_path, host=host, model=model, **more)
        process = EmulatedProcess("robot", "arm.controller", settings, folder=tmp_path)
        started.append(process)
        process.wait_ready()
        return EmulatedUr(host=host, folder=tmp_path, model=model, process=process)

    yield start
    for process in started:
        process.stop()


Frames = Callable[[threading.Event], Iterator[bytes]]
"""Makes the frames of one connection; the event is set when the test ends."""


@pytest.fixture(scope="session")
def run_box() -> Callable[..., AbstractContextManager[str]]:
    """Return what starts an emulated box in a folder and yields its port."""
    return _running_box


@contextmanager
def _running_box(folder: Path, *, load: Vector3 = (0.5, -0.25, 3.0), **more: Any) -> Iterator[str]:
    settings = BoxSettings(folder=folder, load=load, **more)
    process = EmulatedProcess("box", "force_sensor.box", settings, folder=folder)
    try:
        ready = process.wait_ready()
        (folder / "ready.json").write_text(json.dumps(ready))
        yield ready["port"]
    finally:
        process.stop()


@pytest.fixture(scope="session")
def serve_mjpeg() -> Callable[[Frames], AbstractContextManager[str]]:
    """Return what serves frames as multipart MJPEG and yields the address."""
    return _serving_mjpeg


@contextmanager
def _serving_mjpeg(frames: Frames) -> Iterator[str]:
    ended = threading.Event()

    class Handler(http.server.BaseHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            """Say nothing."""

        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            try:
                for data in frames(ended):
                    head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}"
                    self.wfile.write(head.encode() + b"\r\n\r\n" + data + b"\r\n")
            except OSError:
                return

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.05,))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/"
    finally:
        ended.set()
        server.shutdown()
        server.server_close()
        thread.join()
