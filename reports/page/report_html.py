"""``report.html``: one file without any link, made from ``summary.json`` and the figures."""

import base64
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import matplotlib as mpl
import numpy as np
from jinja2 import Environment

from reports.comparison import report_criteria as criteria
from reports.comparison.result_types import badness
from reports.comparison.verdict_sentences import MINUS
from reports.evidence.evidence_types import IntermediateState, RunEvidence, TrialEvidence, camera_of
from reports.figures.trial_axis import MAX_COLUMNS, shown, spread
from reports.scores.image_metrics import Metric, SkillStatus
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.image_codec import data_url, encode_jpeg
from tacauchy_rig.core.markdown_page import environment_of

MOST_PRESSES = 12
"""That have a slider; with eight states each the page grows by two megabytes at most."""
DENT_COLORS, PRESSURE_COLORS = "cividis", "inferno"
_QUALITY = 75
_STOPS = 9


def passing_states(
    evidence: RunEvidence,
) -> tuple[dict[int, list[dict[str, Any]]], dict[int, list[dict[str, str]]]]:
    """Return for each trial numbers and pictures of its states, the smallest force first.

    Pictures are data URLs by kind. ``dent`` is in proportion, ``pressure`` by its square root, so
    that a rim's peak does not take all colours; both up to the largest of the trial.
    """
    some = shown([trial for trial in evidence.trials if trial.intermediate], most=MOST_PRESSES)
    trials = sorted(some, key=lambda trial: trial.index)
    return (
        {trial.index: [_numbers(state) for state in trial.intermediate] for trial in trials},
        {trial.index: list(_pictures(trial)) for trial in trials},
    )


def gradient(colors: str) -> str:
    """Return a colour map as what CSS calls a gradient, from zero on the left."""
    stops = map(mpl.colors.to_hex, mpl.colormaps[colors](np.linspace(0.0, 1.0, _STOPS)))
    return f"linear-gradient(to right, {', '.join(stops)})"


def _numbers(state: IntermediateState) -> dict[str, Any]:
    frame = state.frame
    return {
        "force_n": state.force_n,
        "depth_m": state.depth_m,
        "dent_largest_m": float(state.dent_m.max()),
        "pressure_largest_pa": float(state.pressure_pa.max()),
        "frame_force_n": None if frame is None else frame.force_n,
        "frame_depth_m": None if frame is None else frame.depth_m,
    }


def _pictures(trial: TrialEvidence) -> Iterator[dict[str, str]]:
    deepest = max(float(state.dent_m.max()) for state in trial.intermediate)
    highest = max(float(state.pressure_pa.max()) for state in trial.intermediate)
    for state in trial.intermediate:
        height, width = state.image.shape[:2]
        images = {
            "simulated": state.image,
            "dent": _coloured(state.dent_m, deepest, DENT_COLORS),
            "pressure": _coloured(np.sqrt(state.pressure_pa), np.sqrt(highest), PRESSURE_COLORS),
        }
        if state.frame is not None:
            real = cv2.resize(state.frame.image, (width, height), interpolation=cv2.INTER_AREA)
            images["real"] = np.asarray(real, dtype=np.uint8)
        jpegs = {kind: encode_jpeg(image, quality=_QUALITY) for kind, image in images.items()}
        yield {kind: data_url(jpeg) for kind, jpeg in jpegs.items()}


def _coloured(values: FloatArray, highest: float, colors: str) -> ImageArray:
    shares = np.clip(values / max(highest, 1e-300), 0.0, 1.0)
    return np.asarray(mpl.colormaps[colors](shares, bytes=True))[..., :3]


ABSENT = "\u2013"
KEY_UNITS = {"hz": "Hz", "n": "N", "pa": "Pa"} | {
    unit: unit for unit in ("s", "ms", "m", "mm", "px")
}
NO_SKILL = {
    SkillStatus.ABOVE_CEILING: ">1",
    SkillStatus.NOT_DISCRIMINATING: "n.d.",
    SkillStatus.NO_CEILING: "n.c.",
}


