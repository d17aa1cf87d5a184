"""All figures of a report, in the order of the page, with their captions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from reports.comparison.results import ValidationReport
from reports.figures.diagnostics import draw_arrival, draw_contact, draw_truth
from reports.figures.forces import draw_force_depth, draw_time_curves
from reports.figures.images import draw_images
from reports.figures.matrices import draw_matrices
from reports.figures.scores import draw_errors, draw_similarities
from tacauchy_rig.figure_style import STYLE, save_figure


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnFigure:
    """A figure on disk: ``name.pdf`` and ``name.png`` in the figures folder."""

    name: str
    caption: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _Plan:
    name: str
    caption: str
    draw: Callable[[ValidationReport], Figure]
    wanted: Callable[[ValidationReport], bool]


def draw_figures(report: ValidationReport, folder: Path) -> list[DrawnFigure]:
    """Draw and write every figure that this run has data for."""
    folder.mkdir(parents=True, exist_ok=True)
    drawn = []
    with mpl.rc_context(STYLE):
        for plan in _PLANS:
            if plan.wanted(report):
                save_figure(plan.draw(report), folder, plan.name)
                drawn.append(DrawnFigure(name=plan.name, caption=plan.caption))
    return drawn


def _has_images(report: ValidationReport) -> bool:
    return any(t.images is not None for t in report.evidence.trials)


def _has_scores(report: ValidationReport) -> bool:
    return any(t.metrics is not None for t in report.trials)


def _has_curves(report: ValidationReport) -> bool:
    return any(t.force_curve is not None for t in report.evidence.trials)


_PLANS = (
    _Plan(
        name="images",
        caption="Real images (median of the dwell), simulated images and their difference in"
        " luminance over the target forces. All differences share one scale.",
        draw=lambda report: draw_images(report.evidence),
        wanted=_has_images,
    ),
    _Plan(
        name="similarities",
        caption="SSIM, NCC and histogram correlation of simulated against real images (RGB, whole"
        " frame). (a) Over the target forces; dotted: the no-contact frame in place of the"
        " simulated image. (b) The same as bars with means over the trials; black dashes: no"
        " contact.",
        draw=draw_similarities,
        wanted=_has_scores,
    ),
    _Plan(
        name="errors",
        caption="(a) Mean squared error and (b) PSNR with their means; PSNR also of the mean MSE,"
        " which is a different number. Black dashes: no contact.",
        draw=draw_errors,
        wanted=_has_scores,
    ),
    _Plan(
        name="wrong-force",
        caption="Every real press (row) against the simulated image of every press (column)."
        " Brighter is better within a row; the frame marks the best of the row, orange where it"
        " is a wrong force. A score that loses its diagonal does not see the force.",
        draw=draw_matrices,
        wanted=lambda report: bool(report.matrices),
    ),
    _Plan(
        name="contact",
        caption="The contact alone: (a) correlation and (b) relative residual of the change"
        " against the no-contact frame, in the region that the real image shows. Raw first; then"
        " with the fitted translation and the light fitted outside the contact taken out.",
        draw=draw_contact,
        wanted=lambda report: any(t.contact is not None for t in report.trials),
    ),
    _Plan(
        name="time",
        caption="Force (tared, raw rate) and depth below first contact over each press. Grey: the"
        " dwell that counts; dashed: target.",
        draw=draw_time_curves,
        wanted=_has_curves,
    ),
    _Plan(
        name="force-depth",
        caption="Force over depth: measured while loading, its mean in the dwell (bars: one"
        " standard deviation), and every evaluation of the simulator; dashed: with the modulus"
        " that the measured depths and forces tell, where the run was replayed with that.",
        draw=draw_force_depth,
        wanted=_has_curves,
    ),
    _Plan(
        name="arrival",
        caption="How late samples arrive: part of the intervals longer than the value on the"
        " axis, all trials together. Dashed: nominal. Lost samples by the devices' own counters.",
        draw=draw_arrival,
        wanted=lambda report: any(t.streams for t in report.evidence.trials),
    ),
    _Plan(
        name="truth",
        caption="What the pipeline recovered of the emulated world, which it could not see: one"
        " dot a press, or one for the run.",
        draw=draw_truth,
        wanted=lambda report: any(c.unit == "mm" or c.true != 0.0 for c in report.truth),
    ),
)
