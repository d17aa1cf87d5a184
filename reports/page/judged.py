"""``judged.json`` and ``judged.html``: simulators side by side, from one value."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl

from reports.comparison.judged_scores import CONTACT, FRAME, MECHANICS, Score
from reports.comparison.judging import JudgedSimulator, Judgement, contests
from reports.figures.judged import draw_judged
from reports.page.html import page_environment, png_data
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.figure_style import STYLE, save_figure
from tacauchy_rig.core.store.codec import to_plain
from tacauchy_rig.core.versions import versions

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
    try:
        paths.json.write_text(text + "\n", encoding="utf-8")
        shown = html.render(judged=content, figure=png_data(paths.figure))
        paths.html.write_text(shown, encoding="utf-8")
    except OSError as error:
        raise RecordError(
            f"{folder}: cannot be written: {error.strerror or error}",
            remedy="give --out another folder",
        ) from error
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
            | {
                "score": _score(each.score),
                "is_lost": each.is_lost,
                "is_clear": each.is_clear,
            }
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
