"""Least-squares fit of the photometric model to samples of tilt and colour.

Presses that a fit leaves out choose its ridge: clean, evenly lit frames bear finer terms. The model
is linear in everything but the lamps' places, so each trial of those costs one linear fit (variable
projection, Golub and Pereyra 1973).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from itertools import combinations

import numpy as np
from scipy.optimize import least_squares

from sim.optics.colour import photometric
from sim.optics.colour.model_interface_and_response import BRIGHTEST, LINEAR, Response
from sim.optics.colour.photometric import NearLamp, PhotometricModel, ShadingTerms
from tacauchy_rig.core.arrays import BoolArray, FloatArray, IntArray, RealArray
from tacauchy_rig.core.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class PhotometricSamples:
    """Pixels with known surface and observed colour."""

    # Points of the gel whose light a pixel shows: first the one in its middle, then those that a
    # blur mixes in its place and the same pixel's unloaded gel; each as tilt along columns and
    # along rows, indentation [m] and curvature [1/m], of shape [m, 4, n]
    surface: RealArray
    # Of these points' light in what the pixel shows; -1 of the unloaded gel, whose light is in the
    # no-contact frame
    shares: tuple[float, ...] = (1.0,)
    position: RealArray  # normalised pixel position, shape [2, n]
    change: RealArray  # red, green, blue minus the no-contact colour [grey levels], [3, n]
    weights: RealArray  # of each colour in a fit, zero where it is not known, shape [3, n]

    def polynomial(self, exponents: IntArray) -> FloatArray:
        """Return the polynomial's monomials as the samples show them, shape [count, n]."""
        (shapes, shape_of), (places, place_of) = photometric.shapes_and_places(exponents)
        shown = self._seen(lambda at: photometric.monomials(at[:2], self.position, at[2], shapes))
        middle = self.surface[0]
        at_places = photometric.monomials(middle[:2], self.position, middle[2], places)
        return shown[shape_of] * at_places[place_of]

    def shading(self, terms: ShadingTerms | None) -> FloatArray:
        """Return the values of lamps and creases as the samples show them, shape [count, n]."""
        if terms is None:
            return np.zeros((0, self.position.shape[1]))
        return self._seen(lambda at: terms.values(at[:2], self.position, at[3]))

    def _seen(self, values: Callable[[FloatArray], RealArray]) -> FloatArray:
        """Return what values of points, shape [count, n], that are linear in light amount to."""
        shown = zip(self.shares, self.surface, strict=True)
        return np.asarray(sum(share * values(points) for share, points in shown if share))

    def some(self, which: slice | BoolArray, precision: type = np.float32) -> PhotometricSamples:
        """Return a part of the samples."""
        few = {name: getattr(self, name)[..., which].astype(precision) for name in _BY_SAMPLE}
        return replace(self, **few)


_BY_SAMPLE = ("surface", "position", "change", "weights")


def joined(parts: Sequence[PhotometricSamples]) -> PhotometricSamples:
    """Return the samples of several presses, seen alike, as one."""
    arrays = {n: np.concatenate([getattr(p, n) for p in parts], axis=-1) for n in _BY_SAMPLE}
    return PhotometricSamples(shares=parts[0].shares, **arrays)


@dataclass(frozen=True, slots=True, kw_only=True)
class NormalEquations:
    """Linear least-squares fits of three colours, as sums over samples: those of presses add up.

    ``normal`` and ``load`` have the shapes [3, n, n] and [3, n]; ``squares`` is the sum of the
    squares of all weighted colours, ``known_count`` how many of them are known.
    """

    normal: FloatArray
    load: FloatArray
    squares: float
    sample_count: int
    known_count: int

    @classmethod
    def of(cls, features: FloatArray, samples: PhotometricSamples) -> NormalEquations:
        """Sum up samples whose colours are to be linear in features, shape [n, sample_count]."""
        seen = samples.change * samples.weights
        known = [features * weight for weight in samples.weights]
        return cls(
            normal=np.stack([each @ each.T for each in known]).astype(np.float64),
            load=np.stack([k @ s for k, s in zip(known, seen, strict=True)]).astype(np.float64),
            squares=float(np.sum(seen**2, dtype=np.float64)),
            sample_count=samples.change.shape[1],
            known_count=int(np.count_nonzero(samples.weights)),
        )

    @classmethod
    def total(cls, parts: Sequence[NormalEquations]) -> NormalEquations:
        """Return the equations of all samples together."""
        names = [field.name for field in fields(cls)]
        return cls(**{name: sum(getattr(part, name) for part in parts) for name in names})

    def solved(self, ridge: float | FloatArray) -> FloatArray:
        """Return colours' coefficients, [3, n], held down per sample by one ridge or by [n]."""
        held = self.normal + ridge * self.sample_count * np.eye(self.normal.shape[-1])
        return np.asarray(np.linalg.solve(held, self.load[..., None])[..., 0])

    def misfit(self, coefficients: FloatArray) -> float:
        """Return the squares that coefficients, shape [3, n], leave over [grey levels^2]."""
        bent = np.einsum("ci,cij,cj->", coefficients, self.normal, coefficients)
        return float(self.squares + bent - 2.0 * np.sum(coefficients * self.load))


