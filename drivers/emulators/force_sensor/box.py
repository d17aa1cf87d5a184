"""An emulated M8128-family box as a process: ``python -m drivers.emulators.force_sensor.box``.

It prints one JSON line with the path of its port when that can be opened, and continues
``force_trace.jsonl``: for each frame its number, moment, true force and true depth.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import signal
import sys
import time
from pathlib import Path
from types import FrameType

from drivers.emulators.faults import Device, FaultInbox
from drivers.emulators.force_sensor.loop import EmulatedBox
from drivers.emulators.force_sensor.port import PseudoPort
from drivers.emulators.force_sensor.protocol import BoxCommands, ReplyStyle
from drivers.emulators.force_sensor.source import ConstantSource, PlantSource, WrenchSource
from drivers.emulators.force_sensor.stream import FrameStream
from drivers.emulators.force_sensor.trace import TRACE_FILE, open_trace
from drivers.emulators.plant.arguments import add_plant_arguments, plant_from_arguments
from drivers.emulators.plant.force_channel import ForceChannel
from drivers.emulators.plant.gel.gel import Plant
from drivers.emulators.punctuality import keep_time
from drivers.emulators.shared_world import SharedWorld
from tacauchy_rig.errors import RigError

LINK_NAME = "force_sensor.port"


def main(arguments: list[str] | None = None) -> int:
    """Run the emulator as a process; prints one JSON line when the port can be opened."""
    options = _parse(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
    options.folder.mkdir(parents=True, exist_ok=True)
    try:
        _serve(options)
    except RigError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


def _serve(options: argparse.Namespace) -> None:
    folder: Path = options.folder
    source = _constant_source(options)
    latency_s = 0.0
    if options.world is not None:
        plant = plant_from_arguments(options)
        source, latency_s = _plant_source(options, plant), plant.truth.force_latency_s
    inbox = FaultInbox(folder, Device.FORCE_SENSOR)
    port = PseudoPort(folder / LINK_NAME)
    with open_trace(folder / TRACE_FILE) as trace:
        box = EmulatedBox(
            port,
            inbox,
            commands=BoxCommands(
                rate_hz=options.rate,
                rate_command=options.rate_command,
                style=ReplyStyle(options.replies),
            ),
            stream=FrameStream(
                seed=options.seed, full_scale_n=options.full_scale_n, latency_s=latency_s
            ),
            source=source,
            trace=trace,
            parent_pid=options.parent_pid,
        )
        _stop_on_signals(box)
        ready = {"device": "force_sensor", "port": port.path, "link": str(folder / LINK_NAME)}
        print(json.dumps({**ready, "pid": os.getpid()}), flush=True)
        keep_time(mostly_sleeps=True)
        box.run()
        port.close()
        inbox.close()


def _stop_on_signals(box: EmulatedBox) -> None:
    def stop(_number: int, _frame: FrameType | None) -> None:
        box.stopping = True

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)


def _constant_source(options: argparse.Namespace) -> WrenchSource:
    v = [float(part) for part in options.load.split(",")]
    return ConstantSource(
        (v[0], v[1], v[2], v[3], v[4], v[5]), noise_n=options.noise_n, seed=options.seed
    )


def _plant_source(options: argparse.Namespace, plant: Plant) -> WrenchSource:
    channel = ForceChannel(plant.truth, start_ns=time.monotonic_ns())
    return PlantSource(plant, channel, SharedWorld.create(options.world))


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="m8128_box", description=__doc__)
    add_plant_arguments(parser)
    add = parser.add_argument
    add("--folder", type=Path, required=True, help="where control socket, trace and link go")
    add("--world", type=Path, help="shared world file; without it the load is constant")
    add("--rate", type=int, default=100, help="frames per second until a client sets another")
    add("--full-scale-n", type=float, default=50.0, help="what Fz reads when saturated [N]")
    add("--rate-command", choices=["SMPF", "SMPR"], default="SMPF")
    add("--replies", choices=[style.value for style in ReplyStyle], default="dollar-ok")
    add("--load", default="0,0,0,0,0,0", help="constant load [N, N m]")
    add("--noise-n", type=float, default=0.002, help="noise of the constant load [N]")
    add("--parent-pid", type=int, help="end when this parent process ends")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
