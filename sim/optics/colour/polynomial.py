"""Polynomials in tilt, pixel position and indentation, and their fast evaluation over images."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sim.arrays import Float32Array, FloatArray, IntArray, RealArray

INDENTATION_UNIT_M = 1e-3
_BAND = 4096
_ROWS = 8  # taller products of this kind take twice as long a row


def polynomial_exponents(
    *,
    tilt_degree: int,
    position_degree: int,
    indentation_degree: int = 0,
    indentation_tilt_degree: int = 0,
) -> IntArray:
    """List the terms p^a q^b u^c v^d w^e of a model.

    Terms without indentation have 1 <= a + b <= tilt_degree; terms with 1 <= e <=
    indentation_degree have a + b <= indentation_tilt_degree; all have c + d <= position_degree.

    Returns:
        Exponents, shape [term_count, 5].
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
    """Return the terms' values, shape [term_count, point_count]; arguments as in ``evaluate``."""
    depth = indentation_m / tilt.dtype.type(INDENTATION_UNIT_M)
    powers = [
        _powers(variable, int(degrees.max(initial=0)))
        for variable, degrees in zip((*tilt, *position, depth), exponents.T, strict=True)
    ]
    features = np.empty((len(exponents), tilt.shape[1]), dtype=tilt.dtype)
    for row, term in zip(features, exponents.tolist(), strict=True):
        product = _product(powers, term, row)
        if product is not row:
            row[...] = product
    return features


def evaluate_polynomial(
    exponents: IntArray,
    coefficients: FloatArray,
    tilt: RealArray,
    position: RealArray,
    indentation_m: RealArray,
) -> RealArray:
    """Return the polynomials' values in bands of pixels that stay in the cache.

    Args:
        exponents: Of tilt (2), position (2) and indentation [mm], shape [term_count, 5].
        coefficients: Shape [term_count, 3].
        tilt: Shape [2, point_count].
        position: Shape [2, point_count].
        indentation_m: Shape [point_count].

    Returns:
        Shape [3, point_count], in the precision of ``tilt``.
    """
    surface, surface_of, places, place_of = _sorted_terms(tuple(map(tuple, exponents.tolist())))
    by_place = np.zeros((len(places), 3, len(surface)), dtype=tilt.dtype)
    by_place[place_of, :, surface_of] = coefficients
    weights = by_place.reshape(-1, len(surface))
    values = np.empty((3, tilt.shape[1]), dtype=tilt.dtype)
    for start in range(0, tilt.shape[1], _BAND):
        band = slice(start, start + _BAND)
        features = monomials(tilt[:, band], position[:, band], indentation_m[band], surface)
        _sum_places(places, weights, features, position[:, band], values[:, band])
    return values


@lru_cache(maxsize=16)
def _sorted_terms(
    terms: tuple[tuple[int, ...], ...],
) -> tuple[IntArray, NDArray[np.intp], list[tuple[int, int]], NDArray[np.intp]]:
    """Return exponents without place and places, each with whose a term is."""
    exponents = np.array(terms, dtype=np.int32).reshape(-1, 5)
    surface, surface_of = np.unique(exponents[:, [0, 1, 4]], axis=0, return_inverse=True)
    places, place_of = np.unique(exponents[:, [2, 3]], axis=0, return_inverse=True)
    level = np.zeros((len(surface), 5), dtype=np.int32)
    level[:, [0, 1, 4]] = surface
    return level, surface_of, [(c, d) for c, d in places.tolist()], place_of


def _sum_places(
    places: list[tuple[int, int]],
    weights: RealArray,
    features: RealArray,
    position: RealArray,
    out: RealArray,
) -> None:
    """Sum place monomial x (weights @ features) over one band of pixels.

    Places are summed from the highest power down, each once multiplied by what it has more than
    the place it falls back to.

    Args:
        places: Exponents of place.
        weights: Of each place's red, green and blue, shape [place_count * 3, feature_count].
        features: Monomials without place, shape [feature_count, point_count].
        position: Shape [2, point_count].
        out: Shape [3, point_count].
    """
    parts = np.empty((len(weights), features.shape[1]), dtype=features.dtype)
    for row in range(0, len(parts), _ROWS):
        np.matmul(weights[row : row + _ROWS], features, out=parts[row : row + _ROWS])
    by_place = dict(zip(places, parts.reshape(len(places), 3, -1), strict=True))
    while len(by_place) > 1 or (0, 0) not in by_place:
        c, d = max(by_place, key=lambda place: (sum(place), place))
        part = by_place.pop((c, d))
        part *= position[1] if d else position[0]
        lower = (c, d - 1) if d else (c - 1, d)
        if lower in by_place:
            by_place[lower] += part
        else:
            by_place[lower] = part
    out[...] = by_place[0, 0]


def _product(powers: list[list[RealArray]], term: list[int], scratch: RealArray) -> RealArray:
    """Return a term's value, in ``scratch`` unless it is one of the powers."""
    factors = [powers[i][power] for i, power in enumerate(term) if power]
    if len(factors) == 1:
        return factors[0]
    if not factors:
        scratch[...] = 1.0
        return scratch
    np.multiply(factors[0], factors[1], out=scratch)
    for factor in factors[2:]:
        scratch *= factor
    return scratch


def _powers(variable: RealArray, degree: int) -> list[RealArray]:
    powers = [variable, variable]  # the first is asked for by no product
    for _ in range(degree - 1):
        powers.append(powers[-1] * variable)
    return powers


def degrees_of_tilt(exponents: IntArray) -> IntArray:
    """Return the highest degree of tilt beside each power of u (falling) and of indentation.

    Returns:
        Shape [powers of u, powers of indentation]; -1 where there is no such term.
    """
    along, deep = exponents[:, 2], exponents[:, 4]
    degrees = np.full((along.max(initial=0) + 1, deep.max(initial=0) + 1), -1, dtype=np.int32)
    np.maximum.at(degrees, (along, deep), exponents[:, 0] + exponents[:, 1])
    return degrees[::-1]


def row_weights(
    exponents: IntArray, coefficients: FloatArray, degrees: IntArray, v: RealArray
) -> Float32Array:
    """Return each row's coefficients in the order in which the kernel comes to the terms.

    Returns:
        Shape [row_count, term_count, 3].
    """
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