def render_html(
    summary: Mapping[str, Any],
    *,
    figures: Path,
    images: Path,
    intermediate: Mapping[int, Sequence[Mapping[str, str]]],
) -> str:
    """Render ``summary.json`` with the PNG files of two folders, which are put into the page.

    ``intermediate`` holds, of some trials, the pictures of each state as data URLs, by kind.
    """
    script, environment = report_script(), page_environment(summary)
    environment.globals |= {
        "figure_data": lambda name: data_url((figures / f"{name}.png").read_bytes()),
        "image_data": lambda name: data_url((images / name).read_bytes()),
        "intermediate": intermediate,
        "script": script,
        "script_hash": base64.b64encode(sha256(script.encode()).digest()).decode(),
        "dent_bar": gradient(DENT_COLORS),
        "pressure_bar": gradient(PRESSURE_COLORS),
        "ordered": (trials := ordered(summary["trials"])),
        "some": spread(trials, MAX_COLUMNS),
        "groups": (groups := criterion_groups(summary)),
        "counting": {group["name"]: group for group in groups if group["counts"]},
    }
    for write in (at, mean_at, skill_of, worst_prediction):
        environment.filters[write.__name__] = write
    return environment.get_template("report.html.jinja").render(summary=summary)


def report_script() -> str:
    """Return the one script of a report."""
    return files("reports").joinpath("templates/intermediate.js").read_text("utf-8")


def page_environment(summary: Mapping[str, Any]) -> Environment:
    """Return what pages are rendered by: number formats, scores, and whose the images are."""
    environment = environment_of("reports")
    environment.filters |= {
        write.__name__: write for write in (number, signed, plain, words, named, interval, unjudged)
    }
    environment.globals |= {
        "metrics": {metric.value: metric for metric in Metric},
        "camera": camera_of(summary["provenance"], simulated=summary["simulated"]),
    }
    return environment


def number(value: float | None, digits: int = 3, factor: float = 1.0, unit: str = "") -> str:
    """Format with a fixed number of decimals and a true minus sign; a dash where unknown."""
    if value is None:
        return ABSENT
    text = f"{value * factor:.{digits}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return f"{text.replace('-', MINUS)}{unit}"


def signed(value: float | None, digits: int = 3, factor: float = 1.0, unit: str = "") -> str:
    """Format like ``number`` with the sign always shown."""
    text = number(value, digits, factor, unit)
    return text if value is None or text.startswith(MINUS) else f"+{text}"


def plain(value: object) -> str:
    """Show a JSON value in a table cell: numbers short, tables as words with their values."""
    if value is None:
        return ABSENT
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}".replace("-", MINUS)
    if isinstance(value, Mapping):
        return "; ".join(f"{words(key)} {plain(item)}" for key, item in value.items()) or "none"
    if isinstance(value, list):
        return ", ".join(map(plain, value)) or "none"
    return str(value)


def named(trial: Mapping[str, Any]) -> str:
    """Return a press's force; the number of one whose force nobody stated or measured."""
    force = trial["force_target_n"]
    return f"trial {trial['index']}" if force is None else f"{number(force, 2)}\N{NO-BREAK SPACE}N"


def interval(found: Mapping[str, Any], digits: int = 3, factor: float = 1.0) -> str:
    """Write a mean with the half-width of its 95 % interval after a plus-minus sign."""
    text = number(found["mean"], digits, factor)
    if found["low"] is None:
        return text
    return f"{text} ± {number(0.5 * (found['high'] - found['low']), digits, factor)}"


def unjudged(verdict: str) -> str:
    """Return a verdict without its outcome, which the badge beside it says."""
    text = verdict.removeprefix("Passed: ").removeprefix("Not passed: ")
    return text[:1].upper() + text[1:]


