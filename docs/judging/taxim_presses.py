"""Write what Taxim's renderer shows of the presses that it was calibrated from, for ``judge``.

Taxim (Si and Yuan, RA-L 2022) as the wheel ``taxim`` has it: JAX on the processor, with the
calibration and the presses that it ships. It runs in an environment without this project:

    python3.11 -m venv taxim-venv
    taxim-venv/bin/pip install taxim jax pillow
    taxim-venv/bin/python docs/judging/taxim_presses.py gelsight_mini --out taxim-mini

Each press is a ball of a stated diameter, cut into the gel to where the circle of the press lies;
how the gel bends around it is Taxim's own. Two folders are written: ``as_it_is``, and
``over_the_frame``, its change against its own image of level gel, laid over the camera's no-contact
frame. Taxim draws level gel, too, and not as the camera shows it: the second forgives it that.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
from jax import devices
from PIL import Image
from taxim import CALIB_GELSIGHT, CALIB_GELSIGHT_MINI, Taxim

SETS = {"gelsight": CALIB_GELSIGHT, "gelsight_mini": CALIB_GELSIGHT_MINI}
BESIDE_MM = 10.0
"""Height of what is beside the ball: far off the gel."""


def ball_over_gel(
    circle: tuple[float, float, float], *, radius_mm: float, mm_px: float, gel_mm: np.ndarray
) -> np.ndarray:
    """Return the ball's height over the gel's highest point [mm]; where it is lower, it cuts.

    Args:
        circle: Column, row and radius of the contact's edge [px].
        gel_mm: Height of the gel over its highest point, shape [height, width]: the contact's edge
            lies on it.
    """
    column, row, edge_px = circle
    rows, columns = np.indices(gel_mm.shape)
    away = mm_px * np.hypot(columns - column, rows - row)
    below = np.sqrt(np.maximum(radius_mm**2 - away**2, 0.0))
    edge = np.sqrt(radius_mm**2 - (mm_px * edge_px) ** 2)
    around = np.abs(away - mm_px * edge_px) < mm_px
    return np.where(away < radius_mm, gel_mm[around].mean() + edge - below, BESIDE_MM)


def main() -> None:
    """Render each press of a set and write the folder."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("set", choices=SETS)
    parser.add_argument("--ball-diameter-mm", type=float, default=4.0)
    parser.add_argument(
        "--circles",
        type=Path,
        help="what `tacauchy-rig calibrate optics --json` wrote: contacts as it has them; without "
        "it, those that were drawn for Taxim's own calibration",
    )
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    taxim = Taxim(calib_folder=SETS[asked.set], backend="jax", device="cpu")
    with np.load(SETS[asked.set] / "dataPack.npz", allow_pickle=False) as data:
        frame = data["f0"][..., ::-1].astype(float)  # OpenCV read it: blue is first
        circles = np.column_stack([data["touch_center"], data["touch_radius"]]).astype(float)
    gel_px = np.load(SETS[asked.set] / "gelmap.npy", allow_pickle=False)
    gel_mm = taxim.sensor_params.pixmm * (gel_px - gel_px.max())
    if asked.circles is not None:
        found = json.loads(asked.circles.read_text())["presses"]
        circles = np.array([list(press["labelled"].values()) for press in found])
    heights = [
        ball_over_gel(
            (column, row, radius),
            radius_mm=0.5 * asked.ball_diameter_mm,
            mm_px=taxim.sensor_params.pixmm,
            gel_mm=gel_mm,
        )
        for column, row, radius in circles.tolist()
    ]
    level = 255.0 * np.asarray(taxim.render(np.full_like(heights[0], BESIDE_MM)))  # compiles, too
    started = time.perf_counter()
    images = [255.0 * np.asarray(taxim.render(height)) for height in heights]
    about = {
        "milliseconds": 1e3 * (time.perf_counter() - started) / len(images),
        "note": f"The calibration that it ships, ball {asked.ball_diameter_mm:g} mm, contacts as "
        f"{'drawn for it' if asked.circles is None else 'found by ours'}.",
    }
    who = "Taxim" if asked.circles is None else "Taxim, found contacts"
    write(asked.out / "as_it_is", images, name=who, **about)
    laid = [frame + image - level for image in images]
    write(asked.out / "over_the_frame", laid, name=f"{who}, over the camera's frame", **about)


def write(
    folder: Path, images: list[np.ndarray], *, name: str, milliseconds: float, note: str
) -> None:
    """Write images of grey levels, red first, in the layout that ``judge`` reads."""
    for number, image in enumerate(images, start=1):
        place = folder / f"{number:02d}"
        place.mkdir(parents=True)
        levels = np.clip(np.rint(image), 0, 255).astype(np.uint8)
        Image.fromarray(levels).save(place / "image.png")
    (folder / "simulator.toml").write_text(
        f'name = "{name}"\nversion = "{version("taxim")}"\ncolour_order = "RGB"\n'
        f"milliseconds_an_image = {milliseconds:.1f}\n"
        f'machine = "{devices()[0].device_kind}, {platform.system()}, {platform.machine()}, '
        f'JAX {version("jax")}"\n'
        "fitted_to_these = true\n"
        f'note = "{note}"\n'
    )


if __name__ == "__main__":
    main()
