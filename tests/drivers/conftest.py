"""Devices for the drivers' tests: emulated controllers and force sensors, an MJPEG stream."""

import http.server
import json
import multiprocessing
import os
import runpy
import sys
import threading
import time
from collections.abc import Callable, Iterator, Set
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

import pytest

from drivers.emulators.launch import free_loopback_host
from drivers.emulators.plant.truth import draw_truth, write_truth
from drivers.emulators.process import END_TIMEOUT_S, DeviceSettings, command_line
from drivers.interfaces import StreamingDevice
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.settings import RigConfig, RobotModel
from tacauchy_rig.core.run import Vector3

SampleT = TypeVar("SampleT")
FORKED = multiprocessing.get_context("forkserver")
"""Of processes that begin as forks of one that has imported what they need, for a tenth."""
FORKED.set_forkserver_preload(
    [
        "tests.drivers.arm.test_ur5_motion_and_watchdog",
        "drivers.emulators.arm.controller",
        "drivers.emulators.force_sensor.m8128_box_and_noise",
        "protocols.processes.control_process",
        "protocols.processes.page.server",
        "tests.mock.streams",
    ]
)


def _be_emulator(ready: Connection, module: str, settings: DeviceSettings) -> None:
    with (settings.folder / "emulator.log").open("ab") as log:
        os.dup2(log.fileno(), 2)
    os.dup2(ready.fileno(), 1)
    sys.argv[1:] = command_line(module, replace(settings, parent_pid=os.getppid()))[3:]
    runpy.run_module(f"drivers.emulators.{module}", run_name="__main__")


class ForkedEmulator:
    """An ``EmulatedProcess`` that is forked."""

    def __init__(self, module: str, settings: DeviceSettings) -> None:
        self._said, ready = FORKED.Pipe(duplex=False)
        self.process = FORKED.Process(
            target=_be_emulator, args=(ready, module, settings), daemon=True
        )
        self.process.start()
        ready.close()

    def wait_ready(self) -> dict[str, Any]:
        """Return its ready line."""
        return dict(json.loads(os.read(self._said.fileno(), 65536)))

    def stop(self) -> None:
        """Ask it to end, and kill it if it does not."""
        self.process.terminate()
        self.process.join(END_TIMEOUT_S)
        self.process.kill()
        self._said.close()


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedUr:
    """A running emulated controller."""

    host: str
    folder: Path
    model: RobotModel
    process: ForkedEmulator


EmulateUr = Callable[..., EmulatedUr]


def changed(config: RigConfig, **sections: dict[str, Any]) -> RigConfig:
    """Return a configuration with some fields of some sections changed, unchecked."""
    parts = {name: getattr(config, name).model_copy(update=each) for name, each in sections.items()}
    return config.model_copy(update=parts)


def wait_until(condition: Callable[[], bool], *, give_up_s: float = 10.0) -> None:
    """Wait for a condition."""
    deadline = time.monotonic() + give_up_s
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def collect(
    device: StreamingDevice[SampleT], until: Callable[[list[SampleT]], bool]
) -> list[SampleT]:
    """Drain until the condition holds."""
    samples: list[SampleT] = []

    def holds() -> bool:
        samples.extend(device.drain())
        return until(samples)

    wait_until(holds)
    return samples


@pytest.fixture
def emulate_ur(tmp_path: Path) -> Iterator[EmulateUr]:
    """Return a function that starts a controller; those it started end with the test."""
    started: list[ForkedEmulator] = []

    def start(
        model: RobotModel = RobotModel.E_SERIES,
        *,
        quirks: Set[str] = frozenset(),
        seed: int = 0,
        **robot: Any,
    ) -> EmulatedUr:
        """Start one; it feels no gel where it begins unless ``home`` is given."""
        host = free_loopback_host()
        parts = {"model": model, "home": (0.3, -0.3, 0.2), **robot}
        config = changed(load_config().config, robot=parts, emulation={"seed": seed})
        write_truth(tmp_path, draw_truth(seed))
        settings = DeviceSettings(
            folder=tmp_path, config=config, host=host, quirks=frozenset(quirks)
        )
        process = ForkedEmulator("arm.controller", settings)
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
def _running_box(
    folder: Path,
    *,
    load: Vector3 = (0.5, -0.25, 3.0),
    noise_n: float = 0.002,
    capacity: float = 50.0,
    quirks: Set[str] = frozenset(),
) -> Iterator[str]:
    truth = replace(
        draw_truth(0),
        force_offset_n=load,
        force_noise_n=noise_n,
        torque_noise_nm=0.01 * noise_n,
        force_drift_n_s=0.0,
        cross_talk=(0.0, 0.0),
        force_latency_s=0.0,
    )
    write_truth(folder, truth)
    config = changed(load_config().config, force_sensor={"capacity": capacity})
    settings = DeviceSettings(folder=folder, config=config, quirks=frozenset(quirks))
    process = ForkedEmulator("force_sensor.m8128_box_and_noise", settings)
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
