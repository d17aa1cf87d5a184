"""Least-squares fit of the photometric model to samples of tilt and colour.

Beside the coefficients, two numbers: where the camera's shoulder begins, and how strongly the fit
is held back, judged by presses that it leaves out. An even light and clean frames bear finer terms
than wrinkles, scratches and uneven light do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray, IntArray
from sim.optics.colour.photometric import PhotometricModel
from sim.optics.colour.polynomial import BALL_EXPONENTS, monomials
from sim.optics.colour.response import BRIGHTEST, LINEAR, Response
from sim.optics.colour.shading_terms import ShadingTerms
from tacauchy_rig.errors import ConfigError

REFERENCE = 128.0
RIDGE = 1e-5
_BY_COLUMN = {"tilt", "position", "rest_tilt"}  # arrays with a column for each point
_RIDGES = (1e-6, 3e-6, RIDGE, 3e-5, 1e-4)
_GROUPS = 6
_KNEES = (195.0, 205.0, 215.0, 225.0, 235.0, 245.0, BRIGHTEST)
_RESPONSE_SAMPLES = 6000
_CLEARLY = 0.98  # of the misfit without a shoulder: noise alone is to bend no response


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfacePoints:
    """The gel's surface at n points.

    Attributes:
        tilt: Along +column and +row, shape [2, n].
        indentation_m: Unloaded minus loaded height [m], shape [n].
        curvature: Divergence of the tilt [1/m], shape [n].
    """

    tilt: FloatArray
    indentation_m: FloatArray
    curvature: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class PhotometricSamples:
    """Pixels with known surface and observed colour.

    Attributes:
        tilt: Along +column and +row, shape [2, sample_count].
        position: Normalised pixel position, shape [2, sample_count].
        indentation_m: Unloaded minus loaded height [m], shape [sample_count].
        change: Colour minus no-contact colour, red, green, blue [grey levels],
            shape [sample_count, 3].
        counts: False where a colour is not known, same shape.
        curvature: Divergence of the tilt [1/m], shape [sample_count]; None is not known.
        rest_tilt: Of the unloaded gel, whose colour is in the no-contact frame, shape
            [2, sample_count]; None is level gel.
        weights: Of each colour in a fit, like ``change``; None is one.
        around: Points beside each sample whose light the camera's blur mixes in its place, all
            alike; none is a sharp camera.
    """

    tilt: FloatArray
    position: FloatArray
    indentation_m: FloatArray
    change: FloatArray
    counts: NDArray[np.bool_]
    curvature: FloatArray | None = None
    rest_tilt: FloatArray | None = None
    weights: FloatArray | None = None
    around: tuple[SurfacePoints, ...] = ()

    @property
    def counted(self) -> FloatArray:
        """Weights of the colours in a fit, zero where one does not count, shape [n, 3]."""
        counts = self.counts.astype(np.float64)
        return counts if self.weights is None else counts * self.weights

    def thinned(self, step: int) -> PhotometricSamples:
        """Return every ``step``-th sample."""
        return _each_array(
            [self], lambda arrays, axis: arrays[0][:, ::step] if axis else arrays[0][::step]
        )

    def features(self, exponents: IntArray, terms: ShadingTerms | None) -> FloatArray:
        """Return what the model is linear in, shape [exponent_count + term_count, sample_count]."""
        level = np.zeros_like(self.indentation_m)
        own = SurfacePoints(
            tilt=self.tilt,
            indentation_m=self.indentation_m,
            curvature=level if self.curvature is None else self.curvature,
        )
        found = np.zeros((len(exponents) + (0 if terms is None else terms.count), len(level)))
        seen = self.around or (own,)
        for points in seen:
            found += self._values(points, exponents, terms)
        found /= len(seen)
        if self.rest_tilt is not None:
            rest = SurfacePoints(tilt=self.rest_tilt, indentation_m=level, curvature=level)
            found -= self._values(rest, exponents, terms)
        return found

    def normal_equations(self, features: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the matrix and the load of each colour's fit, shapes [3, n, n] and [3, n]."""
        normal, load = [], []
        for weights, change in zip(self.counted.T, self.change.T, strict=True):
            known = features * weights
            normal.append(known @ known.T)
            load.append(known @ (change * weights))
        return np.stack(normal), np.stack(load)

    def _values(
        self, points: SurfacePoints, exponents: IntArray, terms: ShadingTerms | None
    ) -> FloatArray:
        found = monomials(points.tilt, self.position, points.indentation_m, exponents)
        if terms is not None:
            shaded = terms.values(points.tilt, self.position, points.curvature)
            found = np.concatenate([found, shaded])
        return np.asarray(found, dtype=np.float64)


_Points = TypeVar("_Points", "SurfacePoints", "PhotometricSamples")


def joined(parts: Sequence[PhotometricSamples]) -> PhotometricSamples:
    """Return the samples of several presses as one; what one of them lacks, all lack."""
    return _each_array(parts, lambda arrays, axis: np.concatenate(arrays, axis=axis))


