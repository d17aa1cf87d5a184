"""Height maps of preset ``reference``, kept: pressing them takes a quarter of an hour.

``python -m sim.studies.verification.height_reference cylinder ball edge`` presses them anew and
keeps them; without names, all of them.
"""

from __future__ import annotations

import sys
from importlib import resources
from pathlib import Path

import numpy as np

from sim.arrays import FloatArray
from sim.optics.height.height_map import height_maps
from sim.scene.scene import Preset
from sim.sensor.sensor import load_sensor
from sim.studies.verification.height_presses import BODIES, pressed, view

_FOLDER = "sim.studies.verification.data"
_UNIT_M = 1e-9


def kept_heights(name: str) -> FloatArray:
    """Return the heights that preset ``reference`` gives for a body [m], shape [height, width]."""
    with resources.files(_FOLDER).joinpath(_file(name)).open("rb") as file, np.load(file) as kept:
        quarter = kept["heights_nm"] * _UNIT_M
    half = np.concatenate([quarter[:, ::-1], quarter], axis=1)
    return np.concatenate([half[::-1], half])


def keep_heights(name: str, folder: Path) -> None:
    """Press a body with preset ``reference`` and keep a quarter of its height map, in nanometres.

    Raises:
        ConvergenceError: The press finds no equilibrium.
    """
    sensor = load_sensor("gelsight-mini")
    geometry = view(sensor)
    surface = pressed(BODIES[name](), Preset.REFERENCE, sensor)
    heights = height_maps(surface, geometry, pad=sensor.pad).loaded
    quarter = heights[geometry.height // 2 :, geometry.width // 2 :]
    whole_nm = np.round(quarter / _UNIT_M).astype(np.int32)
    np.savez_compressed(folder / _file(name), heights_nm=whole_nm)


def _file(name: str) -> str:
    return f"heights_{name}.npz"


if __name__ == "__main__":
    for body in sys.argv[1:] or BODIES:
        keep_heights(body, Path(__file__).parent / "data")
