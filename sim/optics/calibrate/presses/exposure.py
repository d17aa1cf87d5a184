"""What a camera's pixels can tell: at the ends of its range only that it was at least so bright."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.optics.colour.response import Response

_DARKEST, _BRIGHTEST = 1, 254
_TELLING = 251  # of a compressed range the last levels tell less than their noise


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenChange:
    """How pixels differ from the no-contact frame.

    Attributes:
        change: Red, green, blue [grey levels], shape [n, 3].
        over: True where the pixel is at the top of its range: the change is at least this.
        under: True where it is at the bottom: the change is at most this.
    """

    change: FloatArray
    over: NDArray[np.bool_]
    under: NDArray[np.bool_]

    @property
    def exposed(self) -> NDArray[np.bool_]:
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


def seen_light(levels: NDArray[np.uint8], expected: FloatArray, response: Response) -> SeenChange:
    """Compare the light of pixels with what it would be without contact; both of shape [n, 3]."""
    top = _TELLING if response.bends else _BRIGHTEST
    light = response.light(np.minimum(levels, top).astype(np.float64))
    return SeenChange(
        change=light - response.light(expected), over=levels >= top, under=levels <= _DARKEST
    )


def light_weights(levels: NDArray[np.uint8], response: Response) -> FloatArray:
    """Return grey levels per unit of light of pixels, shape [n, 3]."""
    return np.asarray(response.slope(np.minimum(levels, _TELLING).astype(np.float64)))


def seen_change(levels: NDArray[np.uint8], expected: FloatArray) -> SeenChange:
    """Compare pixels with what they would be without contact; both of shape [n, 3]."""
    return SeenChange(change=levels - expected, over=levels >= _BRIGHTEST, under=levels <= _DARKEST)


def exposed(levels: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return True where pixels are inside the camera's range, same shape."""
    return (levels > _DARKEST) & (levels < _BRIGHTEST)
