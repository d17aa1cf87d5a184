"""Which photometric model a replay renders with, and where it is from."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from drivers.emulators.plant.ball_presses import (
    BALL_DIAMETER_M,
    CIRCLES,
    NO_CONTACT,
    write_ball_presses,
)
from drivers.emulators.plant.truth import read_truth
from sim.optics.ball_press import read_ball_presses, read_rgb
from sim.optics.calibrate import calibrate_optics
from sim.optics.gel_profile import ExponentialSkirt
from sim.optics.geometry import CameraGeometry
from sim.optics.photometric import PhotometricModel, load_photometric
from sim.optics.press_scene import PressScene
from tacauchy_rig.cli.output import say
from tacauchy_rig.store.run_store import RunStore

SKIRT_DECAY_M = 1.5e-3


def photometric_model(store: RunStore, geometry: CameraGeometry) -> PhotometricModel:
    """Return the run's optical calibration.

    A configured calibration file wins. Without one, an emulated camera is calibrated the way a
    lab calibrates its sensor: from ball presses on the emulated gel, which know nothing of the
    six trials.

    Raises:
        ConfigError: The calibration file is missing or damaged.
    """
    given = store.config.sensor.optics_calibration
    if given:
        return load_photometric(Path(given))
    folder = store.paths.root / "calibration"
    kept = folder / "photometric.npz"
    if not kept.exists():
        say("calibrating the optics from ball presses on the emulated sensor")
        write_ball_presses(read_truth(store.paths.truth), folder)
        model = calibrate_folder(folder, geometry, ball_diameter_m=BALL_DIAMETER_M)
        model.save(kept)
    return load_photometric(kept)


def calibrate_folder(
    folder: Path, geometry: CameraGeometry, *, ball_diameter_m: float
) -> PhotometricModel:
    """Fit the photometric model to a folder of ball presses with ``circles.csv``."""
    background = read_rgb(folder / NO_CONTACT)
    scene = PressScene(
        geometry=geometry,
        background=background.astype(np.float64),
        profile=ExponentialSkirt(ball_radius_m=ball_diameter_m / 2, decay_m=SKIRT_DECAY_M),
    )
    presses = read_ball_presses(folder, folder / CIRCLES)
    model = calibrate_optics(presses, scene).model
    source = {"folder": folder.name, "ball_diameter_m": ball_diameter_m}
    return replace(model, provenance=json.loads(json.dumps({**model.provenance, **source})))
