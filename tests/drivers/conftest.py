"""Devices for the drivers' tests: emulated controllers and force sensors, an MJPEG stream."""

from __future__ import annotations

import http.server
import json
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from drivers.emulators.launch import free_loopback_host
from drivers.emulators.process import EmulatedProcess
from tacauchy_rig.core.config.model import RobotModel


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

    def start(model: RobotModel = RobotModel.E_SERIES, *more: str) -> EmulatedUr:
        host = free_loopback_host()
        arguments = ["drivers.emulators.arm.controller", "--host", host, "--model", model.value]
        process = EmulatedProcess(
            "robot", [*arguments, "--folder", str(tmp_path), *more], folder=tmp_path
        )
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
def _running_box(folder: Path, *extra: str, load: str = "0.5,-0.25,3,0,0,0") -> Iterator[str]:
    command = [sys.executable, "-m", "drivers.emulators.force_sensor.box"]
    command += ["--folder", str(folder), "--load", load, *extra]
    with (folder / "box.log").open("wb") as log:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log)
        try:
            assert process.stdout is not None
            ready = process.stdout.readline()
            (folder / "ready.json").write_bytes(ready)
            yield json.loads(ready)["port"]
        finally:
            process.terminate()
            process.wait(5)
            if process.stdout is not None:
                process.stdout.close()


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
