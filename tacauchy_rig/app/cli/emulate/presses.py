"""``tacauchy-rig emulate presses``: ball presses to rehearse a calibration with."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tacauchy_rig.app.cli.options import JsonFile
from tacauchy_rig.app.cli.output import say, writable_folder, write_json


def presses(
    out: Annotated[Path, typer.Option("--out", metavar="FOLDER", help="Where the images go.")],
    sensor: Annotated[str, typer.Option("--sensor", help="Name or file.")] = "gelsight-mini",
    count: Annotated[int, typer.Option("--count", min=5, help="How many presses.")] = 40,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Draws the emulated world.")] = 7,
    first: Annotated[
        int, typer.Option("--first", min=1, help="Number of the first press: 41 is unseen by 40.")
    ] = 1,
    noise_free: Annotated[
        bool, typer.Option("--noise-free", help="Without noise and JPEG, and say what they are.")
    ] = False,
    json_file: JsonFile = None,
) -> None:
    """Write the ball presses of an emulated sensor, to rehearse its calibration with.

    Example: tacauchy-rig emulate presses --out presses --count 40
    """
    from drivers.emulators.plant.ball_presses import (
        BALL_DIAMETER_M,
        frame_noise,
        write_ball_presses,
    )
    from drivers.emulators.plant.truth import draw_truth
    from sim.sensor.sensor import load_sensor
    from tacauchy_rig.app.cli.emulation import emulated_unit

    known = load_sensor(sensor)
    writable_folder(out)
    truth = draw_truth(seed, unit=emulated_unit(known))
    write_ball_presses(truth, out, count=count, first=first, noise_free=noise_free)
    x, y = known.camera.scale_x_m, known.camera.scale_y_m
    say(f"{count} presses of a {BALL_DIAMETER_M * 1e3:.2f} mm ball on an emulated {known.title}")
    say(f"--ball-diameter {BALL_DIAMETER_M * 1e3:.2f}mm --scale {1e-3 / x:.2f},{1e-3 / y:.2f}px/mm")
    found = None
    if noise_free:
        found = frame_noise(truth, count=count, first=first)
        say(
            f"left out, inside the contacts: noise of {found.noise:.2f} grey levels on average, "
            f"{found.recorded:.2f} with the stream's JPEG"
        )
    say(f"folder {out}")
    write_json(json_file, {"folder": out, "presses": count, "first": first, "left_out": found})
