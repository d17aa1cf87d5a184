"""The height map that is rendered, against one of a much finer solution."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sim.effects import plan_effects
from sim.fields import surface_state
from sim.indenter import Cylinder, Indenter, Sphere
from sim.object_shapes import bar
from sim.optics.contact_bound import indenter_height
from sim.optics.geometry import CameraGeometry
from sim.optics.height_map import HeightMaps, height_maps
from sim.press import follow, path_for
from sim.scene import Preset, Scene, Target
from sim.sensor import Sensor, load_sensor
from sim.surface import SurfaceState
from sim.verification.section import Section

LIMIT_M = 10e-6
_DEPTH_M = 0.5e-3
_ROUNDING_M = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightMapError:
    """One press on two meshes, seen by the sensor's camera.

    Attributes:
        name: Of the indenter.
        preset: That is judged against ``reference``.
        largest_m: Largest difference of a pixel's height [m].
        rms_m: Root mean square difference over the image [m].
        share_above: Share of the pixels that differ by more than the limit.
        pixels_above: Pixels of either map that lie above the indenter.
    """

    name: str
    preset: str
    largest_m: float
    rms_m: float
    share_above: float
    pixels_above: int


def indenters() -> dict[str, Indenter]:
    """Return what is pressed: the dry run's cylinder, a ball, and a bar with straight edges."""
    return {
        "cylinder 5 mm, rim 0.1 mm": Cylinder(diameter_m=5e-3, fillet_m=1e-4),
        "ball 8 mm": Sphere(diameter_m=8e-3),
        "bar 8 x 1.5 mm, sharp": bar(),
    }


def height_map_error(
    name: str,
    indenter: Indenter,
    *,
    preset: Preset,
    sensor: Sensor,
    finer: Preset = Preset.REFERENCE,
) -> HeightMapError:
    """Press 0.5 mm deep with both presets and compare the heights pixel by pixel.

    Raises:
        ConvergenceError: A press finds no equilibrium.
    """
    view = sensor.camera
    geometry = CameraGeometry(
        width=view.width,
        height=view.height,
        scale_x_m=view.pixel_m[0],
        scale_y_m=view.pixel_m[1],
        centre_x_px=0.5 * (view.width - 1),
        centre_y_px=0.5 * (view.height - 1),
    )
    scene = Scene(
        pad=sensor.pad,
        material=sensor.material,
        filling=sensor.filling,
        indenter=indenter,
        target=Target(depth_m=_DEPTH_M),
        preset=preset,
        sensor=sensor.name,
    )
    coarse, fine = _pressed(scene), _pressed(replace(scene, preset=finer))
    maps = [height_maps(surface, geometry, pad=sensor.pad) for surface in (coarse, fine)]
    off = np.abs(maps[0].loaded - maps[1].loaded)
    return HeightMapError(
        name=name,
        preset=preset.value,
        largest_m=float(off.max()),
        rms_m=float(np.sqrt(np.mean(off**2))),
        share_above=float(np.mean(off > LIMIT_M)),
        pixels_above=sum(
            _pixels_above(m, s, geometry) for m, s in zip(maps, (coarse, fine), strict=True)
        ),
    )


def measure() -> Section:
    """Press the three indenters into a GelSight Mini with the replay's preset and the finest."""
    sensor = load_sensor("gelsight-mini")
    found = [
        height_map_error(name, indenter, preset=Preset.BALANCED, sensor=sensor)
        for name, indenter in indenters().items()
    ]
    return Section(
        title="Height map of preset `balanced` against preset `reference`",
        columns=(
            "indenter, 0.5 mm deep",
            "largest difference of a pixel [um]",
            "rms [um]",
            "pixels above 10 um [%]",
            "pixels above the indenter",
        ),
        rows=tuple(
            (
                error.name,
                error.largest_m * 1e6,
                error.rms_m * 1e6,
                error.share_above * 100.0,
                float(error.pixels_above),
            )
            for error in found
        ),
        criterion="every pixel of the image within 10 um, none above the indenter",
        passed=all(e.largest_m <= LIMIT_M and e.pixels_above == 0 for e in found),
        note="The image of the sensor's camera, 320 x 240 px of 0.0634 mm, pressed to equal depth.",
    )


def _pressed(scene: Scene) -> SurfaceState:
    path = path_for(scene, plan_effects(scene))
    return surface_state(path, follow(scene, path))


def _pixels_above(maps: HeightMaps, surface: SurfaceState, geometry: CameraGeometry) -> int:
    ceiling = indenter_height(surface, *geometry.pad_grid())
    return int(np.sum(maps.loaded > ceiling + _ROUNDING_M))
