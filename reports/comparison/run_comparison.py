"""Compare a run with its replay: evidence in, judged numbers out."""

from collections.abc import Iterable, Sequence
from typing import Any

from reports.comparison.recovered_truth import recover_truth
from reports.comparison.report_criteria import judge_model, judge_modulus, judge_record
from reports.comparison.result_types import RunStatistics, TrialResult, ValidationReport
from reports.comparison.verdict_sentences import abstract_of, limits_of, read_scores, verdict_of
from reports.evidence.evidence_types import ImageGeometry, RunEvidence, TrialEvidence
from reports.scores import image_metrics as bounds
from reports.scores import wrong_forces
from reports.scores.confidence_interval import MeanInterval, t_interval
from reports.scores.contact_scores import correct, score_contact
from reports.scores.force_uncertainty import Scatter, compare_force, scatter_between
from reports.scores.image_metrics import ImageScores, Metric, finite, psnr_of_mean_mse, score
from tacauchy_rig.core.image_codec import to_grey

_MEASURED = ("force_measured_n", "force_deviation_n", "force_drift_n", "depth_measured_m")
_STEPS = ("newton_iterations", "search_iterations")
_SOLVED = (*_STEPS, "balance_relative", "gap_min_m", "min_jacobian", "force_error_basis")


def compare(evidence: RunEvidence) -> ValidationReport:
    """Score, judge and explain every trial of a run.

    Raises:
        RecordError: Images of one trial differ in shape.
    """
    crossed = wrong_forces.cross_scores(evidence.trials)
    matrices = wrong_forces.wrong_force_matrices(evidence.trials, crossed)
    margins = wrong_forces.force_margins(evidence.trials)
    scatter = scatter_between(evidence.trials, contact_force_n=evidence.contact_force_n)
    trials = tuple(
        _compare_trial(trial, evidence, crossed, margins.get(trial.index), scatter)
        for trial in evidence.trials
    )
    statistics = _statistics(trials, evidence)
    criteria = (*evidence.checks, *judge_modulus(evidence.model, evidence.thresholds))
    passed = all(c.passed for c in criteria) and all(trial.passed for trial in trials)
    passed = passed and bool(trials)
    return ValidationReport(
        passed=passed,
        criteria=criteria,
        verdict=verdict_of(trials, criteria, evidence, passed=passed),
        abstract=abstract_of(trials, statistics, evidence),
        reading=read_scores(trials, statistics, matrices, evidence),
        limits=limits_of(trials, statistics, evidence),
        trials=trials,
        statistics=statistics,
        matrices=matrices,
        truth=recover_truth(evidence, trials),
        evidence=evidence,
    )


def _compare_trial(
    trial: TrialEvidence,
    evidence: RunEvidence,
    crossed: wrong_forces.CrossScores,
    margin: wrong_forces.ForceMargin | None,
    scatter: Scatter,
) -> TrialResult:
    seen, model = compare_images(trial, evidence, crossed), evidence.model_of(trial.index)
    force = compare_force(
        trial,
        tolerance_n=evidence.thresholds.max_force_mismatch,
        model=model,
        contact_force_n=evidence.contact_force_n,
        scatter=scatter,
        stated=evidence.stated,
    )
    criteria = (
        *judge_record(trial),
        *judge_model(
            trial,
            evidence.thresholds,
            margin=margin,
            contact=seen["contact"],
            corrections=seen["corrections"],
            force=force,
            model=model,
        ),
    )
    return TrialResult(
        **_pressed(trial),
        passed=all(criterion.passed for criterion in criteria),
        force_mismatch_n=force.mismatch_n,
        force=force,
        **seen,
        force_margin=margin,
        criteria=criteria,
    )


