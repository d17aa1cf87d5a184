"""Modulus, Poisson's ratio, friction and zeros of depth: least squares, profile likelihoods.

    F_i = E A(d_i + s_k, nu, mu) + e_i,    e ~ N(0, C),    s_k ~ N(0, u_depth^2)

A is force over modulus, from presses of the simulator that a surrogate interpolates: E only scales
them. Each series has one zero of depth s_k. C has the noise of each force, the surrogate's error,
and as relative errors what all points of an indenter share (mesh, sizes, mounting) or all points
(height of the gel, the cell's gain, the law).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Self

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import brentq, least_squares
from scipy.stats import chi2, norm

from reports.evidence.gather_evidence import stated_of_run
from sim.mesh_bias_correction import rules_of
from sim.scene.material import LawName
from sim.scene.scene import ContactMode
from sim.scene.scene_parsing import parse_indenter
from sim.tilt_sensitivity import COARSE, kept_forces
from tacauchy_rig.app.calibration.material.measured_presses import IndenterPresses
from tacauchy_rig.app.replay.simulator_inputs import ReplayInputs
from tacauchy_rig.app.replay.uncertain_inputs import force_inputs
from tacauchy_rig.core.arrays import BoolArray, FloatArray
from tacauchy_rig.core.config.settings import stated_uncertainty
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.parallel import parallel_map
from tacauchy_rig.core.quantities import UNITS, Dimension
from tacauchy_rig.core.simulated import ForceInput

NODES = [(nu, 0.3) for nu in (0.36, 0.42, 0.46, 0.48, 0.495)]
NODES += [(nu, mu) for nu in (0.42, 0.48) for mu in (0.0, 0.1, 1.0)]
OF_OTHER_LAW = 5
"""Poisson's ratios and frictions that are solved; the first few with another law too."""
_SHARES = (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 1.0)
_BEYOND, _STEP, _REFINEMENT, _LEAST_SHARE = 1.15, 0.05, 1.4, 0.02
"""Depths that are solved, of the deepest. It is ``_BEYOND`` times the deepest measured one, rounded
up to a ``_STEP`` of the gel's height: more data may then need no more presses."""
_MESH, _JITTER = 0.01, 0.005
"""Relative standard uncertainties: one that all forces of an indenter share, and one of each force.
From the emulator's forces, those with its law differ by -0.8 to +0.8 % (ball, punch; nu 0.40 to
0.49)."""
_LAWS = LawName.NEO_HOOKEAN, LawName.STABLE_NEO_HOOKEAN
"""The gel's law is not known: what another than the sensor's changes of a force is a standard
uncertainty. A fifth of the gel's height deep that is 0.4 % at nu 0.49; at 0.40 it is 5 % under a
ball and 8 % under a punch."""
_SHARED = ("gain", "gel height", "dome along x", "dome along y", "law")
"""What is the same for all indenters: it is the cell's and the gel's."""
_FITTED = ("Poisson's ratio", "friction")


def _shape(share: FloatArray) -> FloatArray:
    """Return what ln(A / depth) is a sum of: a power law where shallow, bent where deep."""
    log = np.log(share)
    return np.stack([np.ones_like(share), log, log**2, share, share**2], axis=-1)


