"""Simulated presses of the calibration's ball, so that the skirt around it is known."""

from __future__ import annotations

from collections.abc import Sequence

from sim.fields import surface_state
from sim.indenter import Sphere
from sim.loading import LoadingPath
from sim.optics.geometry import CameraGeometry
from sim.optics.height_map import height_maps
from sim.optics.pressed_profile import PressedProfiles, radial_profile
from sim.presets import build_model
from sim.scene import Preset, Scene, Target
from sim.sensor import Sensor

_PIXEL_M = 2e-5
_PIXELS = 400


def ball_profiles(
    sensor: Sensor,
    *,
    ball_diameter_m: float,
    depths_m: Sequence[float] = (1e-4, 2e-4, 3.5e-4, 5e-4, 7e-4, 9e-4),
    preset: Preset = Preset.FAST,
) -> PressedProfiles:
    """Press a ball into the middle of a sensor's pad and keep the gel's profile at each depth.

    Args:
        sensor: Pad and material; only the ratio of layers' moduli matters for the shape.
        ball_diameter_m: Diameter of the ball [m].
        depths_m: Rising depths [m].
        preset: Mesh and element.

    Raises:
        ConvergenceError: A depth finds no equilibrium.
    """
    scene = Scene(
        pad=sensor.pad,
        material=sensor.material,
        layers=sensor.layers,
        filling=sensor.filling,
        indenter=Sphere(diameter_m=ball_diameter_m),
        target=Target(depth_m=depths_m[-1]),
        preset=preset,
        sensor=sensor.name,
    )
    path = LoadingPath(build_model(scene), scene.indenter, scene.centre_m)
    middle = 0.5 * (_PIXELS - 1)
    geometry = CameraGeometry(
        width=_PIXELS,
        height=_PIXELS,
        scale_x_m=_PIXEL_M,
        scale_y_m=_PIXEL_M,
        centre_x_px=middle,
        centre_y_px=middle,
    )
    found = []
    for depth in depths_m:
        surface = surface_state(path, path.advance(depth))
        found.append(radial_profile(height_maps(surface, geometry, pad=sensor.pad), geometry))
    return PressedProfiles(found)
