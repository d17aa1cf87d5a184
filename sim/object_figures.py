"""The figure of five objects: the body, the dent, and the tactile image, on each sensor."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sim.object_runs import ObjectPress
from tacauchy_rig.errors import RecordError

_PAGE_IN = 7.16
_ROW_IN = 1.12
_MM = 1e3
_STYLE: Any = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "axes.linewidth": 0.5,
    "pdf.fonttype": 42,  # embeds the fonts
    "savefig.dpi": 300,
}


def draw_objects(runs: Sequence[Sequence[ObjectPress]], folder: Path) -> list[Path]:
    """Draw the objects, one a column, and below them dent and image on each sensor.

    Args:
        runs: Of each sensor the objects in one order.
        folder: Where ``five_objects.pdf`` and ``.png`` go.

    Raises:
        RecordError: The files cannot be written.
    """
    rows, columns = 1 + 2 * len(runs), len(runs[0])
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(_PAGE_IN, _ROW_IN * rows), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False)
        for column, run in enumerate(runs[0]):
            _draw_body(axes[0, column], run)
        for k, sensor in enumerate(runs):
            deepest = max(float((run.maps.rest - run.maps.loaded).max()) for run in sensor)
            for column, run in enumerate(sensor):
                dent, seen = axes[1 + 2 * k, column], axes[2 + 2 * k, column]
                drawn = _draw_dent(dent, run, deepest)
                seen.imshow(run.image)
                _bare(seen)
            axes[1 + 2 * k, 0].set_ylabel(f"{sensor[0].sensor}\ndent")
            axes[2 + 2 * k, 0].set_ylabel(f"{sensor[0].sensor}\nimage")
            figure.colorbar(drawn, ax=list(axes[1 + 2 * k]), label="dent [mm]", pad=0.01)
        axes[0, 0].set_ylabel("object,\nfrom below")
        paths = [folder / f"five_objects.{kind}" for kind in ("pdf", "png")]
        try:
            for path in paths:
                figure.savefig(path)
        except OSError as error:
            raise RecordError(
                f"{folder}: figures cannot be written: {error}",
                remedy="free space, or another --out",
            ) from error
    return paths


def _draw_body(axes: Axes, run: ObjectPress) -> None:
    seen = np.where(np.isfinite(run.underside), run.underside, np.nan) * _MM
    axes.imshow(np.ma.masked_invalid(seen), cmap="cividis_r", vmin=0.0, vmax=2.0)
    axes.set_title(run.name)
    _bare(axes)
    length = 2e-3 / run.geometry.scale_x_m
    axes.plot([8, 8 + length], [run.geometry.height - 10] * 2, color="black", linewidth=1.2)
    axes.text(8 + 0.5 * length, run.geometry.height - 16, "2 mm", ha="center", fontsize=6)


def _draw_dent(axes: Axes, run: ObjectPress, deepest_m: float) -> Any:
    dent = (run.maps.rest - run.maps.loaded) * _MM
    drawn = axes.imshow(dent, cmap="cividis", vmin=0.0, vmax=deepest_m * _MM)
    axes.contour(run.maps.contact, levels=[0.5], colors="white", linewidths=0.5)
    axes.set_title(f"$F_z$ = {run.force_n:.2f} N", pad=2)
    _bare(axes)
    return drawn


def _bare(axes: Axes) -> None:
    axes.set_xticks([])
    axes.set_yticks([])