REFERENCE = 128.0
RIDGE = 1e-5
# Of the steepest tilt that presses show: so far the polynomial predicts better than a frozen one
_BEYOND = 1.2
_RIDGES = (1e-6, 3e-6, RIDGE, 3e-5, 1e-4)
# Presses in less than this part of the image tell little of how colours bend over it; beyond them
# a fit would go anywhere. A term is held so many times more for each degree above the second.
# Light of lamps that graze the gel falls off so fast that a smaller part tells as much.
_WIDE, _WIDE_GRAZED, _HELD = 0.5, 0.3, 300.0
_GROUPS = 6
_RESPONSE_SAMPLES = 6000
_KNEES = (195.0, 205.0, 215.0, 225.0, 235.0, 245.0, BRIGHTEST)
BRIGHT_QUANTILE = 0.999
_CLEARLY = 0.98  # of the misfit without a shoulder: noise alone is to bend no response


def fit_photometric(
    presses: Sequence[PhotometricSamples],
    *,
    exponents: IntArray = photometric.BALL_EXPONENTS,
    features: Sequence[FloatArray] | None = None,
    ridge: float | None = RIDGE,
    terms: ShadingTerms | None = None,
    response: Response = LINEAR,
    reference: float | None = None,
) -> PhotometricModel:
    """Fit the coefficients; the limits of tilt and indentation are the samples' largest.

    Args:
        features: Values of polynomial and terms for each press, where they are known already.
        ridge: Weight on the coefficients' squares, per sample; None lets presses choose it.
        response: Of the camera, through which the samples' colours were taken back to light.
        reference: Level of the no-contact frame that their changes were brought to, if they were.
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
    held, grazed = np.ones(unknowns), np.array_equal(exponents, photometric.GRAZED_EXPONENTS)
    places = [press.position.mean(axis=1) for press in presses]
    span = float(np.ptp(places, axis=0).min()) / 2.0  # part of the width or height, the lesser
    if span < (_WIDE_GRAZED if grazed else _WIDE):
        held[: len(exponents)] = _HELD ** np.maximum(exponents[:, 2:4].sum(axis=1) - 2, 0)
    if ridge is None:  # shadows around a contact count as much as what is in it
        judged = parts if grazed else [*map(_contact, known, presses)]
        ridge = fit_ridge(parts, judged, held)
    coefficients = total.solved(ridge * held).T
    return PhotometricModel(
        exponents=exponents,
        coefficients=coefficients[: len(exponents)],
        terms=terms,
        term_coefficients=coefficients[len(exponents) :],
        tilt_limit=_BEYOND * max(float(np.hypot(*press.surface[0, :2]).max()) for press in presses),
        indentation_limit_m=max(float(press.surface[0, 2].max()) for press in presses),
        response=response,
        reference=reference,
        provenance={"press_count": len(presses), "pixel_count": count, "ridge": ridge},
    )


def _contact(features: FloatArray, press: PhotometricSamples) -> NormalEquations:
    """Sum up the samples in a press's contact, which reaches to about half of its depth."""
    depth_m = press.surface[0, 2]
    inside = depth_m > 0.5 * depth_m.max()
    return NormalEquations.of(features[:, inside], press.some(inside))


def fit_ridge(
    presses: Sequence[NormalEquations], judged: Sequence[NormalEquations], held: FloatArray
) -> float:
    """Return the weight, times ``held``, with which parts of presses are predicted best by others.

    What a fit to some presses is made of is what that to all is made of, less what the rest are.
    """
    if len(presses) < _GROUPS:
        return RIDGE
    pairs = []
    for first in range(_GROUPS):
        rest = [press for i, press in enumerate(presses) if i % _GROUPS != first]
        pairs.append((NormalEquations.total(rest), NormalEquations.total(judged[first::_GROUPS])))
    return min(_RIDGES, key=lambda r: sum(out.misfit(rest.solved(r * held)) for rest, out in pairs))


