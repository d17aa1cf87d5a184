"""Camera's and simulated images of objects, with their difference (the paper's objects figure)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from reports.arrays import FloatArray
from reports.comparison.objects import ObjectPress
from reports.figures.images import DIFFERENCE_COLORS, LINEAR_LEVELS, difference_scale
from reports.figures.trials import shown
from reports.scores.metrics import ImageScores
from tacauchy_rig.core.figure_style import GREY, PAGE_IN, new_figure
from tacauchy_rig.core.rgb import to_grey

MOST_ROWS = 6
"""That objects share; of more objects each has one."""
_TEXT_IN, _HEAD_IN, _FOOT_IN = 1.5, 0.2, 0.2
_UM_OF_NOTHING = 5e-7
"""A depth below it is not told [m]."""


def chosen(presses: Sequence[ObjectPress]) -> list[ObjectPress]:
    """Return the rows: of each object as many presses, spread over its forces, the largest last."""
    objects = list(dict.fromkeys(press.indenter for press in presses))
    each = max(1, MOST_ROWS // len(objects))
    rows = []
    for name in objects:
        own = {press.trial.index: press for press in presses if press.indenter == name}
        trials = shown([press.trial for press in own.values()], most=max(each, 2))
        rows += [own[trial.index] for trial in trials[-each:]]
    return rows


def draw_objects(
    presses: Sequence[ObjectPress], *, camera: str, simulator: str, marks: Sequence[str]
) -> Figure:
    """Draw a row a press: camera's image, simulated one, difference, and scores beside the floor.

    Args:
        camera: ``real`` or ``emulated``.
        simulator: Whose the simulated images are.
        marks: Of the run.
    """
    rows = chosen(presses)
    shape = rows[0].images.real.shape
    panel = (PAGE_IN - _TEXT_IN) / 3
    height = len(rows) * (panel * shape[0] / shape[1] + 0.04) + _HEAD_IN + _FOOT_IN
    figure = new_figure(PAGE_IN, height, marks=marks, pad_in=0.012)
    grid = figure.subplots(
        len(rows), 4, squeeze=False, width_ratios=[panel, panel, panel, _TEXT_IN]
    )
    scale = difference_scale(_difference(press) for press in rows)
    for axes, press in zip(grid, rows, strict=True):
        axes[0].imshow(press.images.real, interpolation="nearest")
        axes[1].imshow(press.simulated, interpolation="nearest")
        axes[2].imshow(
            _difference(press), interpolation="nearest", cmap=DIFFERENCE_COLORS, norm=scale
        )
        for each in axes[:3]:
            each.set(xticks=[], yticks=[])
            each.spines[:].set_visible(True)
            each.spines[:].set_linewidth(0.3)
        _tell(axes[3], press)
    heads = (camera.capitalize(), f"Simulated: {simulator}", f"Simulated − {camera}")
    for axes, head in zip(grid[0], heads, strict=False):
        axes.set_title(head, fontsize=7.5, pad=3)
    figure.supxlabel(
        f"Differences of luminance: purple −{scale.vmax:g}, orange +{scale.vmax:g} grey levels, "
        f"linear to {LINEAR_LEVELS:g}; scores of the whole frame, RGB",
        fontsize=6.5,
    )
    return figure


def _difference(press: ObjectPress) -> FloatArray:
    """Return simulated less camera's luminance, shape [height, width] [grey level]."""
    simulated = to_grey(press.simulated).astype(np.float64)
    return simulated - to_grey(press.images.real).astype(np.float64)


def _tell(axes: Axes, press: ObjectPress) -> None:
    """Write object, force and scores beside a row."""
    axes.set_axis_off()
    record = press.trial.record
    force_n = press.trial.force_target_n
    depth_m = None if record is None else record.depth_measured_m
    told = [press.indenter.replace(":", "\n").replace(",", "\n"), f"press {press.trial.index}"]
    told += [] if math.isnan(force_n) else [f"$F_z$ = {force_n:.2f} N"]
    told += [f"{depth_m * 1e3:.2f} mm deep"] if depth_m and depth_m > _UM_OF_NOTHING else []
    axes.text(0.0, 1.0, "\n".join(told), va="top", fontsize=6.5, transform=axes.transAxes)
    own, floor = _scores(press.scores), _scores(press.no_contact)
    axes.text(0.0, 0.2, f"SSIM, PSNR\n{own}", va="bottom", fontsize=7, transform=axes.transAxes)
    said = f"no contact scores\n{floor}"
    axes.text(0.0, 0.0, said, va="bottom", fontsize=6, color=GREY, transform=axes.transAxes)


def _scores(scores: ImageScores) -> str:
    return f"{scores.ssim:.4f}, {scores.psnr_db:.2f} dB"
