"""Polynomials in tilt, pixel position and indentation, and their fast evaluation over images."""

from __future__ import annotations

import numpy as np

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
    """Return the terms' values, shape [term_count, point_count].

    Args:
        tilt: Shape [2, point_count].
        position: Shape [2, point_count].
        indentation_m: Shape [point_count].
        exponents: Of tilt (2), position (2) and indentation [mm], shape [term_count, 5].
    """
    depth = indentation_m / tilt.dtype.type(INDENTATION_UNIT_M)
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
    Coefficients are of shape [term_count, 3]; the others are those of ``monomials``.
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
    """Return the highest degree of tilt beside each power of u (falling) and of indentation.

    It is -1 where there is no such term.
    """
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