def _each_array(
    parts: Sequence[_Points], made_of: Callable[[list[FloatArray], int], FloatArray]
) -> _Points:
    """Return points whose arrays are made of the parts' arrays along the axis of the points."""
    found: dict[str, Any] = {}
    for field in fields(parts[0]):
        values = [getattr(part, field.name) for part in parts]
        if field.name == "around":
            found["around"] = tuple(
                _each_array(beside, made_of) for beside in zip(*values, strict=True)
            )
        elif any(value is None for value in values):
            found[field.name] = None
        else:
            found[field.name] = made_of(values, 1 if field.name in _BY_COLUMN else 0)
    return replace(parts[0], **found)


def fit_photometric(
    samples: PhotometricSamples,
    *,
    exponents: IntArray = BALL_EXPONENTS,
    ridge: float = RIDGE,
    terms: ShadingTerms | None = None,
    response: Response = LINEAR,
    reference: float | None = None,
    provenance: Mapping[str, object] | None = None,
) -> PhotometricModel:
    """Fit the coefficients; the limits of tilt and indentation are the samples' largest.

    Args:
        samples: Pixels of all presses.
        exponents: Terms of the model, shape [term_count, 5].
        ridge: Weight on the coefficients' squares, per sample.
        terms: Lamps and creases beside the polynomial.
        response: Of the camera, through which the samples' colours were taken back to light.
        reference: Level of the no-contact frame that their changes were brought to, if they were.
        provenance: Where the samples come from; kept with the model.

    Raises:
        ConfigError: There are fewer samples than terms.
    """
    features = samples.features(exponents, terms)
    unknowns, count = features.shape
    if count < unknowns:
        raise ConfigError(
            f"{count} pixels cannot fix the {unknowns} terms of the photometric model",
            remedy="give more presses, or a model of lower degree",
        )
    coefficients = solved(*samples.normal_equations(features), weight=ridge * count).T
    return PhotometricModel(
        exponents=exponents,
        coefficients=coefficients[: len(exponents)],
        terms=terms,
        term_coefficients=coefficients[len(exponents) :],
        tilt_limit=float(np.hypot(*samples.tilt).max()),
        indentation_limit_m=float(samples.indentation_m.max()),
        response=response,
        reference=reference,
        provenance=dict(provenance or {}),
    )


def solved(normal: FloatArray, load: FloatArray, *, weight: float) -> FloatArray:
    """Return each colour's coefficients with so much weight on their squares, shape [3, n].

    Args:
        normal: Matrix of each fit, shape [3, n, n].
        load: Shape [3, n].
        weight: Keeps coefficients small that the samples do not tell.
    """
    held = normal + weight * np.eye(normal.shape[-1])
    return np.asarray(np.linalg.solve(held, load[..., None])[..., 0])


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
    groups = []
    for first in range(_GROUPS):
        samples = joined(presses[first::_GROUPS])
        groups.append(samples.normal_equations(samples.features(exponents, terms)))
    normals = np.stack([normal for normal, _ in groups])
    loads = np.stack([load for _, load in groups])
    normal, load = normals.sum(axis=0), loads.sum(axis=0)
    count = sum(len(press.change) for press in presses)

    def misfit(ridge: float) -> float:
        return sum(
            _misfit_left_out(normal - own, load - seen, own, seen, ridge * count)
            for own, seen in zip(normals, loads, strict=True)
        )

    return min(_RIDGES, key=misfit)


def _misfit_left_out(
    normal: FloatArray, load: FloatArray, own: FloatArray, seen: FloatArray, weight: float
) -> float:
    """Return the squared misfit of presses by a fit to the others, less what is always there."""
    found = solved(normal, load, weight=weight)
    squares = np.einsum("ci,cij,cj->", found, own, found)
    return float(squares - 2.0 * np.sum(found * seen))


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
    return Response(knee=lowest_place(_KNEES, misfit))


def lowest_place(places: Sequence[float] | FloatArray, misfit: FloatArray) -> float:
    """Return where a parabola through the lowest misfit and its neighbours is lowest.

    Args:
        places: Evenly spaced; the lowest misfit is neither at the first nor at the last.
        misfit: At each of them.
    """
    best = int(np.argmin(misfit))
    left, middle, right = misfit[best - 1 : best + 2]
    shift = 0.5 * (left - right) / (left - 2.0 * middle + right)
    return float(places[best] + shift * (places[best] - places[best - 1]))


def _misfit(samples: PhotometricSamples, exponents: IntArray, terms: ShadingTerms | None) -> float:
    """Return what a fit leaves over of the colours that the camera tells [grey levels^2]."""
    few = samples.thinned(max(1, len(samples.change) // _RESPONSE_SAMPLES))
    model = fit_photometric(few, exponents=exponents, terms=terms)
    features = few.features(exponents, terms)
    coefficients: FloatArray = np.concatenate([model.coefficients, model.term_coefficients])
    off = few.change - features.T @ coefficients
    return float(np.sum((off * few.counted) ** 2) / np.sum(few.counts))
