"""Pixels of known surface and colour, and the sums over them that a linear fit is made of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import numpy as np

from sim.optics.colour.polynomial import monomials
from sim.optics.colour.shading_terms import ShadingTerms
from tacauchy_rig.core.arrays import FloatArray, IntArray, RealArray


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
        position: Normalised pixel position, shape [2, n].
        change: Red, green and blue minus the no-contact colour [grey levels], shape [3, n].
        weights: Of each colour in a fit, zero where it is not known, shape [3, n].
        rest: The unloaded gel, whose colour is in the no-contact frame; None is level gel.
        around: Points beside each pixel whose light the camera's blur mixes in its place, all
            alike; none is a sharp camera.
    """

    gel: SurfacePoints
    position: FloatArray
    change: FloatArray
    weights: FloatArray
    rest: SurfacePoints | None = None
    around: tuple[SurfacePoints, ...] = ()

    def thinned(self, step: int) -> PhotometricSamples:
        """Return every ``step``-th sample."""
        thinned: PhotometricSamples = _each_array([self], lambda arrays: arrays[0][..., ::step])
        return thinned

    def polynomial(self, exponents: IntArray) -> FloatArray:
        """Return the polynomial's monomials as the samples show them, shape [count, n]."""
        return self.seen(lambda at: monomials(at.tilt, self.position, at.indentation_m, exponents))

    def shading(self, terms: ShadingTerms | None) -> FloatArray:
        """Return the values of lamps and creases as the samples show them, shape [count, n]."""
        if terms is None:
            return np.zeros((0, self.position.shape[1]))
        return self.seen(lambda at: terms.values(at.tilt, self.position, at.curvature))

    def seen(self, values: Callable[[SurfacePoints], RealArray]) -> FloatArray:
        """Return the mean of what points give whose light is mixed, less what gel at rest gives.

        Values are linear in light, shape [any, n].
        """
        first, *others = self.around or (self.gel,)
        found = np.asarray(values(first), dtype=np.float64)
        for points in others:
            found += values(points)
        found /= 1 + len(others)
        if self.rest is not None:
            found -= values(self.rest)
        return found


def joined(parts: Sequence[PhotometricSamples]) -> PhotometricSamples:
    """Return the samples of several presses as one."""
    whole: PhotometricSamples = _each_array(parts, partial(np.concatenate, axis=-1))
    return whole


def _each_array(parts: Sequence[Any], made_of: Callable[[Sequence[FloatArray]], FloatArray]) -> Any:
    """Return what is like the parts, of arrays that are made of theirs."""
    first = parts[0]
    if first is None:
        return None
    if isinstance(first, np.ndarray):
        return made_of(parts)
    if isinstance(first, tuple):
        return tuple(_each_array(each, made_of) for each in zip(*parts, strict=True))
    names = [field.name for field in fields(first)]
    found = {n: _each_array([getattr(part, n) for part in parts], made_of) for n in names}
    return replace(first, **found)


@dataclass(frozen=True, slots=True, kw_only=True)
class NormalEquations:
    """Linear least-squares fits of three colours, as sums over samples: those of presses add up.

    Attributes:
        normal: Matrix of each colour's fit, shape [3, n, n].
        load: Its right side, shape [3, n].
        squares: Sum of the squares of all weighted colours.
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
        normal, load, squares = [], [], 0.0
        for change, weight in zip(samples.change, samples.weights, strict=True):
            known, seen = features * weight, change * weight
            normal.append(known @ known.T)
            load.append(known @ seen)
            squares += float(seen @ seen)
        return cls(
            normal=np.stack(normal),
            load=np.stack(load),
            squares=squares,
            sample_count=samples.change.shape[1],
            told_count=int(np.count_nonzero(samples.weights)),
        )

    @classmethod
    def total(cls, parts: Sequence[NormalEquations]) -> NormalEquations:
        """Return the equations of all samples together."""
        names = [field.name for field in fields(cls)]
        return cls(**{name: sum(getattr(part, name) for part in parts) for name in names})

    def solved(self, ridge: float) -> FloatArray:
        """Return each colour's coefficients, shape [3, n].

        The ridge, a weight on their squares per sample, keeps those small that samples do not tell.
        """
        held = self.normal + ridge * self.sample_count * np.eye(self.normal.shape[-1])
        return np.asarray(np.linalg.solve(held, self.load[..., None])[..., 0])

    def misfit(self, coefficients: FloatArray) -> float:
        """Return the squares that coefficients, shape [3, n], leave over [grey levels^2]."""
        bent = np.einsum("ci,cij,cj->", coefficients, self.normal, coefficients)
        return float(self.squares + bent - 2.0 * np.sum(coefficients * self.load))
