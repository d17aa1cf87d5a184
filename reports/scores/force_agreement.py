"""Two different claims about force, and what is known of the error of either.

Force-matched (the paper): the simulated indenter moved until F_z agreed, so agreement is by
construction and the depth is the outcome. Force-predicted: the depth that was measured, F_z read
off the simulator, so the force is the outcome. Only the second tests the simulator's force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from reports.evidence.evidence import TrialEvidence
from reports.evidence.force_depth import depth_at_force, force_at_depth
from tacauchy_rig.replayed import ReplayModel


class TermGroup(StrEnum):
    """Where an uncertainty enters, after ASME V&V 20."""

    NUMERICS = "numerics"
    INPUTS = "inputs"
    DATA = "data"


@dataclass(frozen=True, slots=True, kw_only=True)
class UncertaintyTerm:
    """One line of the budget.

    Attributes:
        value_n: Standard uncertainty of the force [N]; None when nobody has measured it.
        basis: How the value is known, or why it is not.
    """

    name: str
    group: TermGroup
    value_n: float | None
    basis: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceAgreement:
    """Simulated against measured force of one trial.

    Attributes:
        mismatch_n: Simulated minus measured at the accepted depth [N]; by construction small.
        force_predicted_n: Simulated force at the measured depth [N]; None outside the curve.
        prediction_error_n: Predicted minus measured [N], E = S - D of ASME V&V 20.
        depth_error_m: Simulated minus measured depth at equal force [m], both from first touch.
        touch_depth_m: Depth of the simulator at the force that the press called contact [m];
            added to the measured depth.
        known_uncertainty_n: Root sum of squares of the known terms of ``budget`` [N].
        budget_complete: False when any term is unknown: u_val is then larger than shown.
    """

    tolerance_n: float
    mismatch_n: float | None
    force_predicted_n: float | None
    prediction_error_n: float | None
    prediction_error_relative: float | None
    depth_error_m: float | None
    touch_depth_m: float | None
    known_uncertainty_n: float | None
    budget_complete: bool
    budget: tuple[UncertaintyTerm, ...]


def compare_force(
    trial: TrialEvidence,
    *,
    tolerance_n: float,
    model: ReplayModel | None,
    contact_force_n: float = 0.0,
) -> ForceAgreement:
    """Compare the forces of one trial under both claims.

    Args:
        trial: Record and replay of the trial; what is missing gives None.
        tolerance_n: Largest mismatch that counts as matched [N].
        model: The replay's model; the uncertainty of its modulus enters the budget if known.
        contact_force_n: Force at which the press called the gel touched [N]. The simulator is a
            little deep at that force, and measured depth counts from there.
    """
    record, replay = trial.record, trial.replay
    measured = None if record is None else record.force_measured_n
    depth = None if record is None else record.depth_measured_m
    simulated = None if replay is None else replay.force_simulated_n
    curve, predicted, touched = trial.force_depth_simulated, None, None
    if curve is not None and depth is not None:
        touched = depth_at_force(curve, contact_force_n)
    if curve is not None and depth is not None and touched is not None:
        depth += touched
        predicted = force_at_depth(curve, depth)
    error = _difference(predicted, measured)
    budget = uncertainty_budget(trial, model, touched_m=touched)
    known = [term.value_n for term in budget if term.value_n is not None]
    return ForceAgreement(
        tolerance_n=tolerance_n,
        mismatch_n=_difference(simulated, measured),
        force_predicted_n=predicted,
        prediction_error_n=error,
        prediction_error_relative=error / measured if error is not None and measured else None,
        depth_error_m=_difference(None if replay is None else replay.depth_simulated_m, depth),
        touch_depth_m=touched,
        known_uncertainty_n=math.hypot(*known) if known else None,
        budget_complete=all(term.value_n is not None for term in budget),
        budget=budget,
    )


# What a term rests on where it is known, and what is said where it is not.
_TERMS = {
    "modulus of the gel": (
        TermGroup.INPUTS,
        "stated with the material",
        "unknown: the material states no uncertainty for this unit",
    ),
    "tilt and place of the indenter": (TermGroup.INPUTS, "", "unknown: not measured"),
    "height of first contact": (
        TermGroup.INPUTS,
        "half of the simulator's depth at the contact force, times its stiffness",
        "unknown: no simulated curve",
    ),
    "scatter of the force in the dwell": (
        TermGroup.DATA,
        "standard deviation over the dwell",
        "not recorded",
    ),
    "drift of the force sensor's zero": (
        TermGroup.DATA,
        "unloaded after minus before",
        "not recorded",
    ),
    "repeatability of the press": (
        TermGroup.DATA,
        "",
        "unknown: needs at least five presses at one force",
    ),
}


def uncertainty_budget(
    trial: TrialEvidence, model: ReplayModel | None, *, touched_m: float | None = None
) -> tuple[UncertaintyTerm, ...]:
    """List what is known and what is not of the uncertainty of simulated minus measured force.

    Args:
        trial: Record and replay of the trial.
        model: The replay's model.
        touched_m: Depth of the simulator at the contact force [m].
    """
    record, replay = trial.record, trial.replay
    simulated = None if replay is None else replay.force_simulated_n
    drift = None if record is None else record.force_drift_n
    numerics_n = _share(None if replay is None else replay.force_error_estimate, simulated)
    values_n = {
        "tilt and place of the indenter": None,
        "repeatability of the press": None,
        "modulus of the gel": _share(
            None if model is None else model.young_uncertainty_relative, simulated
        ),
        "height of first contact": _contact_height(trial, touched_m),
        "scatter of the force in the dwell": None if record is None else record.force_deviation_n,
        "drift of the force sensor's zero": None if drift is None else abs(drift),
    }
    return (
        UncertaintyTerm(
            name="mesh, element and barrier of the simulator",
            group=TermGroup.NUMERICS,
            value_n=numerics_n,
            basis="no replay" if replay is None else replay.force_error_basis,
        ),
        *(
            UncertaintyTerm(name=name, group=group, value_n=value_n, basis=known)
            if (value_n := values_n[name]) is not None
            else UncertaintyTerm(name=name, group=group, value_n=None, basis=unknown)
            for name, (group, known, unknown) in _TERMS.items()
        ),
    )


def _share(relative: float | None, force_n: float | None) -> float | None:
    return None if relative is None or force_n is None else abs(relative * force_n)


def _contact_height(trial: TrialEvidence, touched_m: float | None) -> float | None:
    """Return half of the force [N] over the depth in doubt.

    Not from a slope: between two evaluations a nanometre apart it is the solver's tolerance.
    """
    curve = trial.force_depth_simulated
    depth = None if trial.record is None else trial.record.depth_measured_m
    if curve is None or depth is None or touched_m is None or len(curve) < 2:
        return None
    deepest = min(depth, curve[-1, 0])
    deep_n, shallow_n = np.interp([deepest, deepest - touched_m], curve[:, 0], curve[:, 1])
    return 0.5 * float(deep_n - shallow_n)


def _difference(first: float | None, second: float | None) -> float | None:
    return None if first is None or second is None else first - second
