"""Simulated presses of the calibration's ball, so that the skirt around it is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sim.effects.presets import RESOLUTIONS, build_model, mesh_for
from sim.fields.press_fields import surface_state
from sim.mesh.tet_mesh import TetMesh
from sim.optics.calibrate.presses.pressed_profile import PressedProfiles, radial_profile
from sim.optics.camera_geometry import CameraGeometry
from sim.optics.height.height_map import height_maps
from sim.scene.indenter import Sphere
from sim.scene.scene import Preset, Scene, Target
from sim.sensor.sensor import Sensor
from sim.solve.load_steps.path import LoadingPath

_PIXEL_M = 2e-5
_PIXELS = 400
# Slopes bend at the contact's edge, which lies elsewhere at every depth. With the presets' edges
# (0.25 and 0.17 of the contact's radius) the radius comes out up to a tenth off and the tilt by up
# to 0.12, with a contact distance of 5 um the gel is lifted by as much there; with these by 0.02.
_EDGE_SHARE = 0.06
_GROWTH = 1.5
_SECTORS = 16
_CONTACT_DISTANCE_M = 1e-6
_TOUCHING_M = 1.2e-6


def ball_profiles(
    sensor: Sensor,
    *,
    ball_diameter_m: float,
    depths_m: Sequence[float] = (2e-4, 3.5e-4, 5e-4, 7e-4, 9e-4, 1.2e-3),
    preset: Preset = Preset.FAST,
) -> PressedProfiles:
    """Press a ball into the middle of a sensor's pad and keep the gel's profile at each depth.

    Args:
        sensor: Pad and material; only the ratio of layers' moduli matters for the shape.
        ball_diameter_m: Diameter of the ball [m].
        depths_m: Rising depths [m].
        preset: Element, and mesh away from the ball.

    Raises:
        ConvergenceError: A depth finds no equilibrium.
    """
    scene = Scene(
        pad=sensor.pad,
        material=sensor.material,
        layers=sensor.layers,
        tetwild=sensor.tetwild,
        indenter=Sphere(diameter_m=ball_diameter_m),
        target=Target(depth_m=depths_m[-1]),
        preset=preset,
        barrier_m=_CONTACT_DISTANCE_M,
        sensor=sensor.name,
    )
    path = LoadingPath(build_model(scene, mesh=_mesh(scene)), scene.indenter, scene.centre_m)
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
        # The profile is a mean over all directions: circles drawn round would shift it, held-out
        # presses are then predicted 10 % worse.
        surface = replace(surface_state(path, path.advance(depth)), mesh_axis_m=None)
        maps = height_maps(surface, geometry, contact_gap_m=_TOUCHING_M, pad=sensor.pad)
        found.append(radial_profile(maps, geometry))
    return PressedProfiles(found)


def _mesh(scene: Scene) -> TetMesh:
    """Mesh finer than the preset does: of the ball's small contact every edge is looked at."""
    preset = RESOLUTIONS.get(scene.preset, RESOLUTIONS[Preset.FAST])
    resolution = replace(preset, smooth_share=_EDGE_SHARE, growth=_GROWTH, sector_count=_SECTORS)
    return mesh_for(scene, resolution=resolution)
