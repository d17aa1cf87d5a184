"""The figure of five objects: the body, the dent, and the tactile image, on each sensor.

Dents and images of all sensors are cut to what the camera with the narrowest view sees.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from sim.scene.triangle_surface import TriangleSurface
from sim.sensor.camera_geometry import CameraGeometry
from sim.studies.objects.runs import ObjectPress
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.figure_style import FRAMED_STYLE, INK, PAGE_IN, save_figure

_MM = 1e3
_ROW_IN = 0.98
_SLANT_RAD = math.radians(35.0)
_LIGHT = np.array([0.35, -0.15, -0.92])
_DARKEST = 0.35
_BAR_MM = 2.0


def draw_objects(
    runs: Sequence[Sequence[ObjectPress]], folder: Path, *, page_folder: Path | None = None
) -> list[Path]:
    """Draw the objects, one a column, and below them dent and image on each sensor.

    Args:
        runs: Of each sensor the objects in one order.
        folder: Where ``five_objects.pdf`` and ``.png`` go.
        page_folder: Put a smaller PNG there besides.

    Raises:
        RecordError: The files cannot be written.
    """
    rows, columns = 1 + 2 * len(runs), len(runs[0])
    half = np.min([_half_view_mm(sensor[0].geometry) for sensor in runs], axis=0)
    with mpl.rc_context(FRAMED_STYLE):
        layout = ConstrainedLayoutEngine(w_pad=0.02, h_pad=0.02, hspace=0.01, wspace=0.01)
        figure = Figure(figsize=(PAGE_IN, _ROW_IN * rows), layout=layout)
        axes = figure.subplots(rows, columns, squeeze=False)
        for column, run in enumerate(runs[0]):
            axes[0, column].set_title(run.name)
            _draw_body(axes[0, column], run.surface)
            _frame(axes[0, column], half)
        axes[0, 0].set_ylabel("object,\nfrom below")
        for k, sensor in enumerate(runs):
            _draw_sensor(axes[1 + 2 * k : 3 + 2 * k], sensor, half)
        _draw_length(axes[0, 0], half)
        return save_figure(figure, folder, "five_objects", page_folder=page_folder)


def _draw_sensor(axes: Any, sensor: Sequence[ObjectPress], half_mm: FloatArray) -> None:
    """Draw a sensor's dents and images, one a column of two rows of axes."""
    deepest = max(float((run.maps.rest - run.maps.loaded).max()) for run in sensor)
    for (dented, seen), run in zip(axes.T, sensor, strict=True):
        extent = _extent_mm(run.geometry)
        dent = (run.maps.rest - run.maps.loaded) * _MM
        drawn = dented.imshow(dent, cmap="cividis", vmin=0.0, vmax=deepest * _MM, extent=extent)
        force = f"{run.force_n:.2f} N"
        dented.text(0.03, 0.95, force, color="white", va="top", transform=dented.transAxes)
        seen.imshow(run.image, extent=extent)
        _frame(dented, half_mm)
        _frame(seen, half_mm)
    axes[0, 0].set_ylabel(f"{sensor[0].sensor}\ndent")
    axes[1, 0].set_ylabel(f"{sensor[0].sensor}\nimage")
    beside = axes[0, -1].inset_axes((1.04, 0.0, 0.05, 1.0))
    bar = axes[0, -1].figure.colorbar(drawn, cax=beside, label="dent (mm)")
    bar.outline.set_linewidth(0.5)


def _draw_body(axes: Axes, surface: TriangleSurface) -> None:
    """Draw a body's faces from below at a slant, the farthest first, lit from the camera's side."""
    towards = np.array([0.0, -math.sin(_SLANT_RAD), -math.cos(_SLANT_RAD)])
    down = np.array([0.0, math.cos(_SLANT_RAD), -math.sin(_SLANT_RAD)])
    corners = surface.vertices[surface.faces]
    seen = np.flatnonzero(surface.face_normals @ towards > 0.0)
    seen = seen[np.argsort(corners[seen].mean(axis=1) @ towards)]
    lit = np.clip(surface.face_normals[seen] @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.0, 1.0)
    grey = _DARKEST + (1.0 - _DARKEST) * lit
    flat = np.stack([corners[seen][..., 0], corners[seen] @ down], axis=-1) * _MM
    middle = 0.5 * (flat.reshape(-1, 2).min(axis=0) + flat.reshape(-1, 2).max(axis=0))
    colours = np.repeat(grey[:, None], 3, axis=1)
    axes.add_collection(
        PolyCollection(list(flat - middle), facecolors=colours, edgecolors=colours, linewidths=0.4)
    )


def _draw_length(axes: Axes, half_mm: FloatArray) -> None:
    left, low = -0.94 * half_mm[0], 0.86 * half_mm[1]
    axes.plot([left, left + _BAR_MM], [low, low], color=INK, linewidth=1.2)
    axes.text(left, low - 0.35, f"{_BAR_MM:g} mm", fontsize=6.5, va="bottom")


def _frame(axes: Axes, half_mm: FloatArray) -> None:
    """Show the same piece of the pad everywhere, rows growing downwards, without ticks."""
    axes.set_xlim(-half_mm[0], half_mm[0])
    axes.set_ylim(half_mm[1], -half_mm[1])
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])


def _extent_mm(geometry: CameraGeometry) -> tuple[float, float, float, float]:
    """Return what an image shows of the pad: left, right, bottom, top [mm]."""
    corners = [[-0.5, -0.5], [geometry.width - 0.5, geometry.height - 0.5]]
    (left, top), (right, bottom) = (geometry.to_pad(np.array(corners)) * _MM).tolist()
    return left, right, bottom, top


def _half_view_mm(geometry: CameraGeometry) -> FloatArray:
    left, right, bottom, top = _extent_mm(geometry)
    return np.array([min(-left, right), min(-top, bottom)])
