"""Likelihood of modulus, Poisson's ratio and friction: generalised least squares.

    chi^2 = r^T C^-1 r,    r = F - E A(depth, nu, mu)

C has the noise of each force; for each press the doubt of its depth, which all its points share;
and as relative errors what all points of an indenter share (mesh, sizes, mounting) or all points
(height of the gel, the cell's gain). The modulus that is best at given nu and mu is linear in the
forces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import chi2

from reports.evidence.loading import stated_of_run
from tacauchy_rig.app.calibration.material.presses import IndenterPresses
from tacauchy_rig.app.calibration.material.response import FRICTION, POISSON, Response, is_shared
from tacauchy_rig.core.arrays import FloatArray

NU = np.linspace(POISSON[0], POISSON[-1], 91)
MU = np.linspace(FRICTION[0], FRICTION[-1], 41)
"""Where the likelihood is evaluated."""
LEVEL = float(chi2.ppf(0.95, 1))
_ROUNDS = 4
_SLOPE_SHARE = 0.01
_JITTER = 0.005
"""Relative, of each force: contact that grows from point to point of a mesh, and interpolation."""
_NORMAL = 1.959964
_YOUNG_STEPS, _YOUNG_SPAN = 161, 3.0
"""Of the profile of the modulus: so many values, to so many times either way."""

Data = Sequence[tuple[IndenterPresses, Response]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """Best value and 95 % interval of a profile likelihood.

    Attributes:
        low: None where the interval is open: smaller values do as well.
        high: None likewise.
    """

    best: float
    low: float | None
    high: float | None

    @property
    def is_told(self) -> bool:
        """Whether the interval is closed."""
        return self.low is not None and self.high is not None

    @property
    def uncertainty(self) -> float | None:
        """Standard uncertainty; None where the interval is open."""
        if self.low is None or self.high is None:
            return None
        return (self.high - self.low) / (2.0 * _NORMAL)

    def holds(self, value: float) -> bool:
        """Return whether a value lies within."""
        return (self.low is None or self.low <= value) and (self.high is None or value <= self.high)


@dataclass(frozen=True, slots=True, kw_only=True)
class GelFit:
    """What forces tell of a gel.

    Attributes:
        young_pa: Best modulus at each nu and mu, shape [NU, MU] [Pa].
        young_error_pa: Its standard uncertainty there.
        misfit: chi^2 there.
        covariance: Of the forces [N^2].
        areas_m2: Force over modulus there, shape [NU, MU, point_count].
        point_count: Forces.
    """

    young_pa: FloatArray
    young_error_pa: FloatArray
    misfit: FloatArray
    covariance: FloatArray
    areas_m2: FloatArray
    point_count: int

    @property
    def best(self) -> tuple[int, int]:
        """Place of the smallest chi^2."""
        nu, mu = np.unravel_index(int(self.misfit.argmin()), self.misfit.shape)
        return int(nu), int(mu)

    @property
    def poisson(self) -> Interval:
        """Of Poisson's ratio, whatever modulus and friction are."""
        return interval(NU, self.misfit.min(axis=1))

    @property
    def friction(self) -> Interval:
        """Of the friction coefficient."""
        return interval(MU, self.misfit.min(axis=0))

    @property
    def young(self) -> Interval:
        """Of the modulus [Pa]."""
        values = self.young_values
        return interval(values, self.valley(values).min(axis=1))

    @property
    def young_values(self) -> FloatArray:
        """Moduli at which profiles are taken [Pa]."""
        middle = float(self.young_pa[self.best])
        return middle * np.geomspace(1.0 / _YOUNG_SPAN, _YOUNG_SPAN, _YOUNG_STEPS)

    def valley(self, young_pa: FloatArray) -> FloatArray:
        """Return chi^2 of moduli and Poisson's ratios, shape [young_count, NU]; best friction."""
        off = (young_pa[:, None, None] - self.young_pa) / self.young_error_pa
        return np.asarray((self.misfit + off**2).min(axis=2))


def interval(values: FloatArray, profile: FloatArray) -> Interval:
    """Return where a profile rises by the 95 % level over its least."""
    above = profile - profile.min() - LEVEL
    k = int(profile.argmin())
    return Interval(
        best=float(values[k]),
        low=_crossing(values[k::-1], above[k::-1]),
        high=_crossing(values[k:], above[k:]),
    )


