"""``report.html``: one file without any link, made from ``summary.json`` and the figures."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import matplotlib as mpl
import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from reports.comparison.sentences import MINUS
from reports.evidence.evidence import IntermediateState, RunEvidence, TrialEvidence, camera_of
from reports.figures.trials import shown
from reports.scores.metrics import Metric
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.rgb import encode_jpeg

MOST_PRESSES = 12
"""That have a slider; with eight states each the page grows by two megabytes at most."""
DENT_COLORS, PRESSURE_COLORS = "cividis", "inferno"
_QUALITY = 75
_STOPS = 9


def intermediate_numbers(evidence: RunEvidence) -> dict[int, list[dict[str, Any]]]:
    """Return for each trial the numbers of its states, the smallest force first."""
    return {
        trial.index: [_numbers(state) for state in trial.intermediate]
        for trial in _shown_trials(evidence)
    }


def intermediate_pictures(evidence: RunEvidence) -> dict[int, list[dict[str, str]]]:
    """Return for each trial the pictures of its states as data URLs, by kind.

    ``dent`` is in proportion, ``pressure`` by its square root, so that a rim's peak does not take
    all colours; both up to the largest of the trial.
    """
    return {trial.index: list(_pictures(trial)) for trial in _shown_trials(evidence)}


def gradient(colors: str) -> str:
    """Return a colour map as what CSS calls a gradient, from zero on the left."""
    stops = mpl.colormaps[colors](np.linspace(0.0, 1.0, _STOPS))
    return f"linear-gradient(to right, {', '.join(mpl.colors.to_hex(stop) for stop in stops)})"


def _shown_trials(evidence: RunEvidence) -> list[TrialEvidence]:
    some = shown([trial for trial in evidence.trials if trial.intermediate], most=MOST_PRESSES)
    return sorted(some, key=lambda trial: trial.index)


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
        yield {kind: _data(image) for kind, image in images.items()}


def _coloured(values: FloatArray, highest: float, colors: str) -> ImageArray:
    shares = np.clip(values / max(highest, 1e-300), 0.0, 1.0)
    return np.asarray(mpl.colormaps[colors](shares, bytes=True))[..., :3]


def _data(image: ImageArray) -> str:
    packed = base64.b64encode(encode_jpeg(image, quality=_QUALITY)).decode()
    return f"data:image/jpeg;base64,{packed}"


ABSENT = "\u2013"
KEY_UNITS = {
    "hz": "Hz",
    "ms": "ms",
    "s": "s",
    "n": "N",
    "m": "m",
    "mm": "mm",
    "pa": "Pa",
    "px": "px",
}


def render_html(
    summary: Mapping[str, Any],
    *,
    figures: Path,
    images: Path,
    intermediate: Mapping[int, Sequence[Mapping[str, str]]],
) -> str:
    """Render the page.

    Args:
        summary: The value of ``summary.json``.
        figures: Folder of the figures' PNG files, which are put into the page.
        images: Folder of the trials' images, which are put into the page.
        intermediate: Of some trials, the pictures of each state as data URLs, by kind.
    """
    script = report_script()
    environment = page_environment(summary)
    environment.globals |= {
        "figure_data": lambda name: png_data(figures / f"{name}.png"),
        "image_data": lambda name: png_data(images / name),
        "intermediate": intermediate,
        "script": script,
        "script_hash": base64.b64encode(sha256(script.encode()).digest()).decode(),
        "dent_bar": gradient(DENT_COLORS),
        "pressure_bar": gradient(PRESSURE_COLORS),
    }
    return environment.get_template("report.html.jinja").render(summary=summary)


def report_script() -> str:
    """Return the one script of a report."""
    return files("reports").joinpath("templates/intermediate.js").read_text("utf-8")


def page_environment(summary: Mapping[str, Any]) -> Environment:
    """Return what pages are rendered by: number formats, scores, and whose the images are.

    Args:
        summary: Its ``provenance`` and ``simulated`` say whose.
    """
    environment = Environment(
        loader=PackageLoader("reports"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": number,
        "signed": signed,
        "plain": plain,
        "words": words,
        "named": named,
    }
    environment.globals |= {
        "metrics": {metric.value: metric for metric in Metric},
        "camera": camera_of(summary["provenance"], simulated=summary["simulated"]),
    }
    return environment


def png_data(path: Path) -> str:
    """Return a PNG file as a data URL."""
    return f"data:image/png;base64,{base64.b64encode(path.read_bytes()).decode()}"


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
    return f"trial {trial['index']}" if force is None else f"{number(force, 2)} N"


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