def fit_response(
    presses_of: Callable[[Response], Sequence[PhotometricSamples]],
    features: Sequence[FloatArray],
    *,
    brightest: float,
) -> Response:
    """Return the response through which a model linear in features explains the samples best.

    ``presses_of`` gives the light of each press's samples as it is through a response. A response
    that bends only above the ``brightest`` level is a linear one.
    """
    known = np.concatenate(features, axis=1)
    few = slice(None, None, max(1, known.shape[1] // _RESPONSE_SAMPLES))
    known = known[:, few]

    def misfit(knee: float) -> float:
        seen = joined(presses_of(Response(knee=knee))).some(few)
        total = NormalEquations.of(known, seen)
        return total.misfit(total.solved(RIDGE)) / total.known_count

    linear = misfit(_KNEES[-1])
    found = np.array([misfit(knee) if knee < brightest else linear for knee in _KNEES[:-1]])
    found = np.append(found, linear)
    best = int(np.argmin(found))
    if found[best] > _CLEARLY * found[-1]:
        return Response()
    return Response(knee=lowest_place(_KNEES, found) if best > 0 else _KNEES[0])


def lowest_place(places: Sequence[float] | FloatArray, misfit: FloatArray) -> float:
    """Return the least misfit's place by a parabola through three of them; places evenly spaced."""
    best = int(np.argmin(misfit))
    left, middle, right = misfit[best - 1 : best + 2]
    shift = 0.5 * (left - right) / (left - 2.0 * middle + right)
    return float(places[best] + shift * (places[best] - places[best - 1]))


_SAMPLES = 2500
_AZIMUTHS = (np.arange(12) * (np.pi / 6.0)).tolist()
_START = (0.2, 1.6, 0.08)  # elevation [rad], distance [half widths], softness
_LOWEST = (0.03, 1.15, 0.02)
_HIGHEST = (0.9, 6.0, 0.5)
_INSIDE = 1e-6  # of these bounds, where a search starts
_EVALUATIONS, _SETTLED = 30, 1e-3  # the latter is of the misfit
# Beside a polynomial of high degree a lamp may stand anywhere: it would do the rest.
_GENTLE = photometric.polynomial_exponents(tilt_degree=2, position_degree=1)
_RIDGE = 1e-6


def fit_terms(
    samples: PhotometricSamples,
    *,
    lamp_count: int,
    aspect: float,
    start: ShadingTerms | None = None,
) -> ShadingTerms:
    """Find the lamps that explain the samples best beside the polynomial.

    Without lamps to start from they are searched all around.
    """
    step = max(1, samples.change.shape[1] // _SAMPLES)
    few = samples.some(slice(None, None, step), np.float64)  # slopes by differences want all digits
    search = _Search(few, aspect=aspect, crease_limit=float(np.abs(samples.surface[0, 3]).max()))
    if start is None:
        begin = search.all_around(lamp_count)
    else:
        lamps = [(lamp.azimuth_rad, lamp.elevation_rad, lamp.distance) for lamp in start.lamps]
        begin = np.array([*np.ravel(lamps), start.softness])
    low = np.array([-np.inf, *_LOWEST[:2]] * lamp_count + [_LOWEST[2]])
    high = np.array([np.inf, *_HIGHEST[:2]] * lamp_count + [_HIGHEST[2]])
    begin = np.clip(begin, low + _INSIDE, high - _INSIDE)
    found = least_squares(
        search.left_over, begin, bounds=(low, high), ftol=_SETTLED, max_nfev=_EVALUATIONS
    )
    return search.terms(found.x)


class _Search:
    """Lamps as numbers, and what the best coefficients beside them leave of samples' colours.

    The numbers are azimuth, elevation and distance of one lamp after the other, and the softness.
    """

    def __init__(self, samples: PhotometricSamples, *, aspect: float, crease_limit: float) -> None:
        self._samples, self._fixed = samples, {"aspect": aspect, "crease_limit": crease_limit}
        self._polynomial = samples.polynomial(_GENTLE)
        self._hold = float(np.sqrt(_RIDGE * samples.change.shape[1]))

    def terms(self, numbers: FloatArray) -> ShadingTerms:
        """Return the lamps that numbers stand for, and creases."""
        lamps = tuple(
            NearLamp(azimuth_rad=azimuth, elevation_rad=elevation, distance=distance)
            for azimuth, elevation, distance in numbers[:-1].reshape(-1, 3).tolist()
        )
        return ShadingTerms(lamps=lamps, softness=float(numbers[-1]), **self._fixed)

    def all_around(self, lamp_count: int) -> FloatArray:
        """Return the lamps, of some in every combination of directions, that explain most."""

        def explained(numbers: FloatArray) -> float:
            sums = NormalEquations.of(self._features(numbers), self._samples)
            return float(np.sum(sums.load * sums.solved(_RIDGE)))

        choices = combinations(_AZIMUTHS, lamp_count)
        lamps = (np.ravel([(azimuth, *_START[:2]) for azimuth in each]) for each in choices)
        return max((np.append(each, _START[2]) for each in lamps), key=explained)

    def left_over(self, numbers: FloatArray) -> FloatArray:
        """Return what is left of the samples' colours, and the coefficients' own size."""
        features = self._features(numbers)
        coefficients = NormalEquations.of(features, self._samples).solved(_RIDGE)
        off = (self._samples.change - coefficients @ features) * self._samples.weights
        return np.concatenate([off, -self._hold * coefficients], axis=1).ravel()

    def _features(self, numbers: FloatArray) -> FloatArray:
        return np.concatenate([self._polynomial, self._samples.shading(self.terms(numbers))])
