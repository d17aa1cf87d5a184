"""Near lamps found from ball presses: where they stand, and how soft their terminators are.

The model is linear in everything but the lamps' places, so each trial of those costs one linear
least-squares fit (variable projection, Golub and Pereyra 1973). Every combination of directions is
tried, then the best is refined. Nothing is taken from the sensor's file but the lamps' number.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.optimize import least_squares

from sim.optics.calibrate.fit.samples import NormalEquations, PhotometricSamples
from sim.optics.colour.polynomial import polynomial_exponents
from sim.optics.colour.shading_terms import NearLamp, ShadingTerms
from tacauchy_rig.core.arrays import FloatArray, RealArray

_SAMPLES = 2500
_AZIMUTHS = np.arange(12) * (np.pi / 6.0)
_START = (0.2, 1.6, 0.08)  # elevation [rad], distance [half widths], softness
_LOWEST = (0.03, 1.15, 0.02)
_HIGHEST = (0.9, 6.0, 0.5)
_INSIDE = 1e-6  # of these bounds, where a search starts
_EVALUATIONS = 30
_STEP = 1e-6  # of a lamp's numbers, whose slopes are found by differences
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
        aspect: Height of the image over its width.
        pixel_m: Length of the gel that a pixel sees: a bend sharper than that is not seen [m].
        start: Lamps to begin from; None searches all around.
    """
    few = samples.thinned(max(1, samples.change.shape[1] // _SAMPLES))
    search = _Search(few, aspect=aspect, crease_limit=1.0 / pixel_m)
    if start is None:
        begin = search.all_around(lamp_count)
    else:
        lamps = [(lamp.azimuth_rad, lamp.elevation_rad, lamp.distance) for lamp in start.lamps]
        begin = np.array([*np.ravel(lamps), start.softness])
    low = np.array([-np.inf, *_LOWEST[:2]] * lamp_count + [_LOWEST[2]])
    high = np.array([np.inf, *_HIGHEST[:2]] * lamp_count + [_HIGHEST[2]])
    found = least_squares(
        search.left_over,
        np.clip(begin, low + _INSIDE, high - _INSIDE),
        jac=search.slopes,
        bounds=(low, high),
        max_nfev=_EVALUATIONS,
    )
    return search.terms(found.x)


class _Search:
    """Lamps as numbers, and what the best coefficients beside them leave of samples' colours.

    The numbers are azimuth, elevation and distance of one lamp after the other, and the softness.
    """

    def __init__(self, samples: PhotometricSamples, *, aspect: float, crease_limit: float) -> None:
        self._samples, self._aspect, self._crease_limit = samples, aspect, crease_limit
        self._polynomial = samples.polynomial(_GENTLE)
        self._hold = float(np.sqrt(_RIDGE * samples.change.shape[1]))

    def terms(self, numbers: FloatArray) -> ShadingTerms:
        """Return the lamps that numbers stand for, and creases."""
        lamps = tuple(
            NearLamp(azimuth_rad=azimuth, elevation_rad=elevation, distance=distance)
            for azimuth, elevation, distance in numbers[:-1].reshape(-1, 3).tolist()
        )
        return ShadingTerms(
            lamps=lamps,
            softness=float(numbers[-1]),
            aspect=self._aspect,
            crease_limit=self._crease_limit,
        )

    def all_around(self, lamp_count: int) -> FloatArray:
        """Return the lamps, of some in every combination of directions, that leave least over.

        The sums of a combination's fit are among those of a fit to lamps in all directions.
        """
        sums = NormalEquations.of(self._features(_around(_AZIMUTHS)), self._samples)
        gentle, count = len(self._polynomial), sums.load.shape[1]
        creases = np.arange(gentle + 3 * len(_AZIMUTHS), count)
        chosen = np.array(list(combinations(range(len(_AZIMUTHS)), lamp_count)))
        lamps = gentle + (3 * chosen[..., None] + np.arange(3)).reshape(len(chosen), -1)
        others = np.tile(np.concatenate([np.arange(gentle), creases]), (len(chosen), 1))
        rows = np.concatenate([others, lamps], axis=1)
        held = sums.normal + self._hold**2 * np.eye(count)
        load = sums.load[:, rows]
        fits = np.linalg.solve(held[:, rows[:, :, None], rows[:, None, :]], load[..., None])
        explained = np.sum(load * fits[..., 0], axis=(0, 2))
        return _around(_AZIMUTHS[chosen[int(np.argmax(explained))]])

    def left_over(self, numbers: FloatArray) -> FloatArray:
        """Return what is left of the samples' colours, and the coefficients' own size."""
        features = self._features(numbers)
        coefficients = self._solved(features)
        off = (self._samples.change - coefficients @ features) * self._samples.weights
        return np.concatenate([off, -self._hold * coefficients], axis=1).ravel()

    def slopes(self, numbers: FloatArray) -> FloatArray:
        """Return how ``left_over`` changes with each number, after Kaufman (1975).

        The coefficients follow: a change of features counts as far as no others can make it up.
        """
        features, gentle = self._features(numbers), len(self._polynomial)
        coefficients = self._solved(features)
        shaded = coefficients[:, gentle:].reshape(3, -1, 3)[:, :-1]  # without creases
        moved = np.zeros((len(numbers), *self._samples.weights.shape))
        for kind in range(4):
            step = np.zeros_like(numbers)
            step[slice(kind, -1, 3) if kind < 3 else -1] = _STEP
            change = (self._features(numbers + step) - features)[gentle:-3] / _STEP
            lit = np.einsum("cmp,mpn->mcn", shaded, change.reshape(-1, 3, change.shape[1]))
            moved[slice(kind, -1, 3) if kind < 3 else -1] = lit if kind < 3 else lit.sum(axis=0)
        found = []
        for weights, own in zip(self._samples.weights, moved.transpose(1, 0, 2), strict=True):
            known, change = features * weights, own * weights
            held = known @ known.T + self._hold**2 * np.eye(len(known))
            made_up = np.linalg.solve(held, known @ change.T)
            found.append(np.concatenate([known.T @ made_up - change.T, self._hold * made_up]))
        return np.concatenate(found)

    def _features(self, numbers: FloatArray) -> FloatArray:
        return np.concatenate([self._polynomial, self._samples.shading(self.terms(numbers))])

    def _solved(self, features: FloatArray) -> FloatArray:
        return NormalEquations.of(features, self._samples).solved(_RIDGE)


def _around(azimuths: RealArray) -> FloatArray:
    """Return lamps in these directions, as numbers, where a search starts."""
    return np.array([*np.ravel([(azimuth, *_START[:2]) for azimuth in azimuths]), _START[2]])
