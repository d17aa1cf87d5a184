"""Five objects pressed into a sensor, and what its camera would see."""

from __future__ import annotations

import time
from dataclasses import dataclass

from sim.effects.plan import plan_effects
from sim.effects.scene_path import follow, path_for
from sim.fields.press_fields import surface_state
from sim.optics.height.height_map import HeightMaps, height_maps
from sim.optics.render.nominal import nominal_renderer
from sim.scene.indenter import MeshIndenter
from sim.scene.scene import Preset, Target
from sim.scene.triangle_surface import TriangleSurface
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.sensor import Sensor
from sim.solve.equilibrium import SolverOptions
from sim.studies.objects.shapes import OBJECTS
from tacauchy_rig.core.arrays import ImageArray

DEPTH_M = 0.4e-3
_GREY = 118
_SAMPLES = 2
# Where faces meet in a hollow edge the gel's balance has a kink, and Newton comes no further than
# 2e-6 of the contact force.
_RESIDUAL_RELATIVE = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectPress:
    """One object in one sensor.

    Attributes:
        name: Of the object.
        sensor: Title of the sensor.
        force_n: F_z [N].
        maps: Heights of the gel by pixel.
        surface: The object's triangles [m].
        image: What the camera sees, by the sensor's nominal optics over an even frame, RGB.
        geometry: Pixels.
        highest_over_m: Largest height of a pixel above the object [m]; not positive.
        processor_s: Processor's time for the press and its image [s].
    """

    name: str
    sensor: str
    force_n: float
    maps: HeightMaps
    surface: TriangleSurface
    image: ImageArray
    geometry: CameraGeometry
    highest_over_m: float
    processor_s: float


def press_object(name: str, sensor: Sensor, *, preset: Preset) -> ObjectPress:
    """Press an object 0.4 mm deep and render it.

    Raises:
        ConvergenceError: The press finds no equilibrium.
    """
    render = nominal_renderer(sensor, level=_GREY, samples=_SAMPLES)
    geometry = sensor.camera
    started = time.process_time()
    body: MeshIndenter = OBJECTS[name]()
    scene = sensor.scene(body, Target(depth_m=DEPTH_M), preset=preset)
    path = path_for(scene, plan_effects(scene))
    path.options = SolverOptions(residual_relative=_RESIDUAL_RELATIVE)
    point = follow(scene, path)
    surface = surface_state(path, point)
    maps = height_maps(surface, geometry, pad=sensor.pad)
    fine = height_maps(surface, geometry.refined(_SAMPLES), pad=sensor.pad)
    underside = body.lower_surface(*geometry.pad_grid())
    return ObjectPress(
        name=name,
        sensor=sensor.title,
        force_n=float(point.force_n[2]),
        maps=maps,
        surface=body.surface,
        image=render(fine),
        geometry=geometry,
        highest_over_m=float((maps.loaded - surface.indenter_position[2] - underside).max()),
        processor_s=time.process_time() - started,
    )
