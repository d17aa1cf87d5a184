"""Least-squares fit of the photometric model to samples of tilt and colour.

Beside the coefficients, two numbers: where the camera's shoulder begins, and how strongly the fit
is held back, judged by presses that it leaves out. An even light and clean frames bear finer terms
than wrinkles, scratches and uneven light do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from sim.optics.calibrate.fit.samples import NormalEquations, PhotometricSamples
from sim.optics.colour.photometric import PhotometricModel
from sim.optics.colour.polynomial import BALL_EXPONENTS
from sim.optics.colour.response import BRIGHTEST, LINEAR, Response
from sim.optics.colour.shading_terms import ShadingTerms
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError

REFERENCE = 128.0
RIDGE = 1e-5
_RIDGES = (1e-6, 3e-6, RIDGE, 3e-5, 1e-4)
_GROUPS = 6
_KNEES = (195.0, 205.0, 215.0, 225.0, 235.0, 245.0, BRIGHTEST)
_CLEARLY = 0.98  # of the misfit without a shoulder: noise alone is to bend no response


def fit_photometric(
    presses: Sequence[PhotometricSamples],
    *,
    exponents: IntArray = BALL_EXPONENTS,
    features: Sequence[FloatArray] | None = None,
    ridge: float | None = RIDGE,
    terms: ShadingTerms | None = None,
    response: Response = LINEAR,
    reference: float | None = None,
) -> PhotometricModel:
    """Fit the coefficients; the limits of tilt and indentation are the samples' largest.

    Args:
        exponents: Terms of the model, shape [term_count, 5].
        features: Values of polynomial and terms for each press, where they are known already.
        ridge: Weight on the coefficients' squares, per sample; None lets presses choose it.
        response: Of the camera, through which the samples' colours were taken back to light.
        reference: Level of the no-contact frame that their changes were brought to, if they were.

    Raises:
        ConfigError: There are fewer samples than terms.
    """
    known = features or [
        np.concatenate([press.polynomial(exponents), press.shading(terms)]) for press in presses
    ]
    parts = [NormalEquations.of(*pair) for pair in zip(known, presses, strict=True)]
    total = NormalEquations.total(parts)
    count, unknowns = total.sample_count, total.load.shape[1]
    if count < unknowns:
        raise ConfigError(
            f"{count} pixels cannot fix the {unknowns} terms of the photometric model",
            remedy="give more presses, or a model of lower degree",
        )
    chosen = fit_ridge(parts) if ridge is None else ridge
    coefficients = total.solved(chosen).T
    provenance = {"press_count": len(presses), "pixel_count": count, "ridge": chosen}
    return PhotometricModel(
        exponents=exponents,
        coefficients=coefficients[: len(exponents)],
        terms=terms,
        term_coefficients=coefficients[len(exponents) :],
        tilt_limit=max(float(np.hypot(*press.gel.tilt).max()) for press in presses),
        indentation_limit_m=max(float(press.gel.indentation_m.max()) for press in presses),
        response=response,
        reference=reference,
        provenance=provenance,
    )


def fit_ridge(presses: Sequence[NormalEquations]) -> float:
    """Return the weight with which presses are predicted best by the others.

    What a fit to some presses is made of is what that to all is made of, less what the rest are.
    """
    if len(presses) < _GROUPS:
        return RIDGE
    pairs = []
    for first in range(_GROUPS):
        rest = [press for i, press in enumerate(presses) if i % _GROUPS != first]
        pairs.append((NormalEquations.total(rest), NormalEquations.total(presses[first::_GROUPS])))
    return min(
        _RIDGES, key=lambda ridge: sum(out.misfit(rest.solved(ridge)) for rest, out in pairs)
    )


def fit_response(
    presses_of: Callable[[Response], Sequence[PhotometricSamples]], features: Sequence[FloatArray]
) -> Response:
    """Return the response through which one model explains the samples best.

    Args:
        presses_of: Gives the light of each press's samples as it is through a response.
        features: What their colours are to be linear in, whatever the response.
    """

    def misfit(knee: float) -> float:
        presses = presses_of(Response(knee=knee))
        parts = [NormalEquations.of(*pair) for pair in zip(features, presses, strict=True)]
        total = NormalEquations.total(parts)
        return total.misfit(total.solved(RIDGE)) / total.told_count

    found = np.array([misfit(knee) for knee in _KNEES])
    best = int(np.argmin(found))
    if found[best] > _CLEARLY * found[-1]:
        return Response()
    return Response(knee=lowest_place(_KNEES, found) if best > 0 else _KNEES[0])


def lowest_place(places: Sequence[float] | FloatArray, misfit: FloatArray) -> float:
    """Return where a parabola through the lowest misfit and its neighbours is lowest.

    Places are evenly spaced; the lowest misfit is neither at the first nor at the last.
    """
    best = int(np.argmin(misfit))
    left, middle, right = misfit[best - 1 : best + 2]
    shift = 0.5 * (left - right) / (left - 2.0 * middle + right)
    return float(places[best] + shift * (places[best] - places[best - 1]))
