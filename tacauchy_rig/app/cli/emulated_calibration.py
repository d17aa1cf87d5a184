"""The emulated sensor of a sensor's file, and its calibration from ball presses."""

import math
import os
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np

from drivers.emulators.plant.ball_presses import BALL_DIAMETER_M, write_ball_presses
from drivers.emulators.plant.truth import EmulatedUnit, GelDisc, GelLight, MarkerGrid, read_truth
from sim.scene.pad import BoxPad
from sim.sensor.sensor import Sensor
from tacauchy_rig.app.replay.chosen_optics import Calibrate, OpticalCalibration, calibrate_folder
from tacauchy_rig.app.replay.simulator_inputs import sensor_of
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.store.run_store import RunStore
from tacauchy_rig.core.time_limit_and_progress import heard, say

# A file's numbers are finite: a flat top is a dome of this radius, 0.1 um over 28 mm.
_FLAT_M = 1e3


def emulated_unit(sensor: Sensor, *, markers: bool = False) -> EmulatedUnit:
    """Return a unit of the sensor's sizes, with a disc of gel of the pad's area in its place.

    Only what a lab could read off the sensor goes across: what the emulated gel and its optics are
    really like is drawn from the seed, and what they look like is the emulator's own.

    Args:
        markers: Whether this unit has the markers that the file names.
    """
    if markers and sensor.markers is None:
        raise ConfigError(
            f"emulation.markers is true, but the file of {sensor.title} has no [markers]",
            remedy="leave emulation.markers out, or add [markers] to the sensor's file",
        )
    camera, optics, pad = sensor.camera, sensor.optics, sensor.pad
    half_x, half_y = pad.half_extents()
    middle, touched_pa = np.zeros(1), sensor.material.young_pa
    dome_radii_m, dome_radius_m = None, _FLAT_M
    if isinstance(pad, BoxPad):
        x_m, y_m = (min(each, _FLAT_M) for each in (pad.dome_radius_x_m, pad.dome_radius_y_m))
        dome_radii_m = x_m, y_m
        # Of the mean curvature, to the millimetre.
        dome_radius_m = round(2.0 / (1.0 / x_m + 1.0 / y_m), 3)
    dots = MarkerGrid(**asdict(sensor.markers)) if markers and sensor.markers else None
    return EmulatedUnit(
        name=sensor.name,
        pad_size_m=(2.0 * half_x, 2.0 * half_y),
        dome_radii_m=dome_radii_m,
        gel=GelDisc(
            radius_m=round(math.sqrt(4.0 * half_x * half_y / math.pi), 4),
            thickness_m=round(float(pad.height_at(middle, middle)[0]), 6),
            dome_radius_m=dome_radius_m,
            layers=tuple(
                (layer.share, layer.material.young_pa / touched_pa) for layer in sensor.layers
            ),
        ),
        young_pa=touched_pa,
        poisson=sensor.material.poisson,
        image_size=(camera.width, camera.height),
        pixel_m=(camera.scale_x_m, camera.scale_y_m),
        crop=camera.crop_fraction,
        light=GelLight.COLOURED if optics.renderer.sees_slope else GelLight.TRANSLUCENT,
        shadows=optics.shadows is not None,
        markers=dots,
    )


def begin_calibration(store: RunStore, worker: Executor, *, niceness: int = 0) -> Calibrate | None:
    """Begin to calibrate a run's emulated sensor in a worker process, and return what waits for it.

    Calibrating takes longer than all presses of a replay, and needs nothing that is recorded, only
    started emulated devices. None where a real sensor was pressed.
    """
    calibrate, config = emulated_calibration(store), store.config
    sensor = sensor_of(config)
    is_given = bool(config.sensor.optics_calibration)
    if calibrate is None or is_given or sensor.optics.renderer.exponents is None:
        return calibrate
    return partial(_awaited, worker.submit(_calibrated, niceness, calibrate, sensor), calibrate)


def _calibrated(
    niceness: int, calibrate: Calibrate, sensor: Sensor
) -> tuple[OpticalCalibration, list[str]]:
    """Return the calibration and its lines of progress."""
    os.nice(niceness)
    lines: list[str] = []
    with heard(lines.append):
        return calibrate(sensor), lines


def _awaited(
    begun: Future[tuple[OpticalCalibration, list[str]]], calibrate: Calibrate, sensor: Sensor
) -> OpticalCalibration:
    if not begun.done():
        say("waiting for the calibration of the emulated sensor's optics")
    try:
        found, lines = begun.result()
    except BrokenExecutor:
        say("the process that calibrated the optics was ended: calibrating again")
        return calibrate(sensor)
    for line in lines:
        say(line)
    return found


def emulated_calibration(store: RunStore) -> Calibrate | None:
    """Return how a run's emulated sensor is calibrated; None where a real sensor was pressed.

    It is done the way a lab calibrates its own, from ball presses on it. The presses know nothing
    of the trials; of the emulated world only its images are used.
    """
    if not store.paths.truth.exists():
        return None
    return partial(_calibrate, store.paths.truth, store.paths.root / "calibration")


def _calibrate(truth: Path, folder: Path, sensor: Sensor) -> OpticalCalibration:
    say("calibrating optics and scale from ball presses on the emulated sensor")
    write_ball_presses(read_truth(truth), folder)
    return calibrate_folder(folder, sensor, ball_diameter_m=BALL_DIAMETER_M)
