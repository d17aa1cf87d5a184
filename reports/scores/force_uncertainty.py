"""Two different claims about force, and what is known of the error of either.

Force-matched (the paper): the simulated indenter moved until F_z agreed, so agreement is by
construction and the depth is the outcome. Force-predicted: the depth that was measured, F_z read
off the simulator, so the force is the outcome. Only the second tests the simulator's force.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from reports.evidence.evidence_types import TrialEvidence
from reports.scores.confidence_interval import student_t
from tacauchy_rig.core.config.settings import Stated
from tacauchy_rig.core.run import FZ
from tacauchy_rig.core.simulated import ForceDepthCurve, ForceInput, ReplayModel


class TermGroup(StrEnum):
    """Where an uncertainty enters, after ASME V&V 20."""

    NUMERICS = "numerics"
    INPUTS = "inputs"
    DATA = "data"


@dataclass(frozen=True, slots=True)
class UncertaintyTerm:
    """One line of the budget."""

    name: str
    group: TermGroup
    value_n: float | None  # standard uncertainty of the force [N]; None when nobody has measured it
    basis: str  # how the value is known, or why it is not
    degrees_of_freedom: float | None = None  # None where its uncertainty is taken as known


@dataclass(frozen=True, slots=True, kw_only=True)
class Combined:
    """What the known terms of a budget come to."""

    value_n: float  # root sum of squares, u_val of ASME V&V 20 [N]
    degrees_of_freedom: float | None  # after Welch and Satterthwaite; None where no term has any
    expanded_n: float  # half width of the 95 % interval, by Student's t of them [N]
    largest: str  # name of the term that pays most to reduce
    without_largest_n: float  # what ``value_n`` would be without it [N]


def combine(terms: Sequence[UncertaintyTerm]) -> Combined | None:
    """Combine the known terms of a budget; None where there is none."""
    known = [(term, term.value_n) for term in terms if term.value_n is not None]
    total = math.hypot(*(value for _, value in known))
    if total == 0.0:
        return None
    spent = sum(
        (value / total) ** 4 / term.degrees_of_freedom
        for term, value in known
        if term.degrees_of_freedom
    )
    freedom = 1.0 / spent if spent else math.inf
    largest, _ = max(known, key=lambda pair: pair[1])
    others = (value for term, value in known if term is not largest)
    return Combined(
        value_n=total,
        degrees_of_freedom=freedom if math.isfinite(freedom) else None,
        expanded_n=total * student_t(freedom),
        largest=largest.name,
        without_largest_n=math.hypot(*others),
    )


_UNIFORM = 1.0 / math.sqrt(3.0)  # standard uncertainty of a uniform distribution of half width 1
_REPEATS_MIN = 4  # degrees of freedom: five presses of one force have them, or six of any
_CHORD = 0.25
"""Of the depth: over so much of it a stiffness is taken. Between two evaluations a nanometre apart
it would be the solver's tolerance."""
_REPEATED = "repeatability of the press"
_IN_CONTACT = 3  # samples of force that decide where contact is


@dataclass(frozen=True, slots=True, kw_only=True)
class Scatter:
    """How presses of one run differ in measured over predicted force."""

    relative: float | None  # standard deviation of a single press [1]; None where too few tell it
    degrees_of_freedom: float | None
    basis: str


def scatter_of(presses: Sequence[tuple[float, float, float]]) -> Scatter:
    """Find how presses scatter, from those of one target or else about a line over the force.

    Of each press the target, measured and predicted force are given [N].
    """
    groups: dict[float, list[float]] = {}
    for target_n, measured_n, predicted_n in presses:
        groups.setdefault(target_n, []).append(measured_n / predicted_n)
    freedom = sum(len(group) - 1 for group in groups.values())
    if freedom >= _REPEATS_MIN:
        squares = sum(len(group) * float(np.var(group)) for group in groups.values())
        basis = f"{len(presses)} presses at {len(groups)} forces"
    elif len(presses) >= _REPEATS_MIN + 2:
        measured, predicted = np.array(presses).T[1:]
        ratios = measured / predicted
        line = np.polyval(np.polyfit(predicted, ratios, 1), predicted)
        freedom, squares = len(presses) - 2, float(np.sum((ratios - line) ** 2))
        basis = f"no repeats: {len(presses)} ratios of measured to predicted force about a line"
    else:
        few = f"unknown: {len(presses)} presses; needs five at one force, or six in all"
        return Scatter(relative=None, degrees_of_freedom=None, basis=few)
    return Scatter(
        relative=math.sqrt(squares / freedom), degrees_of_freedom=float(freedom), basis=basis
    )


