"""What every simulator shows of a press, and what it leaves unexplained, around the contact."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import AsinhNorm
from matplotlib.figure import Figure

from reports.comparison.judging import JudgedSimulator, Judgement
from reports.evidence.evidence import TrialEvidence, TrialImages
from reports.figures.images import DIFFERENCE_COLORS, LINEAR_LEVELS, difference_scale
from reports.figures.trials import shown
from reports.scores.contact import contact_crop, contact_footprint, image_change
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.figure_style import GREY, PAGE_IN, new_figure
from tacauchy_rig.core.rgb import to_grey

MARGINS_IN = 1.0
HEAD_IN = 0.25
LABEL_IN = 0.13  # of a residual below each panel of a difference
NAME_WIDTH = 16  # characters of a line beside a panel


def draw_judged(judgement: Judgement) -> Figure:
    """Draw the camera's crops and, of each simulator, its images and their differences."""
    evidence = judgement.evidence
    seen = [t for t in evidence.trials if t.images is not None]
    trials = shown(seen)
    drawn = [s for s in judgement.simulators if any(s.image(t.index) is not None for t in trials)]
    panel = (PAGE_IN - MARGINS_IN) / max(len(trials), 3)
    height = (1 + 2 * len(drawn)) * panel + len(drawn) * LABEL_IN + HEAD_IN
    figure = new_figure(PAGE_IN, height, marks=evidence.marks)
    grid = figure.subplots(1 + 2 * len(drawn), len(trials), squeeze=False)
    for axes in grid.ravel():
        axes.set(xticks=[], yticks=[])
        axes.spines[:].set_visible(True)
        axes.spines[:].set_linewidth(0.3)
    scale = _scale(trials, drawn)
    for column, trial in zip(grid.T, trials, strict=True):
        if trial.images is not None:
            column[0].set_title(_title(trial), fontsize=7.5, pad=3)
            _draw_column(column, trial, trial.images, drawn, scale)
    grid[0, 0].set_ylabel(f"Camera\n({evidence.camera})", fontsize=6.5)
    for k, simulator in enumerate(drawn):
        name = textwrap.fill(simulator.simulator.name, NAME_WIDTH)
        grid[1 + 2 * k, 0].set_ylabel(name, fontsize=6.5)
        grid[2 + 2 * k, 0].set_ylabel("less camera's", fontsize=6.5)
    said = (
        f"purple −{scale.vmax:g}, orange +{scale.vmax:g} grey levels, linear to {LINEAR_LEVELS:g}"
    )
    figure.supxlabel(f"Differences of luminance: {said}", fontsize=6.5)
    return figure


def _draw_column(
    column: Sequence[Axes],
    trial: TrialEvidence,
    images: TrialImages,
    drawn: Sequence[JudgedSimulator],
    scale: AsinhNorm,
) -> None:
    crop = _crop(images)
    column[0].imshow(images.real[crop], interpolation="nearest")
    for k, simulator in enumerate(drawn):
        pair = column[1 + 2 * k], column[2 + 2 * k]
        image = simulator.image(trial.index)
        if image is None:
            for axes in pair:
                axes.text(0.5, 0.5, "none", color=GREY, ha="center", transform=axes.transAxes)
            continue
        pair[0].imshow(image[crop], interpolation="nearest")
        pair[1].imshow(
            _difference(images, image)[crop],
            interpolation="nearest",
            cmap=DIFFERENCE_COLORS,
            norm=scale,
        )
        contact = next((p.contact for p in simulator.presses if p.index == trial.index), None)
        if contact is not None:
            pair[1].set_xlabel(f"residual {contact.relative_residual:.3f}", fontsize=6, labelpad=1)


def _title(trial: TrialEvidence) -> str:
    is_known = not np.isnan(trial.force_target_n)
    return f"$F_z$ = {trial.force_target_n:.2f} N" if is_known else f"press {trial.index}"


def _crop(images: TrialImages) -> tuple[slice, slice]:
    footprint = contact_footprint(image_change(images.real, images.reference))
    return (slice(None), slice(None)) if footprint is None else contact_crop(footprint)


def _scale(trials: Sequence[TrialEvidence], drawn: Sequence[JudgedSimulator]) -> AsinhNorm:
    """Return the colours that all differences share."""
    return difference_scale(
        _difference(t.images, image)[_crop(t.images)]
        for t in trials
        for simulator in drawn
        if t.images is not None and (image := simulator.image(t.index)) is not None
    )


def _difference(images: TrialImages, image: ImageArray) -> FloatArray:
    """Return simulated less camera's luminance, shape [height, width] [grey level]."""
    return to_grey(image).astype(np.float64) - to_grey(images.real).astype(np.float64)
