"""How a camera bends at the top of its range: light above a knee is compressed, not cut off.

Below the knee a grey level is a unit of light. Above it each further unit counts for less, so that
the end of the range is approached and never reached (an exponential shoulder, as films and most
cameras' tone curves have one). A knee at the end of the range is a camera that simply clips.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacauchy_rig.core.arrays import RealArray

BRIGHTEST = 255.0
_CLOSEST = 0.4  # to the end of the range that a level tells of [grey levels]


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """Light to grey levels and back.

    Attributes:
        knee: Where compression begins [grey levels]; 255 is none.
    """

    knee: float = BRIGHTEST

    @property
    def bends(self) -> bool:
        """Whether there is a shoulder."""
        return self.knee < BRIGHTEST

    def levels(self, light: RealArray) -> RealArray:
        """Return what the camera shows of light, both in grey levels, same shape."""
        if not self.bends:
            return light
        kind = light.dtype.type
        room, knee = kind(BRIGHTEST - self.knee), kind(self.knee)
        shown = light.copy()
        bent = np.nonzero(light > knee)  # few pixels are so bright
        shown[bent] = knee - room * np.expm1((knee - light[bent]) / room)
        return shown

    def light(self, levels: RealArray) -> RealArray:
        """Return the light that shows as these levels, same shape."""
        if not self.bends:
            return levels
        kind = levels.dtype.type
        room, knee = kind(BRIGHTEST - self.knee), kind(self.knee)
        over = np.clip(levels - knee, kind(0.0), room - kind(min(_CLOSEST, 0.5 * float(room))))
        return np.asarray(np.minimum(levels, knee) - room * np.log1p(-over / room))

    def slope(self, levels: RealArray) -> RealArray:
        """Return grey levels per unit of light where the camera shows these levels, same shape."""
        kind = levels.dtype.type
        if not self.bends:
            return np.ones_like(levels)
        room = kind(BRIGHTEST - self.knee)
        over = np.maximum(levels - kind(self.knee), kind(0.0))
        return np.asarray(np.maximum(kind(1.0) - over / room, kind(_CLOSEST) / room))


LINEAR = Response()
