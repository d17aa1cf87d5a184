"""``judged.json`` and ``judged.html``, with its figure: simulators compared with one another."""

import json
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.colors import AsinhNorm
from matplotlib.figure import Figure

from reports.comparison.simulator_comparison import (
    CONTACT,
    FRAME,
    MECHANICS,
    JudgedSimulator,
    Judgement,
    Score,
    contests,
)
from reports.evidence.evidence_types import TrialEvidence, TrialImages
from reports.figures import difference_colours as colours
from reports.figures.images_and_scores import show_framed
from reports.figures.trial_axis import force_title, shown
from reports.page.report_html import page_environment
from reports.scores.contact_scores import contact_crop, touched
from tacauchy_rig.core.image_codec import data_url
from tacauchy_rig.core.plot_style import PAGE_IN, STYLE, new_figure, save_figure
from tacauchy_rig.core.store.atomic_write import writing
from tacauchy_rig.core.store.json_codec import to_plain
from tacauchy_rig.core.versions import versions

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
    scale = _scale(trials, drawn)
    for column, trial in zip(grid.T, trials, strict=True):
        if trial.images is not None:
            column[0].set_title(force_title(trial, "$F_z$ = {} N"), fontsize=7.5, pad=3)
            _draw_column(column, trial, trial.images, drawn, scale)
    grid[0, 0].set_ylabel(f"Camera\n({evidence.camera})", fontsize=6.5)
    for k, simulator in enumerate(drawn):
        name = textwrap.fill(simulator.simulator.name, NAME_WIDTH)
        grid[1 + 2 * k, 0].set_ylabel(name, fontsize=6.5)
        grid[2 + 2 * k, 0].set_ylabel("minus camera", fontsize=6.5)
    said = f"purple −{scale.vmax:g}, orange +{scale.vmax:g} grey levels"
    linear = f"linear to {colours.LINEAR_LEVELS:g}"
    figure.supxlabel(f"Differences of luminance: {said}, {linear}", fontsize=6.5)
    return figure


def _draw_column(
    column: Sequence[Axes],
    trial: TrialEvidence,
    images: TrialImages,
    drawn: Sequence[JudgedSimulator],
    scale: AsinhNorm,
) -> None:
    crop = _crop(images)
    show_framed(column[0], images.real[crop], interpolation="nearest")
    colors = {"cmap": colours.DIFFERENCE_COLORS, "norm": scale}
    for k, simulator in enumerate(drawn):
        pair = column[1 + 2 * k], column[2 + 2 * k]
        image = simulator.image(trial.index)
        seen = (None, None) if image is None else (image, colours.luminance_error(images, image))
        for axes, each, how in zip(pair, seen, ({}, colors), strict=True):
            part = None if each is None else each[crop]
            show_framed(axes, part, interpolation="nearest", **how)
        contact = next((p.contact for p in simulator.presses if p.index == trial.index), None)
        if contact is not None:
            pair[1].set_xlabel(f"residual {contact.relative_residual:.3f}", fontsize=6, labelpad=1)


def _crop(images: TrialImages) -> tuple[slice, slice]:
    seen = touched(images)
    return (slice(None), slice(None)) if seen is None else contact_crop(seen.footprint)


def _scale(trials: Sequence[TrialEvidence], drawn: Sequence[JudgedSimulator]) -> AsinhNorm:
    """Return the colours that all differences share."""
    return colours.difference_scale(
        colours.luminance_error(t.images, image)[_crop(t.images)]
        for t in trials
        for simulator in drawn
        if t.images is not None and (image := simulator.image(t.index)) is not None
    )


SCHEMA = 1
FIGURE = "judged"
PRESSURE_TOLERANCE = 0.05
"""Of a force: pressure summed over pixels of a twentieth of a millimetre is off by less."""


class JudgedPaths:
    """Where the parts of a judgement lie."""

    def __init__(self, folder: Path) -> None:
        self.html = folder / "judged.html"
        self.json = folder / "judged.json"
        self.figure = folder / f"{FIGURE}.png"


def write_judgement(judgement: Judgement, folder: Path) -> JudgedPaths:
    """Write page, JSON and figure of a judgement into a folder.

    Raises:
        RecordError: It cannot be written.
    """
    paths = JudgedPaths(folder)
    content = judged_content(judgement)
    with mpl.rc_context(STYLE):
        save_figure(draw_judged(judgement), folder, FIGURE)
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
    html = page_environment(content).get_template("judged.html.jinja")
    with writing(folder):
        paths.json.write_text(text + "\n", encoding="utf-8")
        shown = html.render(judged=content, figure=data_url(paths.figure.read_bytes()))
        paths.html.write_text(shown, encoding="utf-8")
    return paths


def judged_content(judgement: Judgement) -> dict[str, Any]:
    """Return the value of ``judged.json``; units stand in the keys, nothing is NaN."""
    evidence, geometry = judgement.evidence, judgement.evidence.geometry
    found = contests(judgement)
    return {
        "schema": SCHEMA,
        "simulated": evidence.simulated,
        "marks": list(evidence.marks),
        "camera": evidence.camera,
        "provenance": to_plain(evidence.provenance),
        "versions": versions(),
        "image": {"width_px": geometry.width_px, "height_px": geometry.height_px},
        "trials": [t.index for t in evidence.trials],
        "pressure_tolerance": PRESSURE_TOLERANCE,
        "press_count": sum(t.images is not None for t in evidence.trials),
        "tables": {
            name: [_score(score) for score in scores]
            for name, scores in (("frame", FRAME), ("contact", CONTACT), ("mechanics", MECHANICS))
        },
        "floors": to_plain(judgement.floors),
        "ceiling": to_plain(judgement.ceiling),
        "simulators": [_simulator(each) for each in judgement.simulators],
        "contests": [
            to_plain(each)
            | {"score": _score(each.score), "is_lost": each.is_lost, "is_clear": each.is_clear}
            for each in found
        ],
    }


def _score(score: Score) -> dict[str, Any]:
    return {**to_plain(score), "heading": score.heading}


def _simulator(judged: JudgedSimulator) -> Mapping[str, Any]:
    won, of = judged.wins
    return {
        **to_plain(judged.simulator),
        "title": judged.simulator.title,
        "is_ours": judged.is_ours,
        "left_out": list(judged.outputs.left_out),
        "means": to_plain(judged.means),
        "own_press_wins": won,
        "own_press_wins_of": of,
        "presses": to_plain(judged.presses),
    }
