"""``tacauchy-rig emulate start``."""

from __future__ import annotations

import signal
import tempfile
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drivers.emulators.faults import Device
from tacauchy_rig.app.cli.options import ConfigFile, JsonFile, Overrides
from tacauchy_rig.app.cli.output import say, write_json
from tacauchy_rig.core.errors import DeviceError

if TYPE_CHECKING:
    from drivers.emulators.launch import Emulation


def start(
    path: ConfigFile = None,
    devices: Annotated[
        list[Device] | None,
        typer.Option("--device", help="Which to emulate; all of them if absent."),
    ] = None,
    folder: Annotated[
        Path | None, typer.Option("--folder", help="Where sockets, traces and logs go.")
    ] = None,
    follow: Annotated[
        str | None, typer.Option("--follow", help="Robot whose reported pose moves the indenter.")
    ] = None,
    overrides: Overrides = None,
    json_file: JsonFile = None,
) -> None:
    """Start emulated devices and serve until Ctrl-C.

    Example: tacauchy-rig emulate start rig.toml --device camera
    """
    from drivers.emulators.launch import Emulation
    from sim.sensor.sensor import load_sensor
    from tacauchy_rig.app.cli.emulation import emulated_unit
    from tacauchy_rig.core.config.load import load_config

    config = load_config(path, overrides=overrides or ()).config
    chosen = frozenset(devices or Device)
    place = folder or Path(tempfile.mkdtemp(prefix="tacauchy-rig-"))
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, lambda *_: stop.set())
    unit = emulated_unit(load_sensor(config.sensor.name), markers=config.emulation.markers)
    with Emulation(
        config, folder=place, devices=chosen, follow_host=follow, unit=unit
    ) as emulation:
        found = emulation.addresses
        say(f"emulation folder  {place}")
        if found.robot_host:
            say(f'[robot]           driver = "ur5"     host = "{found.robot_host}"')
            say(f'                  model = "{config.robot.model}"')
        if found.force_sensor_port:
            say(f'[force_sensor]    driver = "m3733c"  port = "{found.force_sensor_port}"')
        if found.camera_url:
            camera = config.camera
            say(f'[camera]          driver = "uvc"     device = "{found.camera_url}"')
            say(f"                  width = {camera.width}  height = {camera.height}")
            say(f'                  rate = "{camera.rate:g} Hz"')
        pids = {name: process.process.pid for name, process in emulation.processes.items()}
        write_json(json_file, {"folder": place, "addresses": found, "process_ids": pids})
        say("a whole rig.toml around these lines: docs/reference/devices.md")
        say("ready; Ctrl-C ends the emulated devices")
        _serve(emulation, stop)


def _serve(emulation: Emulation, stop: threading.Event) -> None:
    gone: set[str] = set()
    while not stop.wait(0.2):
        for name, process in emulation.processes.items():
            if name not in gone and process.process.poll() is not None:
                gone.add(name)
                say(f"emulated {name} ended with status {process.process.returncode}")
        if len(gone) == len(emulation.processes):
            raise DeviceError("every emulated device has ended", remedy="start them again")
