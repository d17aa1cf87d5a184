"""Terms of the photometric model: a polynomial, near lamps and creases.

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
from tacauchy_rig.core.arrays import Float32Array, FloatArray, IndexArray, IntArray, RealArray

INDENTATION_UNIT_M = 1e-3
_BAND = 4096
_DIGITS = 16 ** np.arange(5)  # of a number for each term: no exponent reaches 16


def polynomial_exponents(
    *,
    tilt_degree: int,
    position_degree: int,
    indentation_degree: int = 0,
    indentation_tilt_degree: int = 0,
) -> IntArray:
    """List the exponents of the terms p^a q^b u^c v^d w^e of a model, shape [term_count, 5].

    Terms without indentation have 1 <= a + b <= tilt_degree; terms with 1 <= e <=
    indentation_degree have a + b <= indentation_tilt_degree; all have c + d <= position_degree.
    """
    tilts = [
        (a, total - a, e)
        for e in range(indentation_degree + 1)
        for total in range(0 if e else 1, (indentation_tilt_degree if e else tilt_degree) + 1)
        for a in range(total, -1, -1)
    ]
    terms = [
        (a, b, c, place - c, e)
        for place in range(position_degree + 1)
        for c in range(place, -1, -1)
        for a, b, e in tilts
    ]
    return np.array(terms, dtype=np.int32).reshape(-1, 5)


_STEEP = polynomial_exponents(
    tilt_degree=5, position_degree=1, indentation_degree=1, indentation_tilt_degree=2
)
# Light falls off over the image: gentle slopes' colours bend with place, steep ones' do not.
_GENTLE = polynomial_exponents(
    tilt_degree=3, position_degree=2, indentation_degree=1, indentation_tilt_degree=1
)
BALL_EXPONENTS: IntArray = np.unique(np.concatenate([_STEEP, _GENTLE]), axis=0)


def monomials(
    tilt: RealArray, position: RealArray, indentation_m: RealArray, exponents: IntArray
) -> RealArray:
    """Return the terms' values at n points, shape [term_count, n].

    Exponents, shape [term_count, 5], are of tilt (2), position (2) and indentation [mm].
    """
    depth = indentation_m / INDENTATION_UNIT_M
    powers = [[variable, variable] for variable in (*tilt, *position, depth)]
    for known, degree in zip(powers, exponents.max(axis=0, initial=0), strict=True):
        while len(known) <= degree:
            known.append(known[-1] * known[1])
    values = np.ones((len(exponents), tilt.shape[1]), dtype=tilt.dtype)
    for row, term in zip(values, exponents.tolist(), strict=True):
        for known, power in zip(powers, term, strict=True):
            if power:
                row *= known[power]
    return values


def evaluate_polynomial(
    exponents: IntArray,
    coefficients: FloatArray,
    tilt: RealArray,
    position: RealArray,
    indentation_m: RealArray,
) -> RealArray:
    """Return the polynomials' values, shape [3, point_count], in the precision of ``tilt``.

    In bands of pixels that stay in the cache; terms that differ in place only share the rest.
    """
    shapes, shape_of = _distinct(exponents * (1, 1, 0, 0, 1))
    places, place_of = _distinct(exponents * (0, 0, 1, 1, 0))
    weights = np.zeros((len(places), 3, len(shapes)), dtype=tilt.dtype)
    weights[place_of, :, shape_of] = coefficients
    values = np.empty((3, tilt.shape[1]), dtype=tilt.dtype)
    for start in range(0, tilt.shape[1], _BAND):
        band = slice(start, start + _BAND)
        at = tilt[:, band], position[:, band], indentation_m[band]
        by_place = weights.reshape(-1, len(shapes)) @ monomials(*at, shapes)
        by_place = by_place.reshape(len(places), 3, -1)
        values[:, band] = np.einsum("kn,kcn->cn", monomials(*at, places), by_place)
    return values


def _distinct(exponents: IntArray) -> tuple[IntArray, IndexArray]:
    """Return terms without repetition, and which of them each is."""
    _, first, which = np.unique(exponents @ _DIGITS, return_index=True, return_inverse=True)
    return exponents[first], which


def degrees_of_tilt(exponents: IntArray) -> IntArray:
    """Return the highest degree of tilt at powers of u (falling) and indentation; -1 is none."""
    along, deep = exponents[:, 2], exponents[:, 4]
    degrees = np.full((along.max(initial=0) + 1, deep.max(initial=0) + 1), -1, dtype=np.int32)
    np.maximum.at(degrees, (along, deep), exponents[:, 0] + exponents[:, 1])
    return degrees[::-1]


def row_weights(
    exponents: IntArray, coefficients: FloatArray, degrees: IntArray, v: RealArray
) -> Float32Array:
    """Return each row's coefficients as the kernel comes to the terms, shape [row, term, 3]."""
    order = [
        (a, b, len(degrees) - 1 - c, e)
        for c, row in enumerate(degrees.tolist())
        for e, degree in enumerate(row)
        for b in range(degree + 1)
        for a in range(degree - b + 1)
    ]
    place = {term: number for number, term in enumerate(order)}
    weights = np.zeros((len(v), len(order), 3))
    for (a, b, c, d, e), levels in zip(exponents.tolist(), coefficients, strict=True):
        weights[:, place[a, b, c, e]] += (v.astype(np.float64) ** d)[:, None] * levels
    return weights.astype(np.float32)


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

        ``upright`` is the normal's third component; positions are as in ``seen_from``.
        """
        along, across, height, level = self.seen_from(position, softness=softness)
        cosine = np.asarray(height * upright + tilt[0] * along + tilt[1] * across)
        return np.asarray(softened(cosine, softness) - level)

    def seen_from(self, position: RealArray, *, softness: float) -> RealArray:
        """Return the direction to the lamp, of length 1, and its light on level gel, shape [4, n].

        Positions are in halves of the image's width along both.
        """
        along = self.distance * math.cos(self.azimuth_rad) - position[0]
        across = self.distance * math.sin(self.azimuth_rad) - position[1]
        height = self.distance * math.tan(self.elevation_rad)
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
        """Return the terms at n normalised pixel positions, shape [count, n].

        The curvature is the divergence of the tilt [1/m].
        """
        upright = np.sqrt(np.maximum(1.0 - tilt[0] ** 2 - tilt[1] ** 2, 0.0))
        place = np.stack([position[0], position[1] * self.aspect])
        basic = [lamp.lit(tilt, upright, place, softness=self.softness) for lamp in self.lamps]
        bounded = np.clip(curvature, -self.crease_limit, self.crease_limit)
        basic.append(bounded * CREASE_UNIT_M)
        terms = np.empty((len(basic), _PLACES, len(upright)), dtype=tilt.dtype)
        for row, value in zip(terms, basic, strict=True):
            row[0] = value
            np.multiply(value, position, out=row[1:])
        return terms.reshape(self.count, -1)


def softened(cosine: RealArray, softness: float) -> RealArray:
    """Return the cosine where it is positive, and zero where not, with a soft bend between."""
    return np.asarray(0.5 * (cosine + np.sqrt(cosine * cosine + softness * softness)))


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
    """Return level and slope of lamps' and creases' colours along rows, [row, lamp + 1, 3, 2]."""
    if terms is None:
        return np.zeros((len(v), 1, 3, 2), dtype=np.float32)
    level, along, across = term_coefficients.reshape(-1, 3, 3).transpose(1, 0, 2)
    levels = level + v[:, None, None] * across
    return np.stack([levels, np.broadcast_to(along, levels.shape)], axis=-1).astype(np.float32)
