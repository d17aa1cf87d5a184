"""``tacauchy-rig emulate``: emulated devices for a ``run`` elsewhere, and their faults."""

from __future__ import annotations

import signal
import tempfile
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drivers.emulators.faults import Device, parse_fault, written_faults
from tacauchy_rig.app.cli import output
from tacauchy_rig.core.errors import DeviceError

if TYPE_CHECKING:
    from drivers.emulators.launch import Emulation


def start(
    path: output.ConfigFile = None,
    *,
    devices: Annotated[list[Device] | None, typer.Option("--device")] = None,
    folder: Path | None = None,
    follow: str | None = None,
    overrides: output.Overrides = None,
    json_file: output.JsonFile = None,
) -> None:
    """Start emulated devices and serve until Ctrl-C.

    Example: tacauchy-rig emulate start rig.toml --device camera

    Args:
        devices: Device to emulate; all if absent.
        folder: Folder of sockets, traces and logs.
        follow: Robot whose reported pose moves the indenter.
    """
    from drivers.emulators.launch import Emulation
    from sim.sensor.sensor import load_sensor
    from tacauchy_rig.app.cli.emulated_calibration import emulated_unit
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
        robot, cell, camera = (getattr(emulation.running, device) for device in Device)
        places = {
            "robot_host": (Device.ROBOT, robot.host),
            "force_sensor_port": (Device.FORCE_SENSOR, cell.port),
            "camera_url": (Device.CAMERA, camera.device),
        }
        found = {name: at if device in chosen else None for name, (device, at) in places.items()}
        output.say(f"emulation folder  {place}")
        if Device.ROBOT in chosen:
            output.say(f'[robot]           driver = "ur5"     host = "{robot.host}"')
            output.say(f'                  model = "{robot.model}"')
        if Device.FORCE_SENSOR in chosen:
            output.say(f'[force_sensor]    driver = "m3733c"  port = "{cell.port}"')
        if Device.CAMERA in chosen:
            output.say(f'[camera]          driver = "uvc"     device = "{camera.device}"')
            output.say(f"                  width = {camera.width}  height = {camera.height}")
            output.say(f'                  rate = "{camera.rate:g} Hz"')
            for name, value in emulation.preloaded.items():
                output.say(f"for programs that open it: export {name}={value}")
        pids = {name: process.process.pid for name, process in emulation.processes.items()}
        output.write_json(json_file, {"folder": place, "addresses": found, "process_ids": pids})
        output.say("a whole rig.toml around these lines: docs/reference/devices.md")
        output.say("ready; Ctrl-C ends the emulated devices")
        _serve(emulation, stop)


def _serve(emulation: Emulation, stop: threading.Event) -> None:
    gone: set[str] = set()
    while not stop.wait(0.2):
        for name, process in emulation.processes.items():
            if name not in gone and process.process.poll() is not None:
                gone.add(name)
                output.say(f"emulated {name} ended with status {process.process.returncode}")
        if len(gone) == len(emulation.processes):
            raise DeviceError("every emulated device has ended", remedy="start them again")


def presses(
    *,
    out: Path,
    sensor: str = "gelsight-mini",
    count: Annotated[int, typer.Option(min=5)] = 40,
    seed: Annotated[int, typer.Option(min=0)] = 7,
    first: Annotated[int, typer.Option(min=1)] = 1,
    noise_free: bool = False,
) -> output.Found:
    """Write ball presses of an emulated sensor, to rehearse a calibration.

    Example: tacauchy-rig emulate presses --out presses --count 40

    Args:
        out (FOLDER): Folder of the images.
        sensor: Sensor by name or TOML file.
        count: Number of presses.
        seed: Seed of the emulated world.
        first: Number of the first press: 41 continues after 40.
        noise_free: Without noise and JPEG; prints what they would add.
    """
    from drivers.emulators.plant import ball_presses
    from drivers.emulators.plant.truth import draw_truth
    from sim.sensor.sensor import load_sensor
    from tacauchy_rig.app.cli.emulated_calibration import emulated_unit
    from tacauchy_rig.core.time_limit_and_progress import doing

    known = load_sensor(sensor)
    output.writable_folder(out)
    truth = draw_truth(seed, unit=emulated_unit(known))
    with doing("pressing balls into the emulated gel"):
        ball_presses.write_ball_presses(truth, out, count=count, first=first, noise_free=noise_free)
    x, y = known.camera.scale_x_m, known.camera.scale_y_m
    ball_mm = ball_presses.BALL_DIAMETER_M * 1e3
    output.say(f"{count} presses of a {ball_mm:.2f} mm ball on an emulated {known.title}")
    output.say(f"--ball-diameter {ball_mm:.2f}mm --scale {1e-3 / x:.2f},{1e-3 / y:.2f}px/mm")
    found = None
    if noise_free:
        found = ball_presses.frame_noise(truth, count=count, first=first)
        output.say(
            f"left out, inside the contacts: noise of {found.noise:.2f} grey levels on average, "
            f"{found.recorded:.2f} with the stream's JPEG"
        )
    output.say(f"folder {out}")
    return output.Found({"folder": out, "presses": count, "first": first, "left_out": found})


def fault(
    folder: Path,
    text: Annotated[
        str,
        typer.Argument(
            metavar="FAULT",
            help="device:kind=amount@start+duration, for example force_sensor:scale=0.1@1s+2s; "
            "all but device and kind may be left out, the amounts below are the usual ones. "
            + " ".join(f"{device}: {written_faults(device)}." for device in Device),
        ),
    ],
) -> output.Found:
    """Send a fault to a running emulated device.

    Example: tacauchy-rig emulate fault FOLDER force_sensor:scale=0.1@1s+2s

    Args:
        folder: The folder that `emulate start` printed.
    """
    from drivers.emulators.process import post_fault

    post_fault(folder, parse_fault(text))
    output.say(f"sent to {folder}: {text}")
    return output.Found({"folder": folder, "fault": text})
