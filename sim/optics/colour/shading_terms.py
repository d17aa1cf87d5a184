"""What no polynomial of slopes can say: lamps that a slope turns away from, and creases.

A lamp beside the gel lights a slope by the cosine of the angle between them, and not at all beyond
its terminator (Lambert; the near lamp's direction changes over the image). Light that the gel
scatters everywhere reaches a ridge from more sides than a groove, so that a sharp edge shows as a
bright line beside a dark one. The terms enter the photometric model linearly, with level and
gradient over the image each; they vanish on level gel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.optics.pixels.pixel_blocks import PixelBlocks
from tacauchy_rig.core.arrays import Float32Array, FloatArray, RealArray

CREASE_UNIT_M = 1e-4
MOST_LAMPS = 6
_PLACES = 3  # 1, u and v


@dataclass(frozen=True, slots=True, kw_only=True)
class NearLamp:
    """A lamp beside the gel.

    Attributes:
        azimuth_rad: Direction in which it stands, from growing columns towards growing rows [rad].
        elevation_rad: Angle of its light to the gel in the middle of the image [rad].
        distance: From the middle of the image, in halves of its width.
    """

    azimuth_rad: float
    elevation_rad: float
    distance: float

    def lit(
        self, tilt: RealArray, upright: RealArray, position: RealArray, *, softness: float
    ) -> RealArray:
        """Return the light on a tilted surface less that on a level one, shape [n].

        Args:
            tilt: Shape [2, n]; ``upright`` is the normal's third component, shape [n].
            position: In halves of the image's width along both, shape [2, n].
        """
        along, across, height, level = self.seen_from(position, softness=softness)
        cosine = np.asarray(height * upright + tilt[0] * along + tilt[1] * across)
        return np.asarray(softened(cosine, softness) - level)

    def seen_from(self, position: RealArray, *, softness: float) -> RealArray:
        """Return the direction to the lamp, of length 1, and its light on level gel, shape [4, n].

        Positions are in halves of the image's width along both, shape [2, n].
        """
        kind = position.dtype.type
        along = kind(self.distance * math.cos(self.azimuth_rad)) - position[0]
        across = kind(self.distance * math.sin(self.azimuth_rad)) - position[1]
        height = kind(self.distance * math.tan(self.elevation_rad))
        away = np.sqrt(along * along + across * across + height * height)
        level = np.asarray(height / away)
        return np.stack([along / away, across / away, level, softened(level, softness)])


@dataclass(frozen=True, slots=True, kw_only=True)
class ShadingTerms:
    """Lamps and creases; each contributes its value, and that times u and times v.

    Attributes:
        softness: Half width of their terminators, as a cosine.
        aspect: Height of the image over its width.
        crease_limit: Curvature of the sharpest bend that the pixels resolve [1/m]; sharper creases
            are taken to be so sharp. Balls bend the gel less: up to there it is extrapolated.
    """

    lamps: tuple[NearLamp, ...]
    softness: float
    aspect: float
    crease_limit: float

    @property
    def count(self) -> int:
        """Number of terms."""
        return _PLACES * (len(self.lamps) + 1)

    def values(self, tilt: RealArray, position: RealArray, curvature: RealArray) -> RealArray:
        """Return the terms, shape [count, n].

        Args:
            tilt: Shape [2, n].
            position: Normalised pixel position, shape [2, n].
            curvature: Divergence of the tilt [1/m], shape [n].
        """
        kind = tilt.dtype.type
        upright = np.sqrt(np.maximum(kind(1.0) - tilt[0] ** 2 - tilt[1] ** 2, kind(0.0)))
        place = np.stack([position[0], position[1] * kind(self.aspect)])
        basic = [lamp.lit(tilt, upright, place, softness=self.softness) for lamp in self.lamps]
        bound = kind(self.crease_limit)
        basic.append(np.clip(curvature, -bound, bound) * kind(CREASE_UNIT_M))
        terms = np.empty((len(basic), _PLACES, len(upright)), dtype=tilt.dtype)
        for row, value in zip(terms, basic, strict=True):
            row[0] = value
            np.multiply(value, position, out=row[1:])
        return terms.reshape(self.count, -1)


def softened(cosine: RealArray, softness: float) -> RealArray:
    """Return the cosine where it is positive, and zero where not, with a soft bend between."""
    bend = cosine.dtype.type(softness * softness)
    return np.asarray(cosine.dtype.type(0.5) * (cosine + np.sqrt(cosine * cosine + bend)))


def lamp_planes(terms: ShadingTerms | None, position: RealArray, layout: PixelBlocks) -> Any:
    """Return each lamp's direction and light on level gel in blocks, shape [4 lamp_count rows]."""
    if terms is None or not terms.lamps:
        return layout.array(np.zeros((0, layout.lanes)), layout.block)
    place = np.stack([position[0], position[1] * np.float32(terms.aspect)])
    lamps = [lamp.seen_from(place, softness=terms.softness) for lamp in terms.lamps]
    return layout.pixel_rows(np.concatenate(lamps).reshape(1, -1, layout.geometry.width))[0]


def lamp_weights(
    terms: ShadingTerms | None, term_coefficients: FloatArray, v: RealArray
) -> Float32Array:
    """Return level and slope along each row of the colours of lamps and creases.

    Of shape [row_count, lamp_count + 1, 3, 2].
    """
    if terms is None:
        return np.zeros((len(v), 1, 3, 2), dtype=np.float32)
    level, along, across = term_coefficients.reshape(-1, 3, 3).transpose(1, 0, 2)
    levels = level + v[:, None, None] * across
    return np.stack([levels, np.broadcast_to(along, levels.shape)], axis=-1).astype(np.float32)
