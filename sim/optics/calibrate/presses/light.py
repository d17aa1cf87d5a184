"""Light of a frame against the no-contact frame's: a plane over the image for each channel.

Automatic white balance and exposure change from frame to frame, and light from the room comes from
one side: level and gradient are estimated where the gel is not touched, and taken off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray

TERM_COUNT = 3
_ROUNDS = 3
_OUTLIER_LEVELS = 10.0


def no_light() -> FloatArray:
    """Return the coefficients of a frame with the no-contact frame's light, shape [3, 3]."""
    return np.zeros((TERM_COUNT, 3))


def light_at(light: FloatArray, position: FloatArray) -> FloatArray:
    """Evaluate the plane.

    Args:
        light: Level, change from the middle to the right and to the bottom border of red, green,
            blue [grey levels], shape [3, 3].
        position: Normalised pixel position in [-1, 1], shape [2, n].

    Returns:
        Shape [n, 3].
    """
    return np.asarray(light[0] + position.T @ light[1:])


def fit_light(
    change: FloatArray,
    exposed: NDArray[np.bool_],
    position: FloatArray,
    *,
    level_only: bool = False,
) -> FloatArray:
    """Fit the plane to differences from the no-contact frame, bounding what outliers can do.

    Args:
        change: Frame minus what it would be in the no-contact frame's light, shape [n, 3].
        exposed: False where the pixel is too bright or too dark to tell, shape [n, 3].
        position: Normalised pixel position, shape [2, n].
        level_only: Fit no gradient, for pixels that see only a part of the image.

    Returns:
        Coefficients as ``light_at`` wants them, shape [3, 3].
    """
    terms = np.column_stack([np.ones(position.shape[1]), position.T * (not level_only)])
    light = no_light()
    for channel in range(light.shape[1]):
        weight = exposed[:, channel].astype(np.float64)
        for _ in range(_ROUNDS):
            weighted = (terms * weight[:, None]).T
            normal, load = weighted @ terms, weighted @ change[:, channel]
            light[:, channel] = np.linalg.lstsq(normal, load, rcond=None)[0]
            off = change[:, channel] - terms @ light[:, channel]
            weight = exposed[:, channel] / (1.0 + (off / _OUTLIER_LEVELS) ** 2)
    return light