def compare_images(
    trial: TrialEvidence, evidence: RunEvidence, crossed: wrong_forces.CrossScores
) -> dict[str, Any]:
    """Return what images say, by the fields of a result; None where one is missing."""
    others = [t for t in evidence.trials if t.index != trial.index]
    images, simulated = trial.images, trial.simulated_image
    scale = _scale_mm_px(evidence.geometry)
    scores = grey = contact = corrections = floors = unexplained = None
    if images is not None and simulated is not None:
        scores = crossed[trial.index][trial.index]
        grey = score(to_grey(images.real), to_grey(simulated))
        contact = score_contact(images, simulated, scale_mm_px=scale)
        corrections = correct(images, simulated, scale_mm_px=scale)
    if images is not None:
        wrong = {t.index for t in others if t.is_wrong_for(trial)}
        own = crossed[trial.index]
        floors = bounds.trial_floors(images, [own[index] for index in own if index in wrong])
        unexplained = wrong_forces.contact_residuals(images, [images.reference])[0]
    ceiling = bounds.trial_ceiling(trial, others)
    return {
        "metrics": scores,
        "metrics_grey": grey,
        "floors": floors,
        "ceiling": ceiling,
        "skill": _skills(trial, scores, floors, ceiling),
        "contact": contact,
        "contact_no_contact_residual": unexplained,
        "corrections": corrections,
    }


def _pressed(trial: TrialEvidence) -> dict[str, Any]:
    """Return what record and replay say by themselves, by the fields of a result."""
    record, replay = trial.record, trial.replay
    return {
        "index": trial.index,
        "attempt": 0 if record is None else record.attempt,
        "outcome": "missing" if record is None else record.outcome.value,
        "reason": "" if record is None else record.reason,
        "force_target_n": trial.force_target_n,
        "force_simulated_n": None if replay is None else replay.force_simulated_n,
        **{name: getattr(record, name, None) for name in _MEASURED},
        "depth_simulated_m": None if replay is None else replay.depth_simulated_m,
        "rates": {} if record is None else dict(record.rates),
        "streams": trial.streams,
        "replay": {}
        if replay is None
        else {
            **{name: getattr(replay, name) for name in _SOLVED},
            "wall_s": dict(replay.wall_s),
            "force_error_estimate_relative": replay.force_error_estimate,
        },
    }


def _skills(
    trial: TrialEvidence,
    scores: ImageScores | None,
    floors: bounds.Floors | None,
    ceiling: bounds.Ceiling | None,
) -> dict[str, bounds.Skill]:
    if scores is None or floors is None or trial.images is None or trial.simulated_image is None:
        return {}
    noise = bounds.score_noise(trial.images, trial.simulated_image)
    return {
        m.value: bounds.skill(
            scores.value(m),
            floors.no_contact.value(m),
            None if ceiling is None else ceiling.scores.value(m),
            noise=0.0 if noise is None else noise[m],
            larger_is_better=m.larger_is_better,
        )
        for m in Metric
    }


def _statistics(trials: Sequence[TrialResult], evidence: RunEvidence) -> RunStatistics:
    scores = [t.metrics for t in trials if t.metrics is not None]
    floors = [t.floors.no_contact for t in trials if t.floors is not None]
    contacts = [t.contact for t in trials if t.contact is not None]
    pressed = {t.index for t in trials if t.outcome != "missing"}
    keys = [t.press_key for t in evidence.trials if t.index in pressed]
    return RunStatistics(
        metrics=image_means(scores),
        no_contact=image_means(floors),
        psnr_of_mean_mse_db=finite(psnr_of_mean_mse([s.mse for s in scores])),
        psnr_of_mean_mse_no_contact_db=finite(psnr_of_mean_mse([s.mse for s in floors])),
        force_mismatch_n=t_interval(_known(t.force_mismatch_n for t in trials)),
        prediction_error_relative=t_interval(
            _known(t.force.prediction_error_relative for t in trials)
        ),
        contact_zncc=t_interval([c.zncc for c in contacts]),
        contact_relative_residual=t_interval([c.relative_residual for c in contacts]),
        repeats_per_force=min((keys.count(key) for key in keys), default=0),
    )


def image_means(scores: Sequence[ImageScores]) -> dict[str, MeanInterval]:
    """Return the mean of every score with its interval."""
    return {m.value: t_interval([s.value(m) for s in scores]) for m in Metric}


def _known(values: Iterable[float | None]) -> list[float]:
    return [v for v in values if v is not None]


def _scale_mm_px(geometry: ImageGeometry) -> tuple[float, float] | None:
    if geometry.scale_x_m_px is None or geometry.scale_y_m_px is None:
        return None
    return geometry.scale_x_m_px * 1e3, geometry.scale_y_m_px * 1e3
