"""Pixels of known surface and colour, and the sums over them that a linear fit is made of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np

from sim.arrays import FloatArray, IntArray, RealArray
from sim.optics.colour.polynomial import monomials
from sim.optics.colour.shading_terms import ShadingTerms

_BY_COLUMN = {"tilt", "position", "rest_tilt"}  # arrays with a column for each point


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
        weights: Of each colour in a fit, zero where it is not known, same shape; None is one.
        curvature: Divergence of the tilt [1/m], shape [sample_count]; None is not known.
        rest_tilt: Of the unloaded gel, whose colour is in the no-contact frame, shape
            [2, sample_count]; None is level gel.
        around: Points beside each sample whose light the camera's blur mixes in its place, all
            alike; none is a sharp camera.
    """

    tilt: FloatArray
    position: FloatArray
    indentation_m: FloatArray
    change: FloatArray
    weights: FloatArray | None = None
    curvature: FloatArray | None = None
    rest_tilt: FloatArray | None = None
    around: tuple[SurfacePoints, ...] = ()

    def thinned(self, step: int) -> PhotometricSamples:
        """Return every ``step``-th sample."""
        return _each_array(
            [self], lambda arrays, axis: arrays[0][:, ::step] if axis else arrays[0][::step]
        )

    def polynomial(self, exponents: IntArray) -> FloatArray:
        """Return the polynomial's monomials as the samples show them, shape [count, n]."""
        return self.seen(lambda at: monomials(at.tilt, self.position, at.indentation_m, exponents))

    def shading(self, terms: ShadingTerms | None) -> FloatArray:
        """Return the values of lamps and creases as the samples show them, shape [count, n]."""
        if terms is None:
            return np.zeros((0, len(self.indentation_m)))
        return self.seen(lambda at: terms.values(at.tilt, self.position, at.curvature))

    def seen(self, values: Callable[[SurfacePoints], RealArray]) -> FloatArray:
        """Return the mean of what points give whose light is mixed, less what gel at rest gives.

        Args:
            values: Something that is linear in light, of points, shape [any, n].
        """
        level = np.zeros_like(self.indentation_m)
        own = SurfacePoints(
            tilt=self.tilt,
            indentation_m=self.indentation_m,
            curvature=level if self.curvature is None else self.curvature,
        )
        first, *others = self.around or (own,)
        found = np.asarray(values(first), dtype=np.float64)
        for points in others:
            found += values(points)
        if others:
            found /= 1 + len(others)
        if self.rest_tilt is not None:
            found -= values(replace(own, tilt=self.rest_tilt, indentation_m=level, curvature=level))
        return found


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


@dataclass(frozen=True, slots=True, kw_only=True)
class NormalEquations:
    """Linear least-squares fits of three colours, as sums over samples: those of presses add up.

    Attributes:
        normal: Matrix of each colour's fit, shape [3, n, n].
        load: Its right side, shape [3, n].
        squares: Sum of the squares of all weighted colours.
        sample_count: Samples.
        told_count: Colours that are known.
    """

    normal: FloatArray
    load: FloatArray
    squares: float
    sample_count: int
    told_count: int

    @classmethod
    def of(cls, features: FloatArray, samples: PhotometricSamples) -> NormalEquations:
        """Sum up samples whose colours are to be linear in features, shape [n, sample_count]."""
        weights = samples.weights
        normal, load, squares = [], [], 0.0
        for colour, change in enumerate(samples.change.T):
            weight = 1.0 if weights is None else weights[:, colour]
            known, seen = features * weight, change * weight
            normal.append(known @ known.T)
            load.append(known @ seen)
            squares += float(seen @ seen)
        return cls(
            normal=np.stack(normal),
            load=np.stack(load),
            squares=squares,
            sample_count=len(samples.change),
            told_count=samples.change.size if weights is None else int(np.count_nonzero(weights)),
        )

    @classmethod
    def total(cls, parts: Sequence[NormalEquations]) -> NormalEquations:
        """Return the equations of all samples together."""
        return cls(
            **{
                field.name: sum(getattr(part, field.name) for part in parts)
                for field in fields(cls)
            }
        )

    def solved(self, ridge: float) -> FloatArray:
        """Return each colour's coefficients, shape [3, n].

        Args:
            ridge: Weight on their squares, per sample: keeps those small that samples do not tell.
        """
        held = self.normal + ridge * self.sample_count * np.eye(self.normal.shape[-1])
        return np.asarray(np.linalg.solve(held, self.load[..., None])[..., 0])

    def misfit(self, coefficients: FloatArray) -> float:
        """Return the squares that coefficients, shape [3, n], leave over [grey levels^2]."""
        bent = np.einsum("ci,cij,cj->", coefficients, self.normal, coefficients)
        return float(self.squares + bent - 2.0 * np.sum(coefficients * self.load))