def _basis(poisson: float, friction: float) -> FloatArray:
    """Return as many functions of nu and mu as there are ``NODES``."""
    n, m = (poisson - 0.44) / 0.08, friction / (friction + 0.3) - 0.5
    of_mu = [m, m**2, m**3]
    return np.array([1.0, n, n**2, n**3, n**4, *of_mu, *(n * each for each in of_mu)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """An indenter's force over the modulus, as a function of depth, nu and mu."""

    deepest_m: float  # depth up to which it was solved [m]
    terms: FloatArray  # coefficients of ``_basis`` times ``_shape``, shape [11, 5]
    # Relative standard uncertainty: of all forces together, and of each [1]
    uncertain: tuple[float, float]
    # Likewise of what another law adds to the logarithm, shape [5, 5]
    other_law: FloatArray
    inputs: tuple[ForceInput, ...] = ()  # what else it depends on

    @classmethod
    def of(cls, depths_m: FloatArray, areas_m2: Sequence[FloatArray]) -> Self:
        """Interpolate forces over modulus [m^2] at depths [m].

        Args:
            areas_m2: Of each of ``NODES``, then of the first ones with another law.
        """
        shape, logs = _shape(depths_m / depths_m.max()), np.log(np.array(areas_m2) / depths_m)
        found = np.linalg.lstsq(shape, logs.T, rcond=None)[0].T
        left = np.sqrt(np.mean((found @ shape.T - logs) ** 2))
        basis, count = np.array([_basis(*node) for node in NODES]), len(NODES)
        added, few = found[count:] - found[:OF_OTHER_LAW], slice(OF_OTHER_LAW)
        return cls(
            deepest_m=float(depths_m.max()),
            terms=np.linalg.solve(basis, found[:count]),
            uncertain=(_MESH, float(np.hypot(_JITTER, left))),
            other_law=np.linalg.solve(basis[few, few], added),
        )

    def area_m2(self, poisson: float, friction: float, depth_m: FloatArray) -> FloatArray:
        """Return force over modulus [m^2] at depths [m]."""
        log = self._shape_at(depth_m) @ (_basis(poisson, friction) @ self.terms)
        return np.asarray(np.maximum(depth_m, 1e-9) * np.exp(log))

    def changed_by_law(self, poisson: float, depth_m: FloatArray) -> FloatArray:
        """Return which part of the force another law adds at depths [m]."""
        of_nu = _basis(poisson, 0.0)[:OF_OTHER_LAW]
        return np.expm1(self._shape_at(depth_m) @ (of_nu @ self.other_law))

    def _shape_at(self, depth_m: FloatArray) -> FloatArray:
        return _shape(np.maximum(depth_m / self.deepest_m, _LEAST_SHARE))


def respond(presses: IndenterPresses, *, jobs: int = 1) -> Response:
    """Solve an indenter's presses. ConvergenceError: One finds no equilibrium."""
    inputs = replace(presses.inputs, sensor=presses.inputs.sensor.with_gel(relaxation=()))
    step_m = _STEP * inputs.sensor.pad.height_m
    deepest_m = _BEYOND * (float(presses.depth_m.max()) + 2.0 * presses.zero_doubt_m)
    depths_m = step_m * np.ceil(deepest_m / step_m) * np.array(_SHARES)
    work = partial(_areas_at, inputs=inputs, depths_m=depths_m)
    own = inputs.sensor.material.law
    other = next(law for law in _LAWS if law != own)
    nodes = [*((*node, own) for node in NODES), *((*node, other) for node in NODES[:OF_OTHER_LAW])]
    areas = [area for _, area in parallel_map(work, nodes, jobs=jobs)]
    tried = force_inputs(inputs, presses.config, depths_m[1:-1].tolist(), found=presses.found)
    known = tuple(each for each in tried if each.name not in _FITTED)
    return replace(Response.of(depths_m, areas), inputs=known)


def gel_of(inputs: ReplayInputs, poisson: float, friction: float) -> ReplayInputs:
    """Return the inputs with another Poisson's ratio and friction."""
    more = poisson - inputs.sensor.material.poisson
    return replace(inputs, sensor=inputs.sensor.with_poisson(more), friction=friction)


def _areas_at(
    node: tuple[float, float, str], *, inputs: ReplayInputs, depths_m: FloatArray
) -> FloatArray:
    gel = gel_of(inputs, *node[:2])
    scene = replace(gel, sensor=gel.sensor.with_gel(law=node[2])).scene([1.0])
    forces = kept_forces(scene, depths_m.tolist(), refinement=_REFINEMENT)
    # The rule of that mesh was fitted without friction; against the emulator it holds with it too.
    frictionless = replace(scene, contact=ContactMode.FRICTIONLESS)
    rule = rules_of(frictionless).get(_REFINEMENT)
    bias = rule.bias(frictionless) if rule else 0.0
    return forces / (1.0 + bias) / inputs.sensor.material.young_pa


LEVEL = float(chi2.ppf(0.95, 1))
NORMAL = 1.959964
YOUNG, NU, MU = 0, 1, 2
"""Places of ln(E / Pa), nu and mu among the parameters; after them each series' zero of depth over
its uncertainty."""
_LOW, _HIGH, _ZERO_MOST = (np.log(1e2), NODES[0][0], 0.0), (np.log(1e10), 0.499, 1.0), 30.0
_STARTS = ((0.41, 0.2), (0.46, 0.5), (0.485, 0.1), (0.49, 0.6))
_SCALES = (0.1, 0.02, 0.2)
_ROUNDS = 3

Data = Sequence[tuple[IndenterPresses, Response]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """Best value and 95 % interval of a profile likelihood."""

    best: float
    low: float | None  # None where smaller values fit as well
    high: float | None  # None where larger values fit as well

    @property
    def uncertainty(self) -> float | None:
        """Standard uncertainty, of the farther end; None where the interval is open."""
        if self.low is None or self.high is None:
            return None
        return max(self.high - self.best, self.best - self.low) / NORMAL

    def holds(self, value: float) -> bool:
        """Return whether a value lies within."""
        return (self.low is None or self.low <= value) and (self.high is None or value <= self.high)


@dataclass(slots=True, kw_only=True)
class GelFit:
    """The gel that forces at depths determine."""

    data: Data  # presses and responses
    # Mean and standard uncertainty of parameters that are assumed, by their place
    priors: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    measured: FloatArray = field(init=False)  # forces [N], shape [point_count]
    covariance: FloatArray = field(init=False)  # of the forces [N^2]
    best: FloatArray = field(init=False)  # parameters with the least chi^2
    misfit: float = field(init=False)  # that chi^2

    def __post_init__(self) -> None:
        """Fit; errors in proportion to a force are to that of the model."""
        self.measured = np.concatenate([presses.force_n for presses, _ in self.data])
        count = 3 + sum(presses.press_count for presses, _ in self.data)
        young = self.data[0][0].inputs.sensor.material.young_pa
        starts = [np.array([np.log(young), nu, mu, *np.zeros(count - 3)]) for nu, mu in _STARTS]
        for start in starts:
            start[YOUNG] += np.log(np.median(self.measured / self.forces(start)))
        for _ in range(_ROUNDS):
            self.covariance = self._covariance(starts[0])
            found = [self.solve(start) for start in starts]
            self.best, self.misfit = min(found, key=lambda each: each[1])
            starts = [self.best]

    def forces(self, parameters: FloatArray) -> FloatArray:
        """Return the forces of all points [N]."""
        first, found = 3, []
        young, nu, mu = np.exp(parameters[YOUNG]), parameters[NU], parameters[MU]
        for presses, response in self.data:
            zeros_m = presses.zero_doubt_m * parameters[first:][presses.press]
            if presses.contact_force_n:
                tried = response.deepest_m * np.linspace(0.0, 1.0, 400)[1:] ** 2
                reached = young * response.area_m2(nu, mu, tried)
                zeros_m = zeros_m + np.interp(presses.contact_force_n, reached, tried)
            found.append(young * response.area_m2(nu, mu, presses.depth_m + zeros_m))
            first += presses.press_count
        return np.concatenate(found)

    @property
    def series_names(self) -> list[str]:
        """What each series is called in messages."""
        return [
            presses.name if presses.press_count == 1 else f"{presses.name}, press {k}"
            for presses, _ in self.data
            for k in range(1, presses.press_count + 1)
        ]

    @property
    def zero_doubts_m(self) -> FloatArray:
        """Standard uncertainty of each series' zero of depth [m]."""
        return np.concatenate([np.full(p.press_count, p.zero_doubt_m) for p, _ in self.data])

    @property
    def zeros_m(self) -> FloatArray:
        """Fitted zero of each series [m]: what is to be added to its depths."""
        return self.zero_doubts_m * self.best[3:]

    def _covariance(self, parameters: FloatArray) -> FloatArray:
        """Return the covariance of all forces around a fit [N^2]."""
        force = self.forces(parameters)
        parts: dict[str, FloatArray] = {}
        each_n = np.zeros(len(force))
        ends = np.cumsum([0, *(len(presses.force_n) for presses, _ in self.data)]).tolist()
        for number, (presses, response) in enumerate(self.data):
            here = slice(ends[number], ends[number + 1])
            each_n[here] = np.hypot(presses.noise_n, response.uncertain[1] * force[here])
            changes: dict[str, float | FloatArray] = {
                "gain": stated_of_run(presses.config, None)["force_scale"].value,
                "mesh": response.uncertain[0],
                "law": response.changed_by_law(float(parameters[NU]), presses.depth_m),
            }
            for each in response.inputs:
                known = each.changes or (0.0,)
                changes[each.name] = np.interp(presses.depth_m, each.depths_m, known)
            for name, change in changes.items():
                common = name if name in _SHARED else f"{name} {number}"
                parts.setdefault(common, np.zeros(len(force)))[here] = change * force[here]
        shared = np.array(list(parts.values()))
        return np.asarray(np.diag(each_n**2) + shared.T @ shared)

    def solve(
        self,
        start: FloatArray,
        fixed: Mapping[int, float] | None = None,
        kept: BoolArray | None = None,
        doubted: int | None = None,
    ) -> tuple[FloatArray, float]:
        """Return the best parameters and their chi^2, of forces, zeros of depth and priors.

        Args:
            fixed: Parameters that are not fitted, by their place.
            kept: Which forces count; all if absent.
            doubted: Place of a zero of depth whose stated uncertainty does not count.
        """
        whole, free = start.copy(), np.setdiff1d(np.arange(len(start)), list(fixed or ()))
        whole[list(fixed or ())] = list((fixed or {}).values())
        zeros = np.full(len(start) - 3, _ZERO_MOST)
        low, high = np.concatenate([_LOW, -zeros]), np.concatenate([_HIGH, zeros])
        scales = np.concatenate([_SCALES, np.ones(len(zeros))])
        kept = np.ones(len(self.measured), np.bool_) if kept is None else kept
        factor = cholesky(self.covariance[np.ix_(kept, kept)], lower=True)
        stated = np.arange(3, len(start)) != doubted

        def off(x: FloatArray) -> FloatArray:
            whole[free] = x
            left = solve_triangular(factor, (self.measured - self.forces(whole))[kept], lower=True)
            assumed = [(whole[k] - mean) / sd for k, (mean, sd) in self.priors.items()]
            return np.concatenate([left, stated * whole[3:], assumed])

        inside = np.clip(whole, low + 1e-3 * scales, high - 1e-3 * scales)
        within, enough = (low[free], high[free]), {"ftol": 1e-6, "xtol": 1e-6}
        found = least_squares(off, inside[free], bounds=within, x_scale=scales[free], **enough)
        whole[free] = found.x
        return whole, 2.0 * float(found.cost)

    def interval(self, place: int) -> Interval:
        """Return a parameter's interval; that of ``YOUNG`` is of E [Pa]."""
        values = [float(self.best[place]), *(self._end(place, sign) for sign in (-1.0, 1.0))]
        if place == YOUNG:
            values = [None if value is None else float(np.exp(value)) for value in values]
        return Interval(best=values[0] or 0.0, low=values[1], high=values[2])

    def _end(self, place: int, sign: float) -> float | None:
        def above(value: float) -> float:
            return self.solve(self.best, {place: value})[1] - self.misfit - LEVEL

        inside, step = float(self.best[place]), 0.5 * _SCALES[place]
        bound = (_LOW if sign < 0.0 else _HIGH)[place]
        if above(bound) <= 0.0:
            return None
        while True:
            tried = sign * min(sign * (inside + sign * step), sign * bound)
            if tried == bound or above(tried) > 0.0:
                return float(brentq(above, inside, tried, xtol=1e-2 * _SCALES[place]))
            inside, step = tried, 2.0 * step

    def slopes(self, parameters: FloatArray) -> FloatArray:
        """Return the derivatives of ``forces`` by all parameters, shape [point_count, ...]."""
        steps = np.diag(1e-3 * np.concatenate([_SCALES, np.ones(len(parameters) - 3)]))
        sides = [(self.forces(parameters + by), self.forces(parameters - by)) for by in steps]
        changes = [up - down for up, down in sides]
        return np.asarray(np.transpose(changes) / (2.0 * np.diag(steps)))


def gel_to_write(fit: GelFit, told: Sequence[Interval]) -> tuple[GelFit, Interval, Interval]:
    """Return the fit, E and nu of the sensor's file; nu is open where the file keeps its own.

    A stated nu or mu counts unless it is determined or excluded: with a nu that the forces exclude,
    the file would not predict them. The open end of nu's interval is then that of the fit's range.
    """
    presses, nu = fit.data[0][0], told[NU]
    stated = presses.inputs.sensor.numbers["material.poisson"]
    rubbing = stated_uncertainty(presses.config, "friction").value
    beliefs = {NU: (stated.value, stated.uncertainty), MU: (presses.inputs.friction, rubbing)}
    taken = [k for k in beliefs if told[k].uncertainty is None and told[k].holds(beliefs[k][0])]
    written = GelFit(data=fit.data, priors={k: beliefs[k] for k in taken})
    young = written.interval(YOUNG)
    kept = {NU: float(np.clip(stated.value, _LOW[NU], _HIGH[NU]))} if NU in taken else {}
    nu = nu if kept else replace(nu, low=nu.low or _LOW[NU], high=nu.high or _HIGH[NU])
    written.best, _ = written.solve(written.best, kept)
    young_pa, ratio = float(np.exp(written.best[YOUNG])), float(written.best[NU])
    return written, replace(young, best=young_pa), replace(nu, best=ratio)


_RANGES = np.subtract(_HIGH, _LOW)
_RANGES[YOUNG] = 1.0
"""Of ln E a factor of e, and what is possible of Poisson's ratio and friction."""


def _information(slopes: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the inverse of all parameters' covariance; nu and mu lie anywhere in their ranges."""
    believed = np.ones(slopes.shape[1])
    believed[: MU + 1] = 12.0 / _RANGES**2
    believed[YOUNG] = 0.0
    return np.asarray(slopes.T @ np.linalg.solve(covariance, slopes) + np.diag(believed))


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOutForce:
    """A force that the others predict [N]; ``expanded_n`` is half of its 95 % interval."""

    point: str
    force_n: float
    predicted_n: float
    expanded_n: float

    @property
    def held(self) -> bool:
        """Whether the interval holds the force."""
        return abs(self.off) <= NORMAL

    @property
    def off(self) -> float:
        """Difference to the prediction over the latter's standard uncertainty."""
        return NORMAL * (self.force_n - self.predicted_n) / self.expanded_n

    def __str__(self) -> str:
        return (
            f"{self.point}: {self.force_n:.4g} N, where the others predict "
            f"{self.predicted_n:.4g} +- {self.expanded_n:.2g} N (95 %)"
        )


def predict_left_out(fit: GelFit) -> Iterator[LeftOutForce]:
    """Yield each force as all others predict it, with the errors that they share.

    (Universal kriging: Cressie, Statistics for Spatial Data, 1993, sec. 3.4.)
    """
    names = [name for presses, _ in fit.data for name in presses.point_names]
    for k, name in enumerate(names if len(names) > 1 else ()):
        others = np.arange(len(names)) != k
        found, _ = fit.solve(fit.best, kept=others)
        force, slopes = fit.forces(found), fit.slopes(found)
        shared = fit.covariance[others, k]
        weights = np.linalg.solve(fit.covariance[np.ix_(others, others)], shared)
        steep = slopes[k] - weights @ slopes[others]
        known = _information(slopes[others], fit.covariance[np.ix_(others, others)])
        variance = fit.covariance[k, k] - weights @ shared + steep @ np.linalg.solve(known, steep)
        yield LeftOutForce(
            point=name,
            force_n=float(fit.measured[k]),
            predicted_n=float(force[k] + weights @ (fit.measured - force)[others]),
            expanded_n=NORMAL * float(np.sqrt(variance)),
        )


_FALSE_ALARM, _FALSE_ZERO = 1e-3, 5e-3
"""Of right data that are refused for their misfit, and for a zero of depth. With the former a zero
0.2 mm off would pass about one time in fifty under a ball on a gel of 0.05 to 0.06 MPa."""
_SOFTEST_PA, _STIFFEST_PA = 10e3, 3e6  # of silicone gels: outside, forces are not in newtons
_SURPRISING, _ODD, _ALIKE = 3.0, 4.0, 0.9


def other_unit(fit: GelFit) -> str | None:
    """Return what explains a modulus that no gel has, or one far from the sensor's file."""
    young, stated = float(np.exp(fit.best[YOUNG])), fit.data[0][0].inputs.sensor.material.young_pa
    units = UNITS[Dimension.FORCE]
    off = {unit: abs(np.log(by * young / stated)) for unit, by in units.items()}
    if off.pop("N") < np.log(_ODD):
        return None
    least = min(off.values())
    near = [unit for unit in sorted(off, key=lambda u: off[u]) if off[unit] < least + _ALIKE]
    others = " or ".join(f"{each}: {units[each] * young * 1e-6:.3g} MPa" for each in near)
    return (
        f"E would be {young * 1e-6:.3g} MPa, and {stated * 1e-6:.3g} MPa is stated; with forces in "
        f"{others}"
    )


def contradictions(fit: GelFit, left_out: Sequence[LeftOutForce]) -> list[str]:
    """Return what of the data contradicts their stated errors, in a sentence each."""
    found, young = [], float(np.exp(fit.best[YOUNG]))
    if not _SOFTEST_PA <= young <= _STIFFEST_PA:
        found.append(other_unit(fit) or f"E would be {young * 1e-6:.3g} MPa, which no gel has")
    found += _wrong_zeros(fit)
    degrees = len(fit.measured) - 1
    surprises = [2.0 * float(norm.sf(abs(each.off))) * len(left_out) for each in left_out]
    misfits = degrees > 0 and float(chi2.sf(fit.misfit, degrees)) < _FALSE_ALARM
    if misfits or min(surprises, default=1.0) < _FALSE_ALARM:
        found.append(
            f"chi^2 {fit.misfit:.1f} of {len(fit.measured)} forces is beyond the stated errors: a "
            "wrong zero of depth, indenter or unit, or errors larger than stated (--noise, "
            "uncertainty.*)"
        )
        worst = sorted(left_out, key=lambda each: -abs(each.off))
        named = [each for each in worst if abs(each.off) > _SURPRISING] or worst[:1]
        found += [str(each) for each in named]
    return found


def _wrong_zeros(fit: GelFit) -> Iterator[str]:
    """Yield each series that fits far better with a zero of depth beyond its uncertainty."""
    for k, name in enumerate(names := fit.series_names, start=3):
        freed, left = fit.solve(fit.best, doubted=k)
        if len(names) * float(chi2.sf(fit.misfit - left, 1)) < _FALSE_ZERO:
            yield (
                f"{name}: its depths fit with {freed[k] * fit.zero_doubts_m[k - 3] * 1e3:+.3f} mm "
                f"added, and their zero is stated to {fit.zero_doubts_m[k - 3] * 1e3:.3f} mm "
                "(uncertainty.depth)"
            )


CANDIDATES = (
    "sphere:diameter=4mm",
    "sphere:diameter=10mm",
    "cylinder:diameter=3mm,fillet=0.5mm",
    "cylinder:diameter=5mm,fillet=0.5mm",
    "cylinder:diameter=8mm,fillet=0.5mm",
)
_DEPTH_SHARES = (0.05, 0.1, 0.15, 0.2)  # of the gel's height: to what candidates may be pressed
_OWN, _EACH = 0.015, 0.01
"""Relative doubt of a candidate's forces: of all together (sizes, mounting, mesh), and of each."""
_STEPS = (-0.01, 0.1)  # of Poisson's ratio and friction, for what they change of a candidate


@dataclass(frozen=True, slots=True, kw_only=True)
class NextPress:
    """What one more press would leave uncertain."""

    indenter: str
    depth_m: float  # to which it would be pressed [m]
    widest: str  # what is least certain now, of what is possible
    # Standard uncertainties: of ln E, nu and mu
    now: tuple[float, ...]
    left: tuple[float, ...]

    def __str__(self) -> str:
        young, nu, mu = (
            f"{was:{form}} to {left:{form}}"
            for was, left, form in zip(self.now, self.left, (".1%", ".3f", ".2f"), strict=True)
        )
        return (
            f"{self.indenter} to {self.depth_m * 1e3:.2g} mm, for {self.widest}: it would reduce "
            f"the standard uncertainties of E from {young}, of nu from {nu}, of mu from {mu}"
        )


def next_presses(fit: GelFit) -> list[NextPress]:
    """Return what a press with each other indenter, to its best depth, would leave uncertain.

    The first reduces most what is least certain now (linearised). More presses with the same
    indenter share what is wrong with those that there are.
    """
    known = np.linalg.inv(_information(fit.slopes(fit.best), fit.covariance))[: MU + 1, : MU + 1]
    now = np.sqrt(np.diag(known))
    widest = int(np.argmax(now / _RANGES))
    presses, have = fit.data[0][0], {each.name for each, _ in fit.data}
    inputs = replace(presses.inputs, sensor=presses.inputs.sensor.with_gel(relaxation=()))
    depths = inputs.sensor.pad.height_m * np.array(_DEPTH_SHARES)
    found = []
    for text in (text for text in CANDIDATES if text not in have):
        try:
            force, slopes = _candidate(replace(inputs, indenter=parse_indenter(text)), fit, depths)
        except RigError:
            continue  # what cannot be pressed coarsely is no advice
        steep = presses.zero_doubt_m * np.gradient(force, depths) / force
        tells = slopes @ known  # rank-one updates of the covariance
        variance = _OWN**2 + _EACH**2 + steep**2 + np.sum(tells * slopes, axis=1)
        left = known - np.einsum("di,dj,d->dij", tells, tells, 1.0 / variance)
        best = int(np.argmin(left[:, widest, widest]))
        found.append(
            NextPress(
                indenter=text,
                depth_m=float(depths[best]),
                widest=("E", "nu", "mu")[widest],
                now=tuple(now.tolist()),
                left=tuple(np.sqrt(np.diag(left[best])).tolist()),
            )
        )
    return sorted(found, key=lambda each: each.left[widest])


def _candidate(
    tool: ReplayInputs, fit: GelFit, depths_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return forces [N] and what ln E, nu and mu change of their logarithm, shape [depths, 3].

    At the solved node that is nearest, so that it is kept for fits to come.
    """
    nu, mu = min(NODES[1:4], key=lambda node: abs(node[0] - fit.best[NU]))
    others = ((nu, mu), (nu + _STEPS[0], mu), (nu, mu + _STEPS[1]))
    base, *changed = (
        kept_forces(gel_of(tool, *each).scene([1.0]), depths_m.tolist(), refinement=COARSE)
        for each in others
    )
    slopes = [(other / base - 1.0) / step for other, step in zip(changed, _STEPS, strict=True)]
    return base, np.stack([np.ones_like(base), *slopes], axis=1)
