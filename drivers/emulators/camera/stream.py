"""An emulated camera: a process that serves an HTTP multipart JPEG stream of the plant.

``python -m drivers.emulators.camera.stream --folder DIR --width 640 --height 480 --rate 25``
prints one JSON line with its URL. Frames are captured on absolute deadlines and leave the camera's
latency later; their numbers are drawn in (``camera_stamp``), and ``camera_trace.jsonl`` holds
what each one shows.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import random
import signal
import sys
import threading
import time
from collections import deque
from pathlib import Path
from typing import TextIO

import cv2

from drivers.device.faults import Device, Fault, FaultKind
from drivers.emulators.camera.frames import (
    DEPTH_STEP_M,
    LIGHT_STEP,
    PLACE_STEP_M,
    FrameFactory,
    PressKey,
)
from drivers.emulators.camera.http import MjpegServer
from drivers.emulators.camera.jpeg import DEFAULT_QUALITY
from drivers.emulators.faults import FaultInbox, FaultSchedule
from drivers.emulators.plant.arguments import add_plant_arguments, plant_from_arguments
from drivers.emulators.process import keep_time
from drivers.emulators.shared_world import WORLD_FILE, SharedWorld, WorldState
from tacauchy_rig.errors import DeviceError, RigError


class BackgroundRenderer:
    """One thread that always works on the newest wish."""

    def __init__(self, factory: FrameFactory) -> None:
        self._factory = factory
        self._changed = threading.Condition()
        self._wanted: PressKey | None = None
        self._asked_count = 0
        self._done_count = 0
        self._open = True
        self._thread = threading.Thread(target=self._work, name="renderer", daemon=True)
        self._thread.start()

    def ask(self, key: PressKey, *, timeout_s: float) -> bool:
        """Ask for ``key`` and wait for it at most ``timeout_s`` [s]; False when it is not ready."""
        with self._changed:
            self._wanted = key
            self._asked_count += 1
            mine = self._asked_count
            self._changed.notify_all()
            return self._changed.wait_for(lambda: self._done_count >= mine, max(0.0, timeout_s))

    def close(self) -> None:
        """End the thread."""
        with self._changed:
            self._open = False
            self._changed.notify_all()
        self._thread.join()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._wanted is not None or not self._open)
                if not self._open:
                    return
                key, self._wanted = self._wanted, None
                count = self._asked_count
            if key is not None:
                self._factory.prepare(key)
            with self._changed:
                self._done_count = count
                self._changed.notify_all()


_DROP_SHARE = 0.3
_GARBLE_SHARE = 0.3
_DELAY_S = 0.5
_GARBLED_BYTES = 64


class FaultyOutput:
    """Turns the frame that should go out into the frames that do."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)  # noqa: S311 - damage, not a secret
        self._frozen: bytes | None = None
        self._late: deque[tuple[float, bytes]] = deque()

    def frames(self, jpeg: bytes, faults: list[Fault], *, now_s: float) -> list[bytes]:
        """Return what to send at ``now_s`` [s] in place of ``jpeg``, oldest first."""
        active = {fault.kind: fault for fault in faults}
        if FaultKind.FREEZE in active:
            self._frozen = jpeg = self._frozen or jpeg
        else:
            self._frozen = None
        if FaultKind.STALL in active or self._strikes(active.get(FaultKind.DROP), _DROP_SHARE):
            return []
        if self._strikes(active.get(FaultKind.GARBLE), _GARBLE_SHARE):
            jpeg = self._garbled(jpeg)
        delay = active.get(FaultKind.DELAY)
        delay_s = 0.0 if delay is None else delay.parameters.get("delay_s", _DELAY_S)
        due_s = max(now_s + delay_s, self._late[-1][0] if self._late else 0.0)
        self._late.append((due_s, jpeg))
        return [self._late.popleft()[1] for _ in range(sum(d <= now_s for d, _ in self._late))]

    def _strikes(self, fault: Fault | None, share: float) -> bool:
        return fault is not None and self._random.random() < fault.parameters.get("fraction", share)

    def _garbled(self, jpeg: bytes) -> bytes:
        """Overwrite bytes and cut the end off, as a bad cable does."""
        damaged = bytearray(jpeg[: self._random.randrange(len(jpeg) // 2, len(jpeg))])
        for _ in range(_GARBLED_BYTES):
            damaged[self._random.randrange(len(damaged) // 4, len(damaged))] ^= 0x5A
        return bytes(damaged)


TRACE_FILE = "camera_trace.jsonl"
_COMPOSING_S = 0.006  # left before a frame is due
_LATENCY_LIMIT = 0.8  # of a frame's period
_FLUSH_FRAMES = 25
_LATE_PERIODS = 4  # this far behind, the schedule is moved instead of caught up with

_logger = logging.getLogger(__name__)


class EmulatedCamera:
    """One camera: its schedule, its faults and its readers."""

    def __init__(
        self, arguments: argparse.Namespace, factory: FrameFactory, server: MjpegServer
    ) -> None:
        self._factory = factory
        self._server: MjpegServer | None = server
        self._world_path: Path = arguments.world or arguments.folder / WORLD_FILE
        self._world: SharedWorld | None = None
        self._inbox = FaultInbox(arguments.folder, Device.CAMERA)
        self._schedule = FaultSchedule()
        self._parent_pid: int | None = arguments.parent_pid
        self._output = FaultyOutput(arguments.seed)
        self._renderer = BackgroundRenderer(factory)
        self._period_s = 1.0 / arguments.rate
        truth = factory.plant.truth
        self.latency_s = min(truth.camera_latency_s, _LATENCY_LIMIT * self._period_s)
        self._trace: TextIO = (arguments.folder / TRACE_FILE).open("w")
        self._shown = PressKey(depth=0, x=0, y=0, light=0)
        self.start_ns = time.monotonic_ns() + 50_000_000

    def run(self, stop: threading.Event) -> None:
        """Send frames until ``stop`` is set."""
        number = 0
        moved_s = 0.0
        while not stop.is_set() and self._parent_pid in (None, os.getppid()):
            capture_s = self.start_ns * 1e-9 + moved_s + number * self._period_s
            behind_s = time.monotonic() - capture_s
            if behind_s > _LATE_PERIODS * self._period_s:
                moved_s += behind_s
                _logger.warning("%.0f ms behind: the schedule is moved", behind_s * 1e3)
                continue
            if behind_s < 0.0 and stop.wait(-behind_s):
                break
            self._frame(number, capture_s, stop)
            number += 1
        self._close()

    def _frame(self, number: int, capture_s: float, stop: threading.Event) -> None:
        wanted, depth_m = self._look(capture_s)
        due_s = capture_s + self.latency_s
        self._renderer.ask(wanted, timeout_s=due_s - _COMPOSING_S - time.monotonic())
        if self._factory.is_ready(wanted):
            self._shown = wanted
        faults = self._active_faults()
        if any(fault.kind is FaultKind.SATURATE for fault in faults):
            jpeg = self._factory.compose_overexposed(number)
        else:
            jpeg = self._factory.compose(self._shown, number)
        stop.wait(max(0.0, due_s - time.monotonic()))
        if self._server is not None:
            for frame in self._output.frames(jpeg, faults, now_s=time.monotonic()):
                self._server.publish(frame)
        self._write_trace(number, capture_s, depth_m)
        self._factory.renew()

    def _look(self, capture_s: float) -> tuple[PressKey, float]:
        """Return what to show and how deep the tip really is [m]; the gel if no arm is known."""
        plant = self._factory.plant
        elapsed_s = capture_s - self.start_ns * 1e-9
        light = round((plant.light_gain(elapsed_s) - 1.0) / LIGHT_STEP)
        state = self._read_world()
        if state is None or state.sequence == 0:
            return PressKey(depth=0, x=0, y=0, light=light), 0.0
        depth_m = max(0.0, plant.depth(state.pose))
        x, y = plant.centre(state.pose)
        key = PressKey(
            depth=round(depth_m / DEPTH_STEP_M),
            x=round(x / PLACE_STEP_M),
            y=round(y / PLACE_STEP_M),
            light=light,
        )
        return key, depth_m

    def _read_world(self) -> WorldState | None:
        """Return the arm's state, or None until another process has created the world."""
        if self._world is None:
            if not self._world_path.exists():
                return None
            self._world = SharedWorld.open(self._world_path)
        return self._world.read()

    def _active_faults(self) -> list[Fault]:
        now_s = time.monotonic()
        for fault in self._inbox.poll():
            _logger.info("fault: %s for %g s", fault.kind.value, fault.duration_s)
            self._schedule.add(fault, now_s=now_s)
        faults = self._schedule.active(now_s)
        if self._server is not None and any(f.kind is FaultKind.UNPLUG for f in faults):
            self._server.close()
            self._server = None  # a plug does not put itself back in
        return faults

    def _write_trace(self, number: int, capture_s: float, depth_m: float) -> None:
        line = {
            "number": number,
            "capture_ns": round(capture_s * 1e9),
            "depth_true_m": depth_m,
            "depth_shown_m": self._shown.depth * DEPTH_STEP_M,
        }
        self._trace.write(json.dumps(line) + "\n")
        if number % _FLUSH_FRAMES == 0:
            self._trace.flush()

    def _close(self) -> None:
        self._renderer.close()
        self._inbox.close()
        self._trace.close()
        if self._server is not None:
            self._server.close()


def parse_arguments(argv: list[str]) -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(prog="camera_stream", description=__doc__)
    add = parser.add_argument
    add("--host", default="127.0.0.1")
    add("--port", type=int, default=0, help="0 takes a free one")
    add("--folder", type=Path, required=True, help="for the trace and the control socket")
    add("--world", type=Path, help="file with the arm's pose; in the folder by default")
    add("--width", type=int, default=640)
    add("--height", type=int, default=480)
    add("--rate", type=float, default=25.0, help="frames per second")
    add("--quality", type=int, default=DEFAULT_QUALITY, help="of the JPEG")
    add("--markers", action="store_true", help="the gel has printed dots")
    add("--parent-pid", type=int, help="end when this parent process ends")
    add_plant_arguments(parser)
    return parser.parse_args(argv)


def main(argv: list[str] | None = None) -> int:
    """Run the emulated camera until SIGTERM or SIGINT."""
    arguments = parse_arguments(sys.argv[1:] if argv is None else argv)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    cv2.setNumThreads(1)
    stop = threading.Event()
    for signum in (signal.SIGTERM, signal.SIGINT):
        signal.signal(signum, lambda *_: stop.set())
    try:
        arguments.folder.mkdir(parents=True, exist_ok=True)
        factory = FrameFactory(
            plant_from_arguments(arguments),
            arguments.width,
            arguments.height,
            quality=arguments.quality,
            markers=arguments.markers,
        )
        keep_time(mostly_sleeps=False)
        server = _serve(arguments.host, arguments.port)
        camera = EmulatedCamera(arguments, factory, server)
    except RigError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    ready = {
        "device": Device.CAMERA.value,
        "url": server.url,
        "pid": os.getpid(),
        "width": arguments.width,
        "height": arguments.height,
        "rate_hz": arguments.rate,
        "first_capture_ns": camera.start_ns,
        "latency_s": camera.latency_s,
    }
    print(json.dumps(ready), flush=True)
    camera.run(stop)
    return 0


def _serve(host: str, port: int) -> MjpegServer:
    try:
        return MjpegServer(host, port)
    except OSError as error:
        raise DeviceError(
            f"emulated camera: {host}:{port} cannot be listened on ({error.strerror})",
            remedy="give another --port, or 0 for a free one",
        ) from error


if __name__ == "__main__":
    sys.exit(main())
