"""How strongly a photometric fit is held back, judged by presses that it leaves out.

An even light and clean frames bear finer terms than wrinkles, scratches and uneven light do.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.optics.calibrate.photometric_fit import RIDGE, PhotometricSamples, joined
from sim.optics.colour.shading_terms import ShadingTerms

_RIDGES = (1e-6, 3e-6, RIDGE, 3e-5, 1e-4)
_GROUPS = 6


def fit_ridge(
    presses: Sequence[PhotometricSamples], *, exponents: IntArray, terms: ShadingTerms | None
) -> float:
    """Return the weight with which presses are predicted best by the others.

    Args:
        presses: The samples of each press.
        exponents: Terms of the polynomial.
        terms: Lamps and creases beside it.
    """
    if len(presses) < _GROUPS:
        return RIDGE
    groups = [_products(presses[first::_GROUPS], exponents, terms) for first in range(_GROUPS)]
    normals = np.stack([normal for normal, _ in groups])
    loads = np.stack([load for _, load in groups])
    normal, load = normals.sum(axis=0), loads.sum(axis=0)
    count = sum(len(press.change) for press in presses)

    def misfit(ridge: float) -> float:
        return sum(
            _left_out(normal - own, load - seen, own, seen, ridge * count)
            for own, seen in zip(normals, loads, strict=True)
        )

    return min(_RIDGES, key=misfit)


def _products(
    presses: Sequence[PhotometricSamples], exponents: IntArray, terms: ShadingTerms | None
) -> tuple[FloatArray, FloatArray]:
    """Return the normal matrix and the load of each colour, shapes [3, n, n] and [3, n]."""
    samples = joined(presses)
    features = samples.features(exponents, terms)
    normal, load = [], []
    for channel in range(3):
        weights = samples.weighed(channel)
        known = features * weights
        normal.append(known @ known.T)
        load.append(known @ (samples.change[:, channel] * weights))
    return np.stack(normal), np.stack(load)


def _left_out(
    normal: FloatArray, load: FloatArray, own: FloatArray, seen: FloatArray, weight: float
) -> float:
    """Return the squared misfit of presses by a fit to the others, less what is always there."""
    held = normal + weight * np.eye(normal.shape[-1])
    found = np.linalg.solve(held, load[..., None])[..., 0]
    squares = np.einsum("ci,cij,cj->", found, own, found)
    return float(squares - 2.0 * np.sum(found * seen))
