"""The page's figure: the six forces by the paper's model and ours, and scores over no contact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes

from sim.studies.paper.as_configured import (
    AS_CONFIGURED,
    BALANCED,
    FAST,
    FORCES_N,
    THIN,
    ModelPresses,
)
from sim.studies.paper.claims import claims
from sim.studies.paper.kept_reports import KeptReport
from tacauchy_rig.core.figure_style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PAGE_IN,
    SKY,
    STYLE,
    new_figure,
    save_figure,
)

NAME = "paper"
_HEIGHT_IN = 2.6
_LOOKS = {
    AS_CONFIGURED: (ORANGE, "o-"),
    THIN: (SKY, "s-"),
    FAST: (GREEN, "^-"),
    BALANCED: (BLUE, "v-"),
}
# Everything that a full frame of a press scores lies above this.
_SSIM_FROM = 0.9


def draw_paper(
    presses: Mapping[str, ModelPresses],
    reports: Sequence[KeptReport],
    folder: Path,
    *,
    page_folder: Path | None = None,
) -> list[Path]:
    """Draw depth and sigma n at the six forces, and SSIM of the paper beside no contact at all.

    Raises:
        RecordError: The files cannot be written.
    """
    with mpl.rc_context(STYLE):
        figure = new_figure(PAGE_IN, _HEIGHT_IN, marks=())
        depth, sigma, scores = figure.subplots(1, 3, width_ratios=(1.2, 1.2, 1.0))
        for name, model in presses.items():
            colour, mark = _LOOKS[name]
            looks = {"color": colour, "markersize": 3, "label": name}
            depths = [each.depth_m * 1e3 for each in model.at_forces]
            missed = [100.0 * each.sigma_off for each in model.at_forces]
            depth.plot(FORCES_N, depths, mark, **looks)
            sigma.plot(FORCES_N, missed, mark, **looks)
        depth.set(xlabel="$F_z$ [N]", ylabel="depth below first touch [mm]")
        sigma.set(xlabel="$F_z$ [N]", ylabel=r"$\sigma n$ off the contact force [%]")
        for axes in (depth, sigma):
            axes.set_ylim(bottom=0.0)
        figure.legend(*depth.get_legend_handles_labels(), loc="outside lower left", ncols=2)
        _draw_scores(scores, reports)
        return save_figure(figure, folder, NAME, page_folder=page_folder)


def _draw_scores(axes: Axes, reports: Sequence[KeptReport]) -> None:
    paper = claims()["scores.ssim"].value
    bars = [("the paper's:\nGelSight Mini, real", paper, ORANGE)]
    for report in reports:
        kind = "emulated" if report.emulated else "real"
        who = f"{report.name}, {kind}"
        bars.append((f"no contact:\n{who}", report.no_contact["ssim"], GREY))
        if report.ours:
            bars.append((f"ours:\n{who}", report.ours["ssim"], BLUE))
    names, values, colours = zip(*reversed(bars), strict=True)
    axes.barh(range(len(bars)), values, color=colours, height=0.6)
    axes.set_yticks(range(len(bars)), names, fontsize=5.5)
    axes.axvline(paper, color=ORANGE, linewidth=0.6)
    axes.set(xlim=(_SSIM_FROM, 1.0), xlabel="SSIM of the full frame")
