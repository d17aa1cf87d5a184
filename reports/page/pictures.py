"""Scored images as lossless PNG files: real, simulated, and their difference in colour."""

from __future__ import annotations

from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np

from reports.arrays import ColorImage, FloatArray
from reports.evidence.evidence import RunEvidence
from reports.figures.images import DIFFERENCE_COLORS, difference_limit, luminance_difference
from tacauchy_rig.errors import RecordError


def write_pictures(evidence: RunEvidence, folder: Path) -> dict[int, dict[str, str]]:
    """Write the images of every trial.

    Returns:
        Per trial, file names by kind: ``real``, ``reference``, ``simulated``, ``difference``.

    Raises:
        RecordError: A file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    limit = difference_limit(evidence)
    names: dict[int, dict[str, str]] = {}
    for trial in evidence.trials:
        difference = luminance_difference(trial)
        images = {
            "real": None if trial.images is None else trial.images.real,
            "reference": None if trial.images is None else trial.images.reference,
            "simulated": trial.simulated_image,
            "difference": None if difference is None else color_difference(difference, limit),
        }
        for kind, image in images.items():
            if image is not None:
                name = f"{trial.index:02d}-{kind}.png"
                _write_png(folder / name, image)
                names.setdefault(trial.index, {})[kind] = name
    return names


def color_difference(difference: FloatArray, limit: float) -> ColorImage:
    """Map -limit..limit [grey level] to a diverging colour map, white at zero."""
    colors = mpl.colormaps[DIFFERENCE_COLORS](0.5 + 0.5 * difference / limit)
    return np.rint(255.0 * np.asarray(colors)[..., :3]).astype(np.uint8)


def _write_png(path: Path, image: ColorImage) -> None:
    done, data = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    if not done:
        raise RecordError(f"{path.name}: the image could not be encoded as PNG")
    path.write_bytes(data.tobytes())