def _crossing(values: FloatArray, above: FloatArray) -> float | None:
    beyond = np.flatnonzero(above > 0.0)
    if not len(beyond):
        return None
    k = int(beyond[0])
    return float(np.interp(0.0, above[k - 1 : k + 1], values[k - 1 : k + 1]))


def fit_gel(data: Data, *, prior: tuple[float, float] | None = None) -> GelFit:
    """Fit a gel to all points of all indenters.

    Args:
        data: Presses and responses.
        prior: Poisson's ratio as stated, and its standard uncertainty, if it is to count.
    """
    young, place = float(data[0][0].inputs.sensor.material.young_pa), (len(NU) // 2, len(MU) // 2)
    measured = np.concatenate([presses.force_n for presses, _ in data])
    beliefs = 0.0 if prior is None else (((NU - prior[0]) / prior[1]) ** 2)[:, None]
    for _ in range(_ROUNDS):  # errors in proportion to a force are to that of the model
        areas = np.concatenate(
            [_areas(presses, response, young, place) for presses, response in data], axis=2
        )
        covariance = _covariance(data, young, place)
        factor = cho_factor(covariance)
        flat = areas.reshape(-1, len(measured)).T
        weighted = cho_solve(factor, flat)
        curvature = np.sum(flat * weighted, axis=0)
        best = (measured @ weighted) / curvature
        left = measured @ cho_solve(factor, measured) - curvature * best**2
        misfit = left.reshape(len(NU), len(MU)) + beliefs
        fit = GelFit(
            young_pa=best.reshape(misfit.shape),
            young_error_pa=(1.0 / np.sqrt(curvature)).reshape(misfit.shape),
            misfit=misfit,
            covariance=covariance,
            areas_m2=areas,
            point_count=len(measured),
        )
        place = fit.best
        young = float(fit.young_pa[place])
    return fit


def _depths(
    presses: IndenterPresses, response: Response, young: float, at: tuple[int, int]
) -> FloatArray:
    """Return depths from first touch on [m]."""
    nu, mu = NU[at[0] : at[0] + 1], MU[at[1] : at[1] + 1]
    if not presses.contact_force_n:
        return presses.depth_m
    tried = np.linspace(0.0, float(response.depth_m[-1]), 400)[1:]
    forces = young * response.at(nu, mu, tried)[0, 0]
    touched = np.interp(presses.contact_force_n, forces, tried)
    return presses.depth_m + float(touched)


def _areas(
    presses: IndenterPresses, response: Response, young: float, at: tuple[int, int]
) -> FloatArray:
    return response.at(NU, MU, _depths(presses, response, young, at))


def _covariance(data: Data, young: float, at: tuple[int, int]) -> FloatArray:
    """Return the covariance of all forces around a modulus, nu and mu [N^2]."""
    nu, mu = NU[at[0] : at[0] + 1], MU[at[1] : at[1] + 1]
    sizes = [len(presses.force_n) for presses, _ in data]
    ends = np.cumsum([0, *sizes])
    total = np.zeros((ends[-1], ends[-1]))
    shared: dict[str, FloatArray] = {}
    for (presses, response), start in zip(data, ends, strict=False):
        here = slice(int(start), int(start) + len(presses.force_n))
        depth = _depths(presses, response, young, at)
        force = young * response.at(nu, mu, depth)[0, 0]
        more = young * response.at(nu, mu, (1.0 + _SLOPE_SHARE) * depth)[0, 0]
        stated = stated_of_run(presses.config, None)
        doubt = (more - force) / (_SLOPE_SHARE * depth) * stated["depth"].value
        same = presses.press[:, None] == presses.press
        block = np.diag(presses.noise_n**2 + (_JITTER * force) ** 2) + np.outer(doubt, doubt) * same
        parts = {"mesh": response.uncertain * force, "gain": stated["force_scale"].value * force}
        for each in response.inputs:
            change = np.interp(presses.depth_m, each.depths_m, each.changes or (0.0,))
            parts[each.name] = change * force
        for name in ("gain", *(each.name for each in response.inputs if is_shared(each))):
            shared.setdefault(name, np.zeros(ends[-1]))[here] = parts.pop(name)
        total[here, here] = block + sum(np.outer(part, part) for part in parts.values())
    return total + sum(np.outer(part, part) for part in shared.values())
