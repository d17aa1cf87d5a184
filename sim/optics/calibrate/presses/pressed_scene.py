"""The scene of a sensor's ball presses, with the gel as the simulator presses it."""

from __future__ import annotations

import numpy as np

from sim.optics.calibrate.presses.ball_profile import ball_profiles
from sim.optics.calibrate.presses.samples import PressScene
from sim.optics.camera_geometry import CameraGeometry, ImageArray
from sim.optics.colour.nominal import lamp_count_of
from sim.optics.height.rest_slope import rest_slopes
from sim.optics.markers.printed_markers import marker_mask
from sim.scene.scene import Preset
from sim.sensor.sensor import Sensor


def pressed_scene(
    sensor: Sensor,
    unloaded: ImageArray,
    geometry: CameraGeometry,
    *,
    ball_diameter_m: float,
    preset: Preset = Preset.FAST,
) -> PressScene:
    """Press the ball in the simulator, and put camera, no-contact frame and gel together.

    Args:
        sensor: Its pad is pressed, its lamps are counted, its markers left out.
        unloaded: No-contact frame, RGB, shape [height, width, 3].
        geometry: Scale of the pixels.
        ball_diameter_m: Diameter of the ball [m].
        preset: Of the simulated presses.

    Raises:
        ConvergenceError: The simulated ball press finds no equilibrium.
    """
    return PressScene(
        geometry=geometry,
        background=unloaded.astype(np.float64),
        masked=marker_mask(unloaded, sensor.markers, geometry),
        profile=ball_profiles(sensor, ball_diameter_m=ball_diameter_m, preset=preset),
        rest_slope=rest_slopes(sensor.pad, geometry),
        lamp_count=lamp_count_of(sensor),
    )
