"""The report in plain sentences: the verdict, what the scores can tell, and what they cannot.

Every sentence is made from the numbers of this run; none is praise. Their words lie in
``reports/templates``.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from reports.comparison.result_types import RunStatistics, TrialResult, headline_of, worst_of
from reports.evidence.evidence_types import RunEvidence
from reports.scores.image_metrics import CeilingKind, Metric, SkillStatus
from reports.scores.residual_causes import UNMENDABLE
from reports.scores.wrong_forces import WrongForceMatrix
from tacauchy_rig.core.markdown_page import sentences
from tacauchy_rig.core.run import Criterion, Outcome
from tacauchy_rig.core.simulated import ReplayModel

CLAIM_REPEATS = 5
MINUS = "\u2212"


def verdict_of(
    trials: Sequence[TrialResult],
    criteria: Sequence[Criterion],
    evidence: RunEvidence,
    *,
    passed: bool,
) -> str:
    """Say whether the run met its criteria, with its worst values and what was fitted."""
    off = [t.force.prediction_error_relative for t in trials]
    said = _written(
        "verdict",
        trials=trials,
        passed=passed,
        subject=_subject(evidence),
        imported=evidence.imported,
        judged=_judged(trials),
        headline={row.name: row for row in headline_of(trials, criteria)},
        off=max((abs(value) for value in off if value is not None), default=None),
        limits=evidence.thresholds,
        model=evidence.model,
        in_sample_optics=evidence.optics_are_in_sample,
        mounting=fits_of(evidence)[2:],
        missed_run=[c for c in criteria if not c.passed],
        missed_count=sum(not t.passed for t in trials),
        unpressed=[t for t in trials if t.outcome != Outcome.PASSED],
        missed=_missed_by_name(trials),
    )
    return " ".join((*said, *_force_check(evidence)))


def _subject(evidence: RunEvidence) -> str:
    return "presses on emulated devices" if evidence.simulated else "presses"


def abstract_of(
    trials: Sequence[TrialResult], statistics: RunStatistics, evidence: RunEvidence
) -> str:
    """State the main result in one sentence; empty where no image was scored.

    It names the number of presses, their forces, SSIM with its no-contact floor, and the error of
    the predicted force with its uncertainty.
    """
    scored = [t for t in trials if t.metrics is not None]
    forces_n = [t.force_measured_n for t in scored if t.force_measured_n is not None]
    uncertainties = [
        t.force.combined.expanded_n / t.force_measured_n
        for t in scored
        if t.force.combined and t.force_measured_n and t.force.force_predicted_n
    ]
    return " ".join(
        _written(
            "abstract",
            scored=len(scored),
            subject=_subject(evidence),
            lightest=min(forces_n, default=None),
            heaviest=max(forces_n, default=None),
            ssim=statistics.metrics["ssim"],
            floor=statistics.no_contact["ssim"],
            error=statistics.prediction_error_relative,
            uncertainties=uncertainties,
            incomplete=not all(t.force.budget_complete for t in scored),
        )
    )


def _force_check(evidence: RunEvidence) -> tuple[str, ...]:
    if evidence.imported is not None:
        return ()
    return _written(
        "force_check",
        check=evidence.force_check,
        after=evidence.weighed_after,
        history=evidence.force_history,
        allowed=evidence.unchecked_allowed,
    )


def _missed_by_name(trials: Sequence[TrialResult]) -> list[tuple[list[str], Criterion]]:
    """Return each missed criterion of trials that were pressed, its trials, and its worst case."""
    missed: dict[str, list[tuple[TrialResult, Criterion]]] = {}
    for trial in trials:
        for criterion in trial.criteria:
            if not criterion.passed and trial.outcome in (Outcome.PASSED, Outcome.IMPORTED):
                missed.setdefault(criterion.name, []).append((trial, criterion))
    return [
        ([str(trial.index) for trial, _ in found], worst_of([case for _, case in found]))
        for found in missed.values()
    ]


def _judged(trials: Sequence[TrialResult]) -> dict[str, Counter[str]]:
    """Return of each criterion in how many trials it is met, missed, and not known."""
    found: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for each in (criterion for trial in trials for criterion in trial.criteria):
        unmet = "unknown" if math.isnan(each.measured) else "missed"
        found[each.name]["met" if each.passed else unmet] += 1
    return found


def read_scores(
    trials: Sequence[TrialResult],
    statistics: RunStatistics,
    matrices: Sequence[WrongForceMatrix],
    evidence: RunEvidence,
) -> tuple[str, ...]:
    """Say what the scores of this run can and cannot tell."""
    won = {m.metric: (sum(m.diagonal_wins), len(m.trials)) for m in matrices}
    judged = {m: won[m.value] for m in Metric if m in won}
    return _written(
        "reading",
        trials=trials,
        camera=evidence.camera,
        split=None if evidence.model is None else evidence.model.residual,
        unmendable=UNMENDABLE,
        statistics=statistics,
        losing=[m.label for m in Metric if _loses(statistics, m)],
        sometimes_wrong=[
            f"{m.label} (right in {right} of {count} trials)"
            for m, (right, count) in judged.items()
            if right < count
        ],
        hidden=[str(t.index) for t in trials if t.metrics is not None and t.contact is None],
        ceiling_is_noise=any(t.ceiling and t.ceiling.kind is CeilingKind.NOISE for t in trials),
        above_ceiling=_with_status(trials, SkillStatus.ABOVE_CEILING),
        not_discriminating=_with_status(trials, SkillStatus.NOT_DISCRIMINATING),
    )


def _loses(statistics: RunStatistics, metric: Metric) -> bool:
    ours = statistics.metrics[metric.value].mean
    floor = statistics.no_contact[metric.value].mean
    if ours is None or floor is None:
        return False
    return ours <= floor if metric.larger_is_better else ours >= floor


def _with_status(trials: Sequence[TrialResult], status: SkillStatus) -> list[str]:
    """Name the scores whose skill has a status in any trial."""
    skills = [t.skill for t in trials if t.skill]
    return [m.label for m in Metric if any(skill[m.value].status is status for skill in skills)]


def limits_of(
    trials: Sequence[TrialResult], statistics: RunStatistics, evidence: RunEvidence
) -> tuple[str, ...]:
    """List what this report does not show."""
    devices = evidence.provenance.get("devices", {})
    return _written(
        "limits",
        trials=trials,
        statistics=statistics,
        evidence=evidence,
        claim_repeats=CLAIM_REPEATS,
        emulated=[n.replace("_", " ") for n, device in devices.items() if device.get("simulated")],
    )


def _written(name: str, **facts: object) -> tuple[str, ...]:
    filters: dict[str, Callable[..., str]] = {"listed": _join, "percent": percent}
    return sentences("reports", f"templates/{name}.txt.jinja", facts, filters=filters)


def percent(ratio: float, digits: int, *, signed: bool = False) -> str:
    """Write a ratio in percent with a true minus sign."""
    text = f"{100.0 * ratio:+.{digits}f}" if signed else f"{100.0 * ratio:.{digits}f}"
    return f"{text.replace('-', MINUS)} %"


def _join(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """One input of the simulation."""

    what: str  # the input
    value: str  # what was found or taken of it, with its unit; empty for many numbers
    source: str  # the data that it was fitted to, or where it was stated
    in_sample: bool  # the judged presses are among these data
    effect: str  # what that means for the scores


def fits_of(evidence: RunEvidence) -> tuple[Fit, ...]:
    """Return what the simulation of a run was fitted to; nothing where it was not simulated."""
    model = evidence.model
    return () if model is None else tuple(_fits(model, evidence))


def _fits(model: ReplayModel, evidence: RunEvidence) -> Iterator[Fit]:
    yield _modulus(model)
    yield _optics(model, evidence)
    models, most = (model, *evidence.others), "at most " if evidence.others else ""
    tilted = max(models, key=lambda each: each.tilt_deg)
    if tilted.tilt_deg:
        fitted = any(each.taken and each.name.startswith("lean") for each in tilted.found)
        yield Fit(
            what="Tilt of the indenter",
            value=f"{most}{tilted.tilt_deg:.2f} deg",
            source="the measured moments of these same presses" if fitted else "stated",
            in_sample=fitted,
            effect="No image was used. Simulated moments are in-sample." if fitted else "",
        )
    moved_mm = max(each.found_offset_mm for each in models)
    if moved_mm:
        yield Fit(
            what="Place of the indenter",
            value=f"{most}{moved_mm:.3f} mm from the stated place",
            source="the images of these same presses",
            in_sample=True,
            effect="Image scores are in-sample. The contact offset includes this distance.",
        )


def _modulus(model: ReplayModel) -> Fit:
    if model.modulus_factor is None:
        return Fit(
            what="Modulus of the gel",
            value=f"{1e-3 * model.young_pa:.4g} kPa",
            source="stated, not fitted",
            in_sample=False,
            effect="Simulated depths and predicted forces are out-of-sample.",
        )
    return Fit(
        what="Modulus of the gel",
        value=f"{model.modulus_factor:.3f} times the nominal one",
        source=f"depths and forces of {model.modulus_trials} of these same presses; no images",
        in_sample=True,
        effect="Simulated depths are in-sample. No image was used; images are simulated at these"
        " depths. Predicted forces use the nominal modulus and are out-of-sample.",
    )


def _optics(model: ReplayModel, evidence: RunEvidence) -> Fit:
    source = str(model.optics.get("source") or "")
    effect = "No image of these presses was used." if source else "Their origin is not known."
    if evidence.optics_are_in_sample:
        source = f"{source.partition(' in ')[0] or 'not stated'}, these same presses"
        effect = "Image scores are in-sample."
        if evidence.optics is not None:
            held_out, side = evidence.optics.nudged, evidence.optics.crop_px
            effect += (
                f" Cross-validated, SSIM of {side} x {side} px around each contact is"
                f" {held_out.ssim:.4f} (no contact {held_out.ssim_no_contact:.4f})."
            )
    return Fit(
        what="Optics (colours)",
        value="",
        source=source or "not stated",
        in_sample=evidence.optics_are_in_sample,
        effect=effect,
    )
