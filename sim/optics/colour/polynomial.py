"""Polynomials in tilt, pixel position and indentation."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from sim.arrays import FloatArray, IntArray, RealArray

INDENTATION_UNIT_M = 1e-3
_BAND_POINTS = 2048  # their terms stay in the cache


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


def monomials(
    tilt: RealArray, position: RealArray, indentation_m: RealArray, exponents: IntArray
) -> RealArray:
    """Return the terms' values, shape [term_count, point_count]; arguments as in ``evaluate``."""
    depth = indentation_m / tilt.dtype.type(INDENTATION_UNIT_M)
    powers = _all_powers((*tilt, *position, depth), exponents)
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
    """Return the polynomials' values at points.

    Args:
        exponents: Of tilt (2), position (2) and indentation [mm], shape [term_count, 5].
        coefficients: Shape [term_count, 3].
        tilt: Shape [2, point_count].
        position: Shape [2, point_count].
        indentation_m: Shape [point_count].

    Returns:
        Shape [3, point_count], in the precision of ``tilt``.
    """
    weights = np.ascontiguousarray(coefficients.T, dtype=tilt.dtype)
    values = np.empty((3, tilt.shape[1]), dtype=tilt.dtype)
    for start in range(0, tilt.shape[1], _BAND_POINTS):
        band = slice(start, start + _BAND_POINTS)
        terms = monomials(tilt[:, band], position[:, band], indentation_m[band], exponents)
        np.matmul(weights, terms, out=values[:, band])
    return values


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


def _all_powers(variables: Iterable[RealArray], exponents: IntArray) -> list[list[RealArray]]:
    """Return the powers of each variable up to the highest that its column asks for."""
    return [
        _powers(variable, int(exponents[:, column].max(initial=0)))
        for column, variable in enumerate(variables)
    ]


def _powers(variable: RealArray, degree: int) -> list[RealArray]:
    powers = [variable, variable]  # the first is asked for by no product
    for _ in range(degree - 1):
        powers.append(powers[-1] * variable)
    return powers