def uncertainty_budget(
    trial: TrialEvidence,
    model: ReplayModel | None,
    *,
    predicted_n: float | None,
    touched_m: float | None,
    scatter: Scatter,
    stated: Mapping[str, Stated],
) -> tuple[UncertaintyTerm, ...]:
    """List what is known and what is not of the uncertainty of a trial's predicted force.

    ``stated`` is by the fields of ``[uncertainty]``, and ``search_speed`` [m/s] and
    ``contact_force`` [N]; ``touched_m`` is the depth of the simulator at the latter.
    """
    relative = None if model is None else model.young_uncertainty_relative
    inputs = () if model is None else model.force_inputs
    terms = [
        ("modulus of the gel", _share(relative, predicted_n), _modulus_basis(model)),
        *(
            (each.name, _share(_change(each, trial.depth_measured_m), predicted_n), each.basis)
            for each in inputs
        ),
    ]
    if not inputs:
        unknown = "unknown: replay the run again to estimate them"
        terms.append(("the press's other inputs", None, unknown))
    replay = trial.replay
    return (
        UncertaintyTerm(
            "mesh, element and barrier of the simulator",
            TermGroup.NUMERICS,
            _share(None if replay is None else replay.force_error_estimate, predicted_n),
            "no replay" if replay is None else replay.force_error_basis,
        ),
        *(UncertaintyTerm(name, TermGroup.INPUTS, value, basis) for name, value, basis in terms),
        *_of_data(trial, predicted_n, touched_m, scatter, stated),
    )


def _modulus_basis(model: ReplayModel | None) -> str:
    if model is None or model.young_uncertainty_relative is None:
        return "unknown: the material states no uncertainty for this unit"
    return f"{model.young_uncertainty_relative:.1%}: {model.young_source or 'stated'}"


def _change(each: ForceInput, depth_m: float | None) -> float | None:
    if each.changes is None or depth_m is None:
        return None
    return float(np.interp(depth_m, each.depths_m, each.changes))


def _of_data(
    trial: TrialEvidence,
    force_n: float | None,
    touched_m: float | None,
    scatter: Scatter,
    stated: Mapping[str, Stated],
) -> Iterator[UncertaintyTerm]:
    record, not_recorded = trial.record, (None, "not recorded")
    drift = None if record is None else record.force_drift_n
    noise = None if record is None else record.force_deviation_n
    rate = None if record is None else record.force_rate_n_s
    of_image = (0.0, "images do not affect the predicted force")
    data: dict[str, tuple[float | None, str]] = {
        "height of first contact": _height(trial, touched_m, stated),
        "calibration of the force cell": _by(stated, "force_scale", trial.force_measured_n),
        "drift of the force cell's zero": not_recorded
        if drift is None
        else (_UNIFORM * abs(drift), "zero after minus before the press, uniform"),
        "noise of the force in the dwell": not_recorded
        if noise is None
        else (noise, "standard deviation of one sample, not of the mean"),
        "synchrony of force and height": _by(stated, "delay", None if rate is None else abs(rate)),
        _REPEATED: (_share(scatter.relative, force_n), scatter.basis),
        "scale of the image": of_image,
        "light of the image": of_image,
    }
    for name, (value_n, basis) in data.items():
        freedom = scatter.degrees_of_freedom if name == _REPEATED else None
        yield UncertaintyTerm(name, TermGroup.DATA, value_n, basis, freedom)


def _by(stated: Mapping[str, Stated], field: str, factor: float | None) -> tuple[float | None, str]:
    """Return what a stated uncertainty makes of a factor, and the statement's source."""
    known = stated.get(field)
    if known is None or factor is None:
        return None, "unknown: not stated" if known is None else "unknown: not recorded"
    return known.value * factor, known.source


def _height(
    trial: TrialEvidence, touched_m: float | None, stated: Mapping[str, Stated]
) -> tuple[float | None, str]:
    """Return what the height from which depth counts leaves uncertain of the force [N], and how.

    The arm's heights; the way that the tip goes until the force that calls contact is known, and
    the way that the noise of that force is; and half of how deep the simulator is there, since
    that is read off few points.
    """
    curve, record = trial.force_depth_simulated, trial.record
    arm, delay, speed = (stated.get(name) for name in ("depth", "delay", "search_speed"))
    if curve is None or record is None or touched_m is None or record.depth_measured_m is None:
        return None, "unknown: no simulated curve to the measured depth"
    if arm is None:
        return None, "unknown: the height uncertainty of this arm is not stated"
    parts_m = [0.5 * touched_m, arm.value]
    if delay is not None and speed is not None:
        parts_m.append(delay.value * speed.value)
    contact, tare = stated.get("contact_force"), record.tare_before
    if contact is not None and tare is not None and contact.value > 0.0:
        share = tare.deviation[FZ] / math.sqrt(_IN_CONTACT) / contact.value
        parts_m.append(share * touched_m)
    doubt_m = math.hypot(*parts_m)
    return _stiffness(curve, record.depth_measured_m) * doubt_m, (
        f"{doubt_m * 1e6:.0f} um from arm height, noise and delay of the contact-detection force, "
        f"and half of the simulated depth at that force; arm: {arm.source}"
    )


