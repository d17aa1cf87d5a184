"""Likelihood of modulus, Poisson's ratio and friction: generalised least squares.

    chi^2 = r^T C^-1 r,    r = F - E A(depth, nu, mu)

C has the noise of each force; for each press the doubt of its depth, which all its points share;
and as relative errors what all points of an indenter share (mesh, sizes, mounting) or all points
(height of the gel, the cell's gain). The modulus that is best at given nu and mu is linear in the
forces. Held-out presses are predicted by the others, and the next press that would help most is
found.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import chi2

from reports.evidence.loading import stated_of_run
from sim.scene.scene import Preset
from sim.scene.terms import parse_indenter
from sim.sensitivity import COARSE, FINER, forces_at
from tacauchy_rig.app.calibration.material.presses import POINTS_MIN, IndenterPresses
from tacauchy_rig.app.replay.inputs import ReplayInputs
from tacauchy_rig.app.replay.uncertainty import force_inputs
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.config.uncertainty import stated_uncertainty
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.parallel import parallel_map
from tacauchy_rig.core.simulated import ForceInput

POISSON = (0.40, 0.43, 0.455, 0.475, 0.49)
FRICTION = (0.0, 0.1, 0.3, 0.6, 1.0)
"""Nodes that are solved. Above 0.49 preset fast takes other edges; full sticking is hardly
distinguishable from friction 1."""
_DEPTHS = (0.04, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 1.0)
"""Of the deepest, which lies beyond the deepest measured one by as much as contact may be deep."""
_BEYOND = 1.1
_LEFT_SHARE, _LEFT_LEAST, _UNCORRECTED = 0.5, 0.005, 0.015
"""Of what preset balanced changes, so much may be wrong with it still, and at least so much.
Without it: what a ring of elements more or less changes of a force, as height or size change."""
_SHARED = ("gel height", "dome along x", "dome along y")
"""Inputs that are the same for all indenters: they are the gel's."""
FITTED = ("Poisson's ratio", "friction")


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """An indenter's force over the modulus [m^2].

    Attributes:
        depth_m: From first touch, from 0 on, shape [depth_count] [m].
        area_m2: At the nodes, shape [poisson_count, friction_count, depth_count].
        uncertain: Relative standard uncertainty left of the mesh [1].
        inputs: What else it depends on.
    """

    depth_m: FloatArray
    area_m2: FloatArray
    uncertain: float
    inputs: tuple[ForceInput, ...]

    def at(self, poisson: FloatArray, friction: FloatArray, depth_m: FloatArray) -> FloatArray:
        """Return force over modulus, shape [poisson_count, friction_count, point_count]."""
        logs = np.log(self.area_m2[..., 1:] / self.depth_m[1:])
        logs = CubicSpline(POISSON, logs, axis=0)(poisson)
        logs = PchipInterpolator(FRICTION, logs, axis=1)(friction)
        # Of depth's logarithm it is a line for a ball, none for a punch.
        spline = PchipInterpolator(np.log(self.depth_m[1:]), logs, axis=2, extrapolate=True)
        return np.asarray(np.exp(spline(np.log(depth_m))) * depth_m)


def respond(presses: IndenterPresses, *, jobs: int = 1, correct: bool = True) -> Response:
    """Solve an indenter's presses.

    Args:
        presses: How deep, and of what.
        jobs: Processes.
        correct: Press once on preset balanced, and correct all by it.

    Raises:
        ConvergenceError: One finds no equilibrium.
    """
    inputs = replace(presses.inputs, sensor=presses.inputs.sensor.relaxing(()))
    depths_m = _BEYOND * float(presses.depth_m.max()) * np.array(_DEPTHS)
    nodes = list(product(POISSON, FRICTION))
    work = partial(_forces_at_node, inputs=inputs, depths_m=tuple(depths_m.tolist()))
    forces = np.array([f for _, f in parallel_map(work, nodes, jobs=jobs, new_process_each=False)])
    ratio, left = np.ones(len(depths_m)), _UNCORRECTED
    if correct:
        ratio, left = _too_stiff(inputs, depths_m)
    area = (forces * ratio / inputs.sensor.material.young_pa).reshape(
        len(POISSON), len(FRICTION), -1
    )
    measured = np.unique(presses.depth_m)
    tried = force_inputs(inputs, presses.config, measured.tolist(), found=presses.found)
    return Response(
        depth_m=np.concatenate([[0.0], depths_m]),
        area_m2=np.concatenate([np.zeros((*area.shape[:2], 1)), area], axis=2),
        uncertain=left,
        inputs=tuple(each for each in tried if each.name not in FITTED),
    )


def gel_of(inputs: ReplayInputs, poisson: float, friction: float) -> ReplayInputs:
    """Return the inputs with another Poisson's ratio and friction."""
    more = poisson - inputs.sensor.material.poisson
    return replace(inputs, sensor=inputs.sensor.with_poisson(more), friction=friction)


def _forces_at_node(
    node: tuple[float, float], *, inputs: ReplayInputs, depths_m: Sequence[float]
) -> FloatArray:
    scene = gel_of(inputs, *node).scene([1.0])
    return forces_at(scene, depths_m, refinement=FINER)


def _too_stiff(inputs: ReplayInputs, depths_m: FloatArray) -> tuple[FloatArray, float]:
    scene = replace(inputs, preset=Preset.BALANCED).scene([1.0])
    fine = forces_at(replace(scene, outputs=frozenset()), depths_m.tolist())
    ratio = fine / forces_at(inputs.scene([1.0]), depths_m.tolist(), refinement=FINER)
    return ratio, max(_LEFT_LEAST, _LEFT_SHARE * float(np.abs(ratio - 1.0).mean()))


NU = np.linspace(POISSON[0], POISSON[-1], 91)
MU = np.linspace(FRICTION[0], FRICTION[-1], 41)
"""Where the likelihood is evaluated."""
LEVEL = float(chi2.ppf(0.95, 1))
_ROUNDS = 4
_SLOPE_SHARE = 0.01
_JITTER = 0.005
"""Relative, of each force: contact that grows from point to point of a mesh, and interpolation."""
NORMAL = 1.959964
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
    def uncertainty(self) -> float | None:
        """Standard uncertainty; None where the interval is open."""
        if self.low is None or self.high is None:
            return None
        return (self.high - self.low) / (2.0 * NORMAL)

    @property
    def is_bounded(self) -> bool:
        """Whether the interval is closed."""
        return self.uncertainty is not None

    def holds(self, value: float) -> bool:
        """Return whether a value lies within."""
        return (self.low is None or self.low <= value) and (self.high is None or value <= self.high)


@dataclass(frozen=True, slots=True, kw_only=True)
class GelFit:
    """The gel that forces at depths determine.

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
            [
                response.at(NU, MU, _depths(presses, response, young, place))
                for presses, response in data
            ],
            axis=2,
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
        for name in ("gain", *(each.name for each in response.inputs if each.name in _SHARED)):
            shared.setdefault(name, np.zeros(ends[-1]))[here] = parts.pop(name)
        total[here, here] = block + sum(np.outer(part, part) for part in parts.values())
    return total + sum(np.outer(part, part) for part in shared.values())


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
                    expanded_n=NORMAL * float(np.hypot(error[k], np.sqrt(own[k]))),
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
