"""Figures of a calibration: slopes seen, and held-out presses real, rendered and apart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle as Outline

from sim.optics.calibrate.ball_press import Circle
from sim.optics.calibrate.cross_validation import RenderedPress, SlopeCoverage, as_seen, crop_window
from sim.optics.calibrate.press_scene import PressScene
from tacauchy_rig.core.rgb import encode_png

_DPI = 150
_SETS_A_ROW = 4
_DIFFERENCE_GAIN = 4.0


def draw_coverage(
    coverage: SlopeCoverage, circles: Sequence[Circle], scene: PressScene, path: Path
) -> None:
    """Draw which tilts were seen by how many presses, and where the contacts lay, as PNG."""
    figure = Figure(figsize=(7.2, 3.0), layout="constrained")
    slopes, places = figure.subplots(1, 2, width_ratios=(1.0, 1.1))
    shown = np.ma.masked_equal(coverage.presses_seen, 0)
    steepest_deg = math.degrees(math.asin(min(coverage.tilt_limit, 1.0)))
    mesh = slopes.pcolormesh(
        coverage.tilt_edges, coverage.tilt_edges, shown, cmap="viridis", vmin=0
    )
    slopes.add_patch(Outline((0, 0), coverage.tilt_limit, fill=False, color="#777777"))
    slopes.set(
        aspect="equal",
        xlabel="tilt along columns",
        ylabel="tilt along rows",
        title=f"{coverage.slopes_seen_share:.0%} of slopes to {steepest_deg:.0f} deg",
    )
    slopes.invert_yaxis()
    figure.colorbar(mesh, ax=slopes, label="presses that show it")
    places.imshow(np.clip(scene.frame / 255.0, 0.0, 1.0))
    for circle in circles:
        places.add_patch(
            Outline((circle.x_px, circle.y_px), circle.radius_px, fill=False, lw=0.8, color="#222")
        )
    places.set(
        xlabel="column [px]",
        ylabel="row [px]",
        title=f"{len(circles)} contacts, {coverage.image_share:.0%} of the image",
    )
    figure.savefig(path, dpi=_DPI)


def draw_presses(held_out: Sequence[RenderedPress], scene: PressScene, path: Path) -> None:
    """Draw each press's crop: real, rendered in its light, and four times their difference."""
    rows = math.ceil(len(held_out) / _SETS_A_ROW)
    figure = Figure(figsize=(3.0 * _SETS_A_ROW, 1.2 * rows + 0.3), layout="constrained")
    axes = figure.subplots(rows, _SETS_A_ROW, squeeze=False).ravel()
    for axis in axes:
        axis.set_axis_off()
    for axis, item in zip(axes, held_out, strict=False):
        real = item.press.image.astype(np.float64)
        rendered = as_seen(item.rendered, item.light, scene)
        difference = 127.0 + _DIFFERENCE_GAIN * (rendered - real)
        window = crop_window(item.press.circle, *real.shape[:2])
        crops = [part[window] for part in (real, rendered, difference)]
        axis.imshow(np.clip(np.concatenate(crops, axis=1) / 255.0, 0.0, 1.0))
        axis.set_title(item.press.name, fontsize=7)
    figure.suptitle(f"real | rendered | grey + {_DIFFERENCE_GAIN:g} x (rendered - real)", size=8)
    figure.savefig(path, dpi=_DPI)


def write_renderings(held_out: Sequence[RenderedPress], scene: PressScene, folder: Path) -> None:
    """Write each press as rendered in its frame's light by a model that had not seen it, as PNG."""
    folder.mkdir(parents=True, exist_ok=True)
    for item in held_out:
        image = as_seen(item.rendered, item.light, scene).astype(np.uint8)
        name = Path(item.press.name).with_suffix(".png").name
        (folder / name).write_bytes(encode_png(image))
