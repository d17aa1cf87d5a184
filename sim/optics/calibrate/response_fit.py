"""Where a camera's shoulder begins, found from ball presses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.optics.calibrate.photometric_fit import PhotometricSamples, fit_photometric
from sim.optics.colour.response import BRIGHTEST, Response
from sim.optics.colour.shading_terms import ShadingTerms

_KNEES = (195.0, 205.0, 215.0, 225.0, 235.0, 245.0, BRIGHTEST)
_SAMPLES = 6000
_CLEARLY = 0.98  # of the misfit without a shoulder: noise alone is to bend no response


def fit_response(
    samples_of: Callable[[Response], PhotometricSamples],
    *,
    exponents: IntArray,
    terms: ShadingTerms | None,
) -> Response:
    """Return the response through which one model explains the samples best.

    Args:
        samples_of: Gives the samples' light as it is through a response.
        exponents: Terms of the polynomial.
        terms: Lamps and creases beside it.
    """
    misfit = np.array([_misfit(samples_of(Response(knee=k)), exponents, terms) for k in _KNEES])
    best = int(np.argmin(misfit))
    if misfit[best] > _CLEARLY * misfit[-1]:
        return Response()
    if best == 0:
        return Response(knee=_KNEES[0])
    left, middle, right = misfit[best - 1 : best + 2]
    shift = 0.5 * (left - right) / (left - 2.0 * middle + right)
    return Response(knee=float(_KNEES[best] + shift * (_KNEES[best] - _KNEES[best - 1])))


def _misfit(samples: PhotometricSamples, exponents: IntArray, terms: ShadingTerms | None) -> float:
    """Return what a fit leaves over of the colours that the camera tells [grey levels^2]."""
    few = samples.thinned(max(1, len(samples.change) // _SAMPLES))
    model = fit_photometric(few, exponents=exponents, terms=terms)
    features = few.features(exponents, terms)
    coefficients: FloatArray = np.concatenate([model.coefficients, model.term_coefficients])
    off = few.change - features.T @ coefficients
    weights = np.stack([few.weighed(channel) for channel in range(3)], axis=1)
    told = np.sum(few.counts)
    return float(np.sum((off * weights) ** 2) / told)
