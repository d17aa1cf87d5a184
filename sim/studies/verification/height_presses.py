"""What is pressed for the height maps, and how it is seen."""

from __future__ import annotations

from collections.abc import Callable

from sim.effects.plan import plan_effects
from sim.effects.presets import build_model
from sim.fields.press_fields import surface_state
from sim.fields.surface import SurfaceState
from sim.optics.camera_geometry import CameraGeometry
from sim.press import follow, path_for
from sim.scene.indenter import Cylinder, Indenter, MeshIndenter, Sphere
from sim.scene.pad import SurfacePad
from sim.scene.scene import Preset, Scene, Target
from sim.sensor.sensor import Sensor
from sim.studies.objects.shapes import chisel
from sim.studies.verification.quarter_mesh import quarter_mesh

_DEPTH_M = 0.5e-3


def _cylinder() -> Indenter:
    return Cylinder(diameter_m=5e-3, fillet_m=1e-4)


def _ball() -> Indenter:
    return Sphere(diameter_m=8e-3)


BODIES: dict[str, Callable[[], Indenter]] = {
    "cylinder": _cylinder,
    "ball": _ball,
    "edge": chisel,
}
TITLES = {
    "cylinder": "cylinder 5 mm, rim 0.1 mm",
    "ball": "ball 8 mm",
    "edge": "edge of 4 mm between faces at 30 degrees",
}


def pressed(indenter: Indenter, preset: Preset, sensor: Sensor) -> SurfaceState:
    """Press 0.5 mm deep into the middle of a sensor's pad.

    A body of triangles, which its planes x = 0 and y = 0 must mirror, meets a quarter of the pad,
    with the edge lengths of the preset's footprint mesh.

    Raises:
        ConvergenceError: The press finds no equilibrium.
    """
    scene = Scene(
        pad=sensor.pad,
        material=sensor.material,
        tetwild=sensor.tetwild,
        indenter=indenter,
        target=Target(depth_m=_DEPTH_M),
        preset=preset,
        sensor=sensor.name,
    )
    plan = plan_effects(scene)
    model = None
    if isinstance(indenter, MeshIndenter) and not isinstance(scene.pad, SurfacePad):
        model = build_model(scene, plan=plan, mesh=quarter_mesh(scene, scene.pad))
    path = path_for(scene, plan, model=model)
    return surface_state(path, follow(scene, path))


def view(sensor: Sensor) -> CameraGeometry:
    """Return the sensor's camera, over the middle of its pad."""
    camera = sensor.camera
    return CameraGeometry(
        width=camera.width,
        height=camera.height,
        scale_x_m=camera.pixel_m[0],
        scale_y_m=camera.pixel_m[1],
        centre_x_px=0.5 * (camera.width - 1),
        centre_y_px=0.5 * (camera.height - 1),
    )
