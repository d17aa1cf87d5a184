"""All figures of a report, in the order of the page, with their captions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from reports.comparison.result_types import ValidationReport
from reports.evidence.evidence_types import RunEvidence
from reports.figures.difference_colours import LINEAR_LEVELS
from tacauchy_rig.core.markdown_page import prose

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _has_curves(evidence: RunEvidence) -> bool:
    return any(trial.force_curve is not None for trial in evidence.trials)


FIGURES: dict[str, Callable[[Any], bool]] = {
    "images": lambda evidence: any(t.images is not None for t in evidence.trials),
    "scores": lambda report: any(t.metrics is not None for t in report.trials),
    "wrong-force": lambda report: bool(report.matrices),
    "time": _has_curves,
    "force-depth": lambda report: _has_curves(report.evidence),
}
"""The figures of the page, in order, and whether a run has data for each."""
RECORDED = ("images", "time")  # drawn of the evidence; the others of the report


def draw_figures(
    report: ValidationReport,
    folder: Path,
    other: Executor | None = None,
    recorded: Future[list[str]] | None = None,
) -> list[dict[str, str]]:
    """Draw and write every figure that this run has data for.

    Args:
        report: Whose figures.
        folder: Where each becomes ``name.pdf`` and ``name.png``.
        other: Another process, which draws them, so that this one need not load what draws.
        recorded: What it drew, or still draws, of the evidence.

    Returns:
        The figures' names and captions.
    """
    judged = [name for name in FIGURES if name not in RECORDED]
    drawn = replace(report, evidence=report.evidence.drawn)
    names = (
        other.submit(draw_some, drawn, folder, judged).result()
        if other
        else draw_some(report, folder, judged)
    )
    names += recorded.result() if recorded else draw_some(report.evidence, folder, RECORDED)
    return [{"name": name, "caption": _caption(name, report)} for name in FIGURES if name in names]


def draw_some(
    shown: RunEvidence | ValidationReport, folder: Path, names: Sequence[str]
) -> list[str]:
    """Draw and write those of some figures that there is data for; return their names."""
    from matplotlib import rc_context  # noqa: PLC0415 - only where figures are drawn

    from tacauchy_rig.core.plot_style import STYLE, save_figure  # noqa: PLC0415

    drawers = load_drawers()
    drawn = [name for name in names if FIGURES[name](shown)]
    folder.mkdir(parents=True, exist_ok=True)
    with rc_context(STYLE):
        for name in drawn:
            save_figure(drawers[name](shown), folder, name)
    return drawn


def load_drawers() -> dict[str, Callable[[Any], Figure]]:
    """Load what draws, which takes as long as to read a run, and return it by figure."""
    from reports.figures.force_and_depth import draw_force_depth, draw_time_curves  # noqa: PLC0415
    from reports.figures.images_and_scores import draw_images, draw_matrices, draw_scores  # noqa: PLC0415

    return {
        "images": draw_images,
        "scores": draw_scores,
        "wrong-force": draw_matrices,
        "time": draw_time_curves,
        "force-depth": draw_force_depth,
    }


def _caption(name: str, report: ValidationReport) -> str:
    return prose(
        "reports",
        "templates/captions.txt.jinja",
        name.replace("-", "_"),
        camera=report.evidence.camera,
        linear=f"{LINEAR_LEVELS:g}",
    )
