"""Presses on their way to their forces: the numbers and pictures behind the page's sliders."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from typing import Any

import cv2
import matplotlib as mpl
import numpy as np

from reports.evidence.evidence import PassingState, RunEvidence, TrialEvidence
from reports.figures.trials import shown
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.rgb import encode_jpeg

MOST_PRESSES = 12
"""That have a slider; with eight states each the page grows by two megabytes at most."""
DENT_COLORS, PRESSURE_COLORS = "cividis", "inferno"
_QUALITY = 75
_STOPS = 9


def passing_numbers(evidence: RunEvidence) -> dict[int, list[dict[str, Any]]]:
    """Return for each trial the numbers of its states, the smallest force first."""
    return {trial.index: [_numbers(state) for state in trial.passing] for trial in _told(evidence)}


def passing_pictures(evidence: RunEvidence) -> dict[int, list[dict[str, str]]]:
    """Return for each trial the pictures of its states as data URLs, by kind.

    ``dent`` is in proportion, ``pressure`` by its square root, so that a rim's peak does not take
    all colours; both up to the largest of the trial.
    """
    return {trial.index: list(_pictures(trial)) for trial in _told(evidence)}


def gradient(colors: str) -> str:
    """Return a colour map as what CSS calls a gradient, from zero on the left."""
    stops = mpl.colormaps[colors](np.linspace(0.0, 1.0, _STOPS))
    return f"linear-gradient(to right, {', '.join(mpl.colors.to_hex(stop) for stop in stops)})"


def _told(evidence: RunEvidence) -> list[TrialEvidence]:
    told = shown([trial for trial in evidence.trials if trial.passing], most=MOST_PRESSES)
    return sorted(told, key=lambda trial: trial.index)


def _numbers(state: PassingState) -> dict[str, Any]:
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
    deepest = max(float(state.dent_m.max()) for state in trial.passing)
    highest = max(float(state.pressure_pa.max()) for state in trial.passing)
    for state in trial.passing:
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
