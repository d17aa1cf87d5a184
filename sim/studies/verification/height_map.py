"""The height map that is rendered, against one of a much finer solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.arrays import FloatArray
from sim.optics.height.contact_bound import indenter_height
from sim.optics.height.height_map import height_maps
from sim.scene.scene import Preset
from sim.sensor.sensor import load_sensor
from sim.studies.verification.height_presses import BODIES, TITLES, pressed, view
from sim.studies.verification.height_reference import kept_heights
from tacauchy_rig.tables import Table

LIMIT_M = 10e-6
_JUDGED = (Preset.BALANCED, Preset.ACCURATE)
_SHOWN = (Preset.FAST, *_JUDGED)
_COLUMNS = (
    "indenter, 0.5 mm deep",
    "preset",
    "largest difference of a pixel [um]",
    "rms [um]",
    "pixels above 10 um",
    "pixels above the indenter",
)
_NOTE = (
    "The image of the sensor's camera, 320 x 240 px of 0.0634 mm, pressed to equal depth. The "
    "maps of preset `reference` are kept; `python -m sim.studies.verification.height_reference` "
    "makes them again. The edge is that of a chisel whose four faces fall off by 30 degrees; it "
    "is pressed into a quarter of the pad, with the edge lengths of each preset's footprint mesh."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightMapError:
    """One press, seen by the sensor's camera, beside that of preset ``reference``.

    Attributes:
        name: Of the body.
        preset: That is judged.
        largest_m: Largest difference of a pixel's height [m].
        rms_m: Root mean square difference over the image [m].
        above_limit: Pixels that differ by more than the limit.
        above_indenter: Pixels that lie above the indenter.
    """

    name: str
    preset: Preset
    largest_m: float
    rms_m: float
    above_limit: int
    above_indenter: int

    @property
    def kept(self) -> bool:
        """Every pixel is within the limit and none above the indenter."""
        return self.above_limit == 0 and self.above_indenter == 0


def height_map_error(name: str, preset: Preset, *, reference: FloatArray) -> HeightMapError:
    """Press a body 0.5 mm deep into a GelSight Mini and compare the heights pixel by pixel.

    Args:
        name: One of ``BODIES``.
        reference: Heights to compare with [m], shape [height, width].

    Raises:
        ConvergenceError: The press finds no equilibrium.
    """
    sensor = load_sensor("gelsight-mini")
    geometry = view(sensor)
    surface = pressed(BODIES[name](), preset, sensor)
    heights = height_maps(surface, geometry, pad=sensor.pad).loaded
    off = np.abs(heights - reference)
    return HeightMapError(
        name=name,
        preset=preset,
        largest_m=float(off.max()),
        rms_m=float(np.sqrt(np.mean(off**2))),
        above_limit=int(np.sum(off > LIMIT_M)),
        above_indenter=int(np.sum(heights > indenter_height(surface, *geometry.pad_grid()))),
    )


def measure() -> Table:
    """Press a cylinder, a ball and an edge with all presets but ``reference``."""
    found = [
        height_map_error(name, preset, reference=kept_heights(name))
        for name in BODIES
        for preset in _SHOWN
    ]
    return Table(
        title="Height map against preset `reference`",
        columns=_COLUMNS,
        rows=tuple(
            (
                TITLES[error.name],
                error.preset.value,
                error.largest_m * 1e6,
                error.rms_m * 1e6,
                error.above_limit,
                error.above_indenter,
            )
            for error in found
        ),
        criterion="presets `balanced` and `accurate`: every pixel of the image within 10 um, none "
        "above the indenter",
        passed=all(error.kept for error in found if error.preset in _JUDGED),
        note=_NOTE,
    )
