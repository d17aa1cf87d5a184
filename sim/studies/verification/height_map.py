"""The height map that is rendered, against one of a much finer solution, which is kept.

``python -m sim.studies.verification.height_map cylinder ball edge`` presses these with preset
``reference`` and keeps their heights; without names, all of them, which takes a few minutes.
"""

import sys
from collections.abc import Callable
from importlib import resources
from pathlib import Path

import numpy as np

from sim.effects.effect_choice import plan_effects
from sim.effects.press_with_effects import follow, path_for
from sim.fields.saved_press import SurfaceState, surface_state
from sim.optics.height.height_map import height_maps
from sim.scene.indenter import Cylinder, Indenter, MeshIndenter, Sphere, mesh_indenter
from sim.scene.scene import Preset, Target
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.sensor import load_sensor
from sim.studies.verification import Row, section
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.tables import Table

LIMIT_M = 10e-6
_JUDGED = (Preset.BALANCED, Preset.ACCURATE)
_SHOWN = (Preset.FAST, *_JUDGED)
_DEPTH_M = 0.5e-3


def chisel() -> MeshIndenter:
    """Return a chisel: an edge of 4 mm, from which faces fall off by 30 degrees all around."""
    edge, height, slope = 2e-3, 3e-3, np.tan(np.radians(30.0))
    reach = height / slope
    top = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * (edge + reach, reach)
    vertices = np.concatenate(
        [[[edge, 0.0, 0.0], [-edge, 0.0, 0.0]], np.column_stack([top, np.full(4, height)])]
    )
    faces = [[0, 2, 5], [1, 4, 3], [0, 1, 3], [0, 3, 2], [0, 5, 4], [0, 4, 1], [2, 3, 4], [2, 4, 5]]
    return mesh_indenter(vertices, np.array(faces, dtype=np.int32), name="chisel")


# By name: what a table calls a body, and the body.
BODIES: dict[str, tuple[str, Callable[[], Indenter]]] = {
    "cylinder": ("cylinder 5 mm, rim 0.1 mm", lambda: Cylinder(diameter_m=5e-3, fillet_m=1e-4)),
    "ball": ("ball 8 mm", lambda: Sphere(diameter_m=8e-3)),
    "edge": ("edge of 4 mm between faces at 30 degrees", chisel),
}
# Headings of what is measured.
LARGEST, RMS = "largest difference of a pixel [um]", "rms [um]"
ABOVE_LIMIT, ABOVE_INDENTER = "pixels above 10 um", "pixels above the indenter"
# Heights are kept in nanometres; below a picometre it is rounding.
_UNIT_M, _ROUNDING_M = 1e-9, 1e-12


def height_map_row(name: str, preset: Preset, *, reference: FloatArray) -> Row:
    """Press a body 0.5 mm deep into a GelSight Mini and compare the heights pixel by pixel."""
    surface, geometry, heights = _seen(name, preset)
    off = np.abs(heights - reference)
    above = heights - surface.indenter_height(*geometry.pad_grid())
    return {
        "indenter, 0.5 mm deep": BODIES[name][0],
        "preset": preset.value,
        LARGEST: float(off.max()) * 1e6,
        RMS: float(np.sqrt(np.mean(off**2))) * 1e6,
        ABOVE_LIMIT: int(np.sum(off > LIMIT_M)),
        ABOVE_INDENTER: int(np.sum(above > _ROUNDING_M)),
    }


def is_kept(row: Row) -> bool:
    """Every pixel is within the limit and none above the indenter."""
    return row[ABOVE_LIMIT] == row[ABOVE_INDENTER] == 0


def _seen(name: str, preset: Preset) -> tuple[SurfaceState, CameraGeometry, FloatArray]:
    """Press a body; return the surface, the camera, and the heights that it sees [m]."""
    sensor = load_sensor("gelsight-mini")
    scene = sensor.scene(BODIES[name][1](), Target(depth_m=_DEPTH_M), preset=preset)
    path = path_for(scene, plan_effects(scene))
    surface = surface_state(path, follow(scene, path))
    return surface, sensor.camera, height_maps(surface, sensor.camera, pad=sensor.pad).loaded


def measure() -> Table:
    """Press a cylinder, a ball and an edge with all presets but ``reference``."""
    rows = [
        height_map_row(name, preset, reference=kept_heights(name))
        for name in BODIES
        for preset in _SHOWN
    ]
    passed = all(is_kept(row) for row in rows if row["preset"] in _JUDGED)
    return section("heights", rows, passed=passed)


def kept_heights(name: str) -> FloatArray:
    """Return the heights that preset ``reference`` gives for a body [m], shape [height, width]."""
    folder = resources.files("sim.studies.verification.data")
    with folder.joinpath(f"heights_{name}.npz").open("rb") as file, np.load(file) as kept:
        quarter = kept["heights_nm"] * _UNIT_M
    half = np.concatenate([quarter[:, ::-1], quarter], axis=1)
    return np.concatenate([half[::-1], half])


def keep_heights(name: str, folder: Path) -> None:
    """Press a body with preset ``reference``; keep a quarter of its height map, in nanometres."""
    _, geometry, heights = _seen(name, Preset.REFERENCE)
    quarter = heights[geometry.height // 2 :, geometry.width // 2 :]
    whole_nm = np.round(quarter / _UNIT_M).astype(np.int32)
    np.savez_compressed(folder / f"heights_{name}.npz", heights_nm=whole_nm)


if __name__ == "__main__":
    for body in sys.argv[1:] or BODIES:
        keep_heights(body, Path(__file__).parent / "data")
