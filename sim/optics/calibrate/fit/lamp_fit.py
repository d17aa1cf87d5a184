"""Near lamps found from ball presses: where they stand, and how soft their terminators are.

The model is linear in everything but the lamps' places, so each trial of those costs one linear
least-squares fit (variable projection, Golub and Pereyra 1973). Every combination of directions is
tried, then the best is refined. Nothing is taken from the sensor's file but the lamps' number.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.optimize import least_squares

from sim.arrays import FloatArray
from sim.optics.calibrate.fit.photometric_fit import PhotometricSamples, solved
from sim.optics.colour.polynomial import polynomial_exponents
from sim.optics.colour.shading_terms import NearLamp, ShadingTerms

_SAMPLES = 2500
_AZIMUTHS = np.arange(12) * (np.pi / 6.0)
_START = (0.2, 1.6, 0.08)  # elevation [rad], distance [half widths], softness
_LOWEST = (0.03, 1.15, 0.02)
_HIGHEST = (0.9, 6.0, 0.5)
_EVALUATIONS = 30
# Beside a polynomial of high degree a lamp may stand anywhere: it would do the rest.
_GENTLE = polynomial_exponents(tilt_degree=2, position_degree=1)
_RIDGE = 1e-6


def fit_terms(
    samples: PhotometricSamples,
    *,
    lamp_count: int,
    aspect: float,
    pixel_m: float,
    start: ShadingTerms | None = None,
) -> ShadingTerms:
    """Find the lamps that explain the samples best beside the polynomial.

    Args:
        samples: Pixels of all presses.
        lamp_count: How many lamps.
        aspect: Height of the image over its width.
        pixel_m: Length of the gel that a pixel sees: a bend sharper than that is not seen [m].
        start: Lamps to begin from; None searches all around.
    """
    limit = 1.0 / pixel_m
    few = samples.thinned(max(1, len(samples.change) // _SAMPLES))
    if start is None:
        start = _all_around(lamp_count, aspect, limit, few)

    def residual(numbers: FloatArray) -> FloatArray:
        return _left_over(_terms(numbers, aspect, limit), few)

    begin = _numbers(start)
    low, high = _bounds(lamp_count)
    found = least_squares(
        residual,
        np.clip(begin, low + 1e-6, high - 1e-6),
        bounds=(low, high),
        diff_step=1e-3,
        max_nfev=_EVALUATIONS,
    )
    return _terms(found.x, aspect, limit)


def _all_around(
    lamp_count: int, aspect: float, limit: float, samples: PhotometricSamples
) -> ShadingTerms:
    """Return the lamps, of some in every combination of directions, that leave least over."""
    trials = [
        _terms(np.array([*np.ravel([(a, *_START[:2]) for a in chosen]), _START[2]]), aspect, limit)
        for chosen in combinations(_AZIMUTHS.tolist(), lamp_count)
    ]
    misfit = [float(np.sum(_left_over(trial, samples) ** 2)) for trial in trials]
    return trials[int(np.argmin(misfit))]


def _left_over(terms: ShadingTerms, samples: PhotometricSamples) -> FloatArray:
    """Return what the best coefficients leave of the samples' colours, and of their own size."""
    features = samples.features(_GENTLE, terms)
    weight = _RIDGE * features.shape[1]
    coefficients = solved(*samples.normal_equations(features), weight=weight)
    off = (samples.change - features.T @ coefficients.T) * samples.counted
    return np.concatenate([off.ravel(), np.sqrt(weight) * coefficients.ravel()])


def _numbers(terms: ShadingTerms) -> FloatArray:
    lamps = [(lamp.azimuth_rad, lamp.elevation_rad, lamp.distance) for lamp in terms.lamps]
    return np.array([*np.ravel(lamps), terms.softness])


def _terms(numbers: FloatArray, aspect: float, crease_limit: float) -> ShadingTerms:
    lamps = tuple(
        NearLamp(azimuth_rad=azimuth, elevation_rad=elevation, distance=distance)
        for azimuth, elevation, distance in numbers[:-1].reshape(-1, 3).tolist()
    )
    return ShadingTerms(
        lamps=lamps, softness=float(numbers[-1]), aspect=aspect, crease_limit=crease_limit
    )


def _bounds(lamp_count: int) -> tuple[FloatArray, FloatArray]:
    low = [-np.inf, *_LOWEST[:2]] * lamp_count + [_LOWEST[2]]
    high = [np.inf, *_HIGHEST[:2]] * lamp_count + [_HIGHEST[2]]
    return np.array(low), np.array(high)