def _stiffness(curve: ForceDepthCurve, depth_m: float) -> float:
    """Return the slope of force over depth there [N/m], over a quarter of the depth."""
    deep_m = min(depth_m, float(curve.depth_m[-1]))
    at_m = [deep_m, (1.0 - _CHORD) * deep_m]
    deep_n, shallow_n = np.interp(at_m, curve.depth_m, curve.force_n)
    return float(deep_n - shallow_n) / (_CHORD * deep_m)


def _share(relative: float | None, force_n: float | None) -> float | None:
    return None if relative is None or force_n is None else abs(relative * force_n)


UNKNOWN_SCATTER = scatter_of(())


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceAgreement:
    """Simulated against measured force of one trial."""

    tolerance_n: float
    # Simulated minus measured at the accepted depth [N]; by construction small.
    mismatch_n: float | None
    # Simulated force at the measured depth [N]; None outside the curve.
    force_predicted_n: float | None
    prediction_error_n: float | None  # predicted minus measured [N], E = S - D of ASME V&V 20
    prediction_error_relative: float | None
    # Simulated minus measured depth at equal force [m], both from first touch.
    depth_error_m: float | None
    # Depth of the simulator at the force that the press called contact [m]; added to the measured
    # depth.
    touch_depth_m: float | None
    known_uncertainty_n: float | None  # root sum of squares of the known terms of ``budget`` [N]
    # The same with degrees of freedom and the 95 % interval; None without a term.
    combined: Combined | None
    budget_complete: bool  # false when any term is unknown: u_val is then larger than shown
    budget: tuple[UncertaintyTerm, ...]


def compare_force(
    trial: TrialEvidence,
    *,
    tolerance_n: float,
    model: ReplayModel | None,
    contact_force_n: float = 0.0,
    scatter: Scatter = UNKNOWN_SCATTER,
    stated: Mapping[str, Stated] | None = None,
) -> ForceAgreement:
    """Compare the forces of one trial under both claims; what is missing gives None.

    Args:
        tolerance_n: Largest mismatch that counts as matched [N].
        contact_force_n: Force at which the press called the gel touched [N]. The simulator is a
            little deep at that force, and measured depth counts from there.
    """
    replay, measured, depth = trial.replay, trial.force_measured_n, trial.depth_measured_m
    simulated = None if replay is None else replay.force_simulated_n
    predicted, touched = predict(trial, contact_force_n)
    if depth is not None and touched is not None:
        depth += touched
    error = difference(predicted, measured)
    budget = uncertainty_budget(
        trial,
        model,
        predicted_n=simulated if predicted is None else predicted,
        touched_m=touched,
        scatter=scatter,
        stated=stated or {},
    )
    combined = combine(budget)
    return ForceAgreement(
        tolerance_n=tolerance_n,
        mismatch_n=difference(simulated, measured),
        force_predicted_n=predicted,
        prediction_error_n=error,
        prediction_error_relative=error / measured if error is not None and measured else None,
        depth_error_m=difference(None if replay is None else replay.depth_simulated_m, depth),
        touch_depth_m=touched,
        known_uncertainty_n=None if combined is None else combined.value_n,
        combined=combined,
        budget_complete=all(term.value_n is not None for term in budget),
        budget=budget,
    )


def scatter_between(trials: Sequence[TrialEvidence], *, contact_force_n: float) -> Scatter:
    """Find how the presses of a run scatter in measured over predicted force."""
    presses = []
    for trial in trials:
        predicted, _ = predict(trial, contact_force_n)
        if trial.force_measured_n is not None and predicted:
            presses.append((trial.force_target_n, trial.force_measured_n, predicted))
    return scatter_of(presses)


def predict(trial: TrialEvidence, contact_force_n: float) -> tuple[float | None, float | None]:
    """Return the simulated force at the measured depth [N], and how deep contact was there [m]."""
    curve, depth = trial.force_depth_simulated, trial.depth_measured_m
    touched = None if curve is None else curve.depth_at(contact_force_n)
    if curve is None or depth is None or touched is None:
        return None, None
    return curve.force_at(depth + touched), touched


def difference(first: float | None, second: float | None) -> float | None:
    """Return the difference of two values; None where one is not known."""
    return None if first is None or second is None else first - second
