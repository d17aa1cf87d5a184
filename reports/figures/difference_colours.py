"""Differences of luminance between simulated and real images, and their colours."""

from collections.abc import Iterable

import matplotlib as mpl
import numpy as np
from matplotlib.colors import AsinhNorm

from reports.evidence.evidence_types import TrialEvidence, TrialImages
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.image_codec import to_grey

LEAST_LIMIT = 5.0  # [grey level]: differences below it are faint even at the end of the scale
LINEAR_LEVELS = 2.0
"""To which the scale of differences is linear, so that what is faint shows beside the largest."""
DIFFERENCE_COLORS = "PuOr_r"


def luminance_difference(trial: TrialEvidence) -> FloatArray | None:
    """Return simulated minus real luminance, shape [height, width] [grey level]."""
    if trial.images is None or trial.simulated_image is None:
        return None
    return luminance_error(trial.images, trial.simulated_image)


def luminance_error(images: TrialImages, simulated: ImageArray) -> FloatArray:
    """Return simulated minus camera luminance, shape [height, width] [grey level]."""
    return to_grey(simulated).astype(np.float64) - to_grey(images.real).astype(np.float64)


def difference_scale(differences: Iterable[FloatArray | None]) -> AsinhNorm:
    """Return the symmetric scale of colours for all of them [grey level]; nothing clips."""
    largest = [float(np.ceil(np.abs(d).max())) for d in differences if d is not None]
    limit = max([LEAST_LIMIT, *largest])
    return AsinhNorm(linear_width=LINEAR_LEVELS, vmin=-limit, vmax=limit)


def color_difference(difference: FloatArray, scale: AsinhNorm) -> ImageArray:
    """Map differences [grey level] to a diverging colour map, white at zero."""
    colors = mpl.colormaps[DIFFERENCE_COLORS](scale(difference))
    return np.rint(255.0 * np.asarray(colors)[..., :3]).astype(np.uint8)