def ordered(trials: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return presses in the order of their forces; those without one come last."""
    return sorted(trials, key=lambda t: (t["force_target_n"] is None, t["force_target_n"] or 0.0))


def at(trial: Mapping[str, Any], place: str) -> Any:
    """Return what lies at a place such as ``floors.no_contact.ssim``; None where a part lacks."""
    found: Any = trial
    for name in place.split("."):
        found = found.get(name) if isinstance(found, Mapping) else None
    return found


def mean_at(trials: Sequence[Mapping[str, Any]], place: str) -> float | None:
    """Return the mean over the presses that have a number there."""
    known = [value for trial in trials if (value := at(trial, place)) is not None]
    return sum(known) / len(known) if known else None


def skill_of(trials: Sequence[Mapping[str, Any]], metric: str) -> str:
    """Write the mean skill of a score, and of how many presses it cannot be stated."""
    skills = [skill for trial in trials if (skill := at(trial, f"skill.{metric}"))]
    known = [skill["value"] for skill in skills if skill["status"] == SkillStatus.STATED]
    parts = [f"{number(sum(known) / len(known), 2)} ({len(known)})"] if known else []
    counts = Counter(skill["status"] for skill in skills)
    parts += [f"{text} ({counts[status]})" for status, text in NO_SKILL.items() if counts[status]]
    return ", ".join(parts) or ABSENT


def worst_prediction(trials: Sequence[Mapping[str, Any]]) -> str:
    """Write the error of the press that is off most for its uncertainty, in per cent."""
    known = [t["force"] for t in trials if t["force"]["prediction_error_n"] is not None]
    known = [force for force in known if force["combined"] and force["prediction_error_relative"]]
    if not known:
        return ABSENT
    worst = max(known, key=lambda f: abs(f["prediction_error_n"]) / f["combined"]["value_n"])
    percent = 100.0 * worst["prediction_error_relative"] / worst["prediction_error_n"]
    off, half_width = worst["prediction_error_n"], worst["combined"]["expanded_n"]
    return f"{number(off, 1, percent)} ± {number(half_width, 1, percent)}"


def is_unknown(criterion: Mapping[str, Any], summary: Mapping[str, Any]) -> bool:
    """Return whether a criterion rests on what an imported run does not tell."""
    return summary["imported"] and not criterion["passed"] and criterion["measured"] is None


_ATTEMPT = re.compile(r"trials/\d+/attempt-\d+/")
_NUMBER = re.compile(r"\d[\d.e-]*")


def criterion_groups(summary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return every criterion once, over the run or over its presses, with grouped advice.

    Of a press that did not end only its end is told; the rest is counted as left out.
    """
    names = [c["name"] for each in (summary, *summary["trials"]) for c in each["criteria"]]
    found: dict[str, list[tuple[str, Mapping[str, Any]]]] = {}
    for criterion in summary["criteria"]:
        found.setdefault(criterion["name"], []).append(("the run", criterion))
    for trial in ordered(summary["trials"]):
        ended = trial["outcome"] in ("passed", "imported")
        for criterion in trial["criteria"]:
            if ended or criterion["name"] == "press":
                found.setdefault(criterion["name"], []).append((named(trial), criterion))
    return [
        {"left_out": names.count(name) - len(cases), **_group(name, cases, summary)}
        for name, cases in found.items()
    ]


def _group(
    name: str, cases: Sequence[tuple[str, Mapping[str, Any]]], summary: Mapping[str, Any]
) -> dict[str, Any]:
    known = [(where, c) for where, c in cases if not is_unknown(c, summary)]
    missed = [(where, c) for where, c in known if not c["passed"]]
    worst = max(
        (c for _, c in missed or known or cases), key=lambda c: badness(c["name"], c["measured"])
    )
    advice: dict[str, dict[str, Any]] = {}
    for where, criterion in missed:
        alike = _NUMBER.sub("", criterion["remedy"])  # numbers are of the press
        group = advice.setdefault(alike, {"text": criterion["remedy"], "where": []})
        group["where"].append(where)
    limits = {_ATTEMPT.sub("", c["limit"]) for _, c in cases}
    return {
        "name": name,
        "worst": worst,
        "limit": _ATTEMPT.sub("", worst["limit"]) + " (of that press)" * (len(limits) > 1),
        "met": len(known) - len(missed),
        "known": len(known),
        "count": len(cases),
        "advice": list(advice.values()),
        "counts": name in (*criteria.COUNTS, *criteria.COUNTS_OF_RUN),
    }


def words(name: str) -> str:
    """Turn a key such as ``force_rate_hz`` into words with its unit, "force rate (Hz)"."""
    if name.endswith("_m_px"):
        return f"{words(name.removesuffix('_m_px'))} (m/px)"
    parts = name.replace("-", "_").split("_")
    for index, part in enumerate(parts[1:], start=1):
        if part in KEY_UNITS:
            parts = [*parts[:index], *parts[index + 1 :], f"({KEY_UNITS[part]})"]
            break
    return " ".join(parts)
