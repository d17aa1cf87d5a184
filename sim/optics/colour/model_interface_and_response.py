"""What every model of colours provides, and the radiometric response of a camera.

Below the knee of the response a grey level is a unit of light. Above it an exponential shoulder
never reaches the end of the range. A knee at that end is a camera that clips.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from tacauchy_rig.core.arrays import Float32Array, RealArray

if TYPE_CHECKING:  # they bring Warp, which the reader of a sensor's file has no use for
    from sim.optics.pixels.pixel_blocks import PixelBlocks

BRIGHTEST = 255.0
INDENTATION_UNIT_M, CREASE_UNIT_M = 1e-3, 1e-4
_CLOSEST = 0.4  # to the end of the range that a level tells of [grey levels]


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """Light to grey levels and back."""

    knee: float = BRIGHTEST  # where compression begins [grey levels]; 255 is none

    @property
    def bends(self) -> bool:
        """Whether there is a shoulder."""
        return self.knee < BRIGHTEST

    def levels(self, light: RealArray) -> RealArray:
        """Return what the camera shows of light, both in grey levels, same shape."""
        if not self.bends:
            return light
        shown, room = light.copy(), BRIGHTEST - self.knee
        bent = np.nonzero(light > self.knee)  # few pixels are so bright
        shown[bent] = self.knee - room * np.expm1((self.knee - light[bent]) / room)
        return shown

    def light(self, levels: RealArray) -> RealArray:
        """Return the light that shows as these levels, same shape."""
        if not self.bends:
            return levels
        room = BRIGHTEST - self.knee
        over = np.clip(levels - self.knee, 0.0, room - min(_CLOSEST, 0.5 * room))
        return np.asarray(np.minimum(levels, self.knee) - room * np.log1p(-over / room))

    def slope(self, levels: RealArray) -> RealArray:
        """Return grey levels per unit of light where the camera shows these levels, same shape."""
        if not self.bends:
            return np.ones_like(levels)
        room = BRIGHTEST - self.knee
        over = np.maximum(levels - self.knee, 0.0)
        return np.asarray(np.maximum(1.0 - over / room, _CLOSEST / room))


LINEAR = Response()


SampleColours = Callable[[Float32Array, Float32Array], RealArray]
"""From the samples' tilt along columns and rows, dz/dx / sqrt(1 + |grad z|^2), shape
[2, rows, columns], and indentation [m], shape [rows, columns], to the change of light of red,
green and blue [grey levels], shape [3, rows, columns]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelColours:
    """What is drawn of a model over a no-contact frame: a Warp kernel, or a NumPy function."""

    light: Float32Array  # of the no-contact frame [grey levels], shape [3, height, width]
    response: Response = LINEAR
    # What a lamp's colour is multiplied by where it is hidden, shape like ``light``; None is 1
    gain: RealArray | None = None
    kernel: Any = None  # from tilts and indentations of samples to pixels' mean change of light
    inputs: Sequence[Any] = ()  # of the kernel, but for samples
    function: SampleColours | None = None  # in place of a kernel


class ColourModel(Protocol):
    """Colours of a surface, whatever draws them."""

    @property
    def provenance(self) -> Mapping[str, object]:
        """Where the model comes from, as JSON values with units in the keys."""

    def over(self, frame: Float32Array, layout: PixelBlocks) -> PixelColours:
        """Make it ready for a no-contact frame [grey levels], shape [3, height, width]."""
