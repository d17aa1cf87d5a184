"""What a frame's pixels tell of light, and how it differs from the no-contact frame's.

At the ends of a camera's range a pixel says only that it was at least so bright. Automatic white
balance and exposure change from frame to frame, and light from the room comes from one side: level
and gradient over the image are estimated where the gel is not touched, and taken off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.optics.colour.response import LINEAR, Response
from tacauchy_rig.core.arrays import BoolArray, FloatArray, ImageArray

_LIGHT_ROUNDS = 3
_LIGHT_OUTLIER_LEVELS = 10.0
_DARKEST, _BRIGHTEST = 1, 254
_TELLING = 251  # of a compressed range the last levels tell less than their noise


def light_at(light: FloatArray, position: FloatArray) -> FloatArray:
    """Evaluate the plane, shape [n, 3].

    Args:
        light: Level, change from the middle to the right and to the bottom border of red, green,
            blue [grey levels], shape [3, 3].
        position: Normalised pixel position in [-1, 1], shape [2, n].
    """
    return np.asarray(light[0] + position.T @ light[1:])


def fit_light(
    change: FloatArray, exposed: BoolArray, position: FloatArray, *, level_only: bool
) -> FloatArray:
    """Fit the plane of ``light_at`` to differences from the no-contact frame, bounding outliers.

    Args:
        change: Frame minus what it would be in the no-contact frame's light, shape [n, 3].
        exposed: False where the pixel is too bright or too dark to tell, shape [n, 3].
        position: Normalised pixel position, shape [2, n].
        level_only: Fit no gradient, for pixels that see only a part of the image.
    """
    terms = np.column_stack([np.ones(position.shape[1]), position.T * (not level_only)])
    light = []
    for seen, told in zip(change.T, exposed.T, strict=True):
        weight = told.astype(np.float64)
        for _ in range(_LIGHT_ROUNDS):
            weighted = (terms * weight[:, None]).T
            plane = np.linalg.lstsq(weighted @ terms, weighted @ seen, rcond=None)[0]
            weight = told / (1.0 + ((seen - terms @ plane) / _LIGHT_OUTLIER_LEVELS) ** 2)
        light.append(plane)
    return np.stack(light, axis=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenChange:
    """How pixels differ from the no-contact frame.

    Attributes:
        change: Red, green, blue [grey levels], shape [n, 3].
        over: True where the pixel is at the top of its range: the change is at least this.
        under: True where it is at the bottom: the change is at most this.
    """

    change: FloatArray
    over: BoolArray
    under: BoolArray

    @property
    def exposed(self) -> BoolArray:
        """True where the change is known, shape [n, 3]."""
        return ~(self.over | self.under)

    def misfit(self, predicted: FloatArray) -> FloatArray:
        """Return predicted minus seen change, zero where a clipped pixel allows it, [n, 3]."""
        off = predicted - self.change
        off = np.where(self.over, np.minimum(off, 0.0), off)
        return np.where(self.under, np.maximum(off, 0.0), off)

    def completed(self, predicted: FloatArray) -> FloatArray:
        """Return the change, as predicted where a clipped pixel allows it, shape [n, 3]."""
        return predicted - self.misfit(predicted)


def seen_change(
    levels: ImageArray, expected: FloatArray, response: Response = LINEAR
) -> SeenChange:
    """Compare the light of pixels with what it would be without contact; both of shape [n, 3]."""
    top = _TELLING if response.bends else _BRIGHTEST
    light = response.light(np.minimum(levels, top).astype(np.float64))
    return SeenChange(
        change=light - response.light(expected), over=levels >= top, under=levels <= _DARKEST
    )


def light_weights(levels: ImageArray, response: Response) -> FloatArray:
    """Return grey levels per unit of light of pixels, shape [n, 3]."""
    return np.asarray(response.slope(np.minimum(levels, _TELLING).astype(np.float64)))


def exposed(levels: ImageArray) -> BoolArray:
    """Return True where pixels are inside the camera's range, same shape."""
    return (levels > _DARKEST) & (levels < _BRIGHTEST)
