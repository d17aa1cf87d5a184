"""Held-out presses predicted by the others, and the next press that would help most."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.scene.terms import parse_indenter
from sim.sensitivity import COARSE, forces_at
from tacauchy_rig.app.calibration.material.fit import MU, NU, Data, GelFit, fit_gel, gel_of
from tacauchy_rig.app.calibration.material.presses import POINTS_MIN
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.config.uncertainty import stated_uncertainty
from tacauchy_rig.core.errors import RigError

_NORMAL = 1.959964
CANDIDATES = (
    "sphere:diameter=4mm",
    "sphere:diameter=10mm",
    "cylinder:diameter=3mm,fillet=0.5mm",
    "cylinder:diameter=5mm,fillet=0.5mm",
    "cylinder:diameter=8mm,fillet=0.5mm",
)
_DEPTH_SHARES = (0.05, 0.1, 0.15, 0.2)
"""Of the gel's height: to what candidates are pressed."""
_OWN, _EACH = 0.015, 0.01
"""Relative doubt of a candidate's forces: of all together (sizes, mounting, mesh), and of each."""
_STEPS = (-0.01, 0.1)
"""Of Poisson's ratio and friction, for what they change of a candidate."""
_BELIEVED = (0.0, 0.05, 0.5)
"""What anybody knows of log modulus (nothing), Poisson's ratio and friction of a gel."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutForce:
    """A force that the fit did not see [N]; ``expanded_n`` is half of its 95 % interval."""

    indenter: str
    depth_m: float
    force_n: float
    predicted_n: float
    expanded_n: float

    @property
    def held(self) -> bool:
        """Whether the interval holds the force."""
        return abs(self.predicted_n - self.force_n) <= self.expanded_n


def predict_held_out(data: Data, fit: GelFit) -> Iterator[HeldOutForce]:
    """Yield the points of each press as the other presses predict them.

    Where an indenter has one press alone, the other indenters do. Nothing where too few are left.
    """
    start = 0
    for number, (presses, response) in enumerate(data):
        for press in np.unique(presses.press):
            out = presses.press == press
            others = [pair for k, pair in enumerate(data) if k != number]
            if not out.all():
                others.append((presses.only(~out), response))
            if sum(len(each.force_n) for each, _ in others) < POINTS_MIN:
                continue
            places = start + np.flatnonzero(out)
            mean, error = _predicted(fit_gel(others), fit.areas_m2[..., places])
            own = fit.covariance[places, places]
            for k, place in enumerate(np.flatnonzero(out)):
                yield HeldOutForce(
                    indenter=presses.name,
                    depth_m=float(presses.depth_m[place]),
                    force_n=float(presses.force_n[place]),
                    predicted_n=float(mean[k]),
                    expanded_n=_NORMAL * float(np.hypot(error[k], np.sqrt(own[k]))),
                )
        start += len(presses.force_n)


def _predicted(fit: GelFit, areas_m2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of forces [N] over all gels, by their likelihood."""
    likely = np.exp(-0.5 * (fit.misfit - fit.misfit.min()))
    likely = (likely / likely.sum())[..., None]
    forces = fit.young_pa[..., None] * areas_m2
    mean = np.sum(likely * forces, axis=(0, 1))
    spread = (forces - mean) ** 2 + (fit.young_error_pa[..., None] * areas_m2) ** 2
    return mean, np.sqrt(np.sum(likely * spread, axis=(0, 1)))


@dataclass(frozen=True, slots=True, kw_only=True)
class NextPress:
    """What presses with an indenter, four of up to a fifth of the gel's height, would leave.

    Attributes:
        young: Relative standard uncertainty of the modulus.
        poisson: Standard uncertainty of Poisson's ratio.
    """

    indenter: str
    young: float
    poisson: float

    def __str__(self) -> str:
        return f"{self.indenter} would leave {self.young:.1%} of E and {self.poisson:.3f} of nu"


def next_presses(data: Data, fit: GelFit) -> list[NextPress]:
    """Return other indenters, the one that leaves the least of the modulus uncertain first.

    More presses with the same one share what is wrong with those that there are.
    """
    nu, mu = fit.best
    known = _information(_slopes(fit), fit.covariance)
    inputs = gel_of(data[0][0].inputs, float(NU[nu]), float(MU[mu]))
    inputs = replace(inputs, sensor=inputs.sensor.relaxing(()))
    depths = (inputs.sensor.pad.height_m * np.array(_DEPTH_SHARES)).tolist()
    found = []
    doubt_m = stated_uncertainty(data[0][0].config, "depth").value
    have = {presses.name for presses, _ in data}
    for text in (text for text in CANDIDATES if text not in have):
        tool = replace(inputs, indenter=parse_indenter(text))
        try:
            base, other, rougher = (
                forces_at(each.scene([1.0]), depths, refinement=COARSE)
                for each in (
                    tool,
                    gel_of(tool, float(NU[nu]) + _STEPS[0], tool.friction),
                    replace(tool, friction=tool.friction + _STEPS[1]),
                )
            )
        except RigError:
            continue  # what cannot be pressed coarsely is no advice
        slopes = [np.ones_like(base), (other / base - 1.0) / _STEPS[0]]
        slopes.append((rougher / base - 1.0) / _STEPS[1])
        steep = doubt_m * np.gradient(base, depths) / base
        covariance = np.diag(_EACH**2 + steep**2) + _OWN**2
        left = np.linalg.inv(known + _information(np.array(slopes).T, covariance))
        found.append(
            NextPress(indenter=text, young=float(left[0, 0]) ** 0.5, poisson=left[1, 1] ** 0.5)
        )
    return sorted(found, key=lambda each: each.young)


def _slopes(fit: GelFit) -> FloatArray:
    """Return what log modulus, nu and mu change of the forces [N], shape [point_count, 3]."""
    nu, mu = fit.best
    forces = fit.young_pa[nu, mu] * fit.areas_m2
    along = [np.gradient(forces[:, mu], NU, axis=0)[nu], np.gradient(forces[nu], MU, axis=0)[mu]]
    return np.stack([forces[nu, mu], *along], axis=1)


def _information(slopes: FloatArray, covariance: FloatArray) -> FloatArray:
    believed = np.diag([0.0 if doubt == 0.0 else doubt**-2 for doubt in _BELIEVED])
    return np.asarray(slopes.T @ np.linalg.solve(covariance, slopes) + believed)


def held_count(left_out: Sequence[HeldOutForce]) -> tuple[int, int]:
    """Return how many forces lie within their interval, and how many there are."""
    return sum(each.held for each in left_out), len(left_out)
