"""Two different claims about force, and what is known of the error of either.

Force-matched (the paper): the simulated indenter moved until F_z agreed, so agreement is by
construction and the depth is the outcome. Force-predicted: the depth that was measured, F_z read
off the simulator, so the force is the outcome. Only the second tests the simulator's force.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from reports.evidence.evidence import TrialEvidence
from reports.scores.budget import (
    Combined,
    Scatter,
    UncertaintyTerm,
    combine,
    scatter_of,
    uncertainty_budget,
)
from tacauchy_rig.core.config.uncertainty import Stated
from tacauchy_rig.core.simulated import ReplayModel

UNKNOWN_SCATTER = scatter_of(())


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
        combined: The same with degrees of freedom and the 95 % interval; None without a term.
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
    combined: Combined | None
    budget_complete: bool
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
    """Compare the forces of one trial under both claims.

    Args:
        trial: Record and replay of the trial; what is missing gives None.
        tolerance_n: Largest mismatch that counts as matched [N].
        model: The replay's model; what the force depends on enters the budget.
        contact_force_n: Force at which the press called the gel touched [N]. The simulator is a
            little deep at that force, and measured depth counts from there.
        scatter: How the run's presses differ.
        stated: What the run states of cell, heights and delays.
    """
    record, replay = trial.record, trial.replay
    measured = None if record is None else record.force_measured_n
    depth = None if record is None else record.depth_measured_m
    simulated = None if replay is None else replay.force_simulated_n
    predicted, touched = predict(trial, contact_force_n)
    if depth is not None and touched is not None:
        depth += touched
    error = _difference(predicted, measured)
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
        mismatch_n=_difference(simulated, measured),
        force_predicted_n=predicted,
        prediction_error_n=error,
        prediction_error_relative=error / measured if error is not None and measured else None,
        depth_error_m=_difference(None if replay is None else replay.depth_simulated_m, depth),
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
        measured = None if trial.record is None else trial.record.force_measured_n
        predicted, _ = predict(trial, contact_force_n)
        if measured is not None and predicted:
            presses.append((trial.force_target_n, measured, predicted))
    return scatter_of(presses)


def predict(trial: TrialEvidence, contact_force_n: float) -> tuple[float | None, float | None]:
    """Return the simulated force at the measured depth [N], and how deep contact was there [m]."""
    curve = trial.force_depth_simulated
    depth = None if trial.record is None else trial.record.depth_measured_m
    touched = None if curve is None else curve.depth_at(contact_force_n)
    if curve is None or depth is None or touched is None:
        return None, None
    return curve.force_at(depth + touched), touched


def _difference(first: float | None, second: float | None) -> float | None:
    return None if first is None or second is None else first - second
