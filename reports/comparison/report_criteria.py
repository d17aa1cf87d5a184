"""What trials and a run must meet, with remedies."""

import math
from collections.abc import Iterator

from reports.evidence.evidence_types import TrialEvidence
from reports.scores.contact_scores import ContactScores, Corrections, PoseResidual
from reports.scores.force_uncertainty import ForceAgreement
from reports.scores.wrong_forces import ForceMargin
from tacauchy_rig.core.config.settings import ReportSection
from tacauchy_rig.core.run import Criterion, Outcome
from tacauchy_rig.core.simulated import ReplayModel

MARGIN, RESIDUAL, OFFSET, PREDICTION, MODULUS, MODULUS_TRIALS = (
    "force_margin",
    "contact_residual",
    "contact_offset",
    "predicted_force",
    "modulus_factor",
    "modulus_trials",
)
COUNTS = (MARGIN, RESIDUAL, PREDICTION, OFFSET)
COUNTS_OF_RUN = (MODULUS, MODULUS_TRIALS)
"""Criteria that a wrong model can miss; what holds by construction is not among them."""

MAX_SETTLED_CHANGE = 0.05
"""Of the contact's change. A force that drifts as fast as `protocol.dwell_force_rate` admits moves
by 0.06 N in a dwell, 5 % of the lightest press. Gels creep by 5 to 8 % in all, mostly before."""

NOT_THERE = "press and replay this trial first: `tacauchy-rig resume RUN`, then `replay RUN`"


def judge_record(trial: TrialEvidence) -> Iterator[Criterion]:
    """Yield what protocol, recording and hashes say of a trial; what is missing fails."""
    yield _protocol(trial)
    if trial.images is not None and trial.images.settled_change is not None:
        yield Criterion.at_most(
            "settled_images",
            trial.images.settled_change,
            MAX_SETTLED_CHANGE,
            remedy="the pose was constant while the images changed: the camera delivers old images "
            "(end other programs, see `tacauchy-rig doctor`: camera), or its light changes",
        )
    yield from trial.checks


def _protocol(trial: TrialEvidence) -> Criterion:
    record = trial.record
    if record is not None and record.outcome is Outcome.IMPORTED:
        return Criterion(
            name="press",
            passed=False,
            measured=math.nan,
            limit="a protocol supervised the press",
            unit="",
            remedy="the press was imported, so this cannot be checked",
        )
    if record is None:
        remedy = "`tacauchy-rig resume RUN` continues with the first missing trial"
    else:
        failed = [c for c in record.criteria if not c.passed]
        remedy = (
            " ".join([record.reason, *(f"{c.name}: {c.remedy or c.limit}" for c in failed)]).strip()
            or "`tacauchy-rig resume RUN` repeats the trial"
        )
    passed = record is not None and record.passed
    limit = "the attempt ran to its end and met every check of the protocol"
    return Criterion(
        name="press", measured=float(passed), passed=passed, limit=limit, unit="", remedy=remedy
    )


def judge_model(
    trial: TrialEvidence,
    thresholds: ReportSection,
    *,
    margin: ForceMargin | None,
    contact: ContactScores | None,
    corrections: Corrections | None,
    force: ForceAgreement,
    model: ReplayModel | None = None,
) -> tuple[Criterion, ...]:
    """Return the criteria that a trial's replay must meet; what is missing fails.

    The fitted shift of the indenter still counts as offset; advice about an edge is only for
    indenters that have one.
    """
    has_rim = model is None or not model.indenter.startswith("sphere")
    off_m = (0.0, 0.0) if model is None else model.found_offset_m
    seen = corrections.pose if corrections and trial.place_known else None
    return (
        *_judge_images(thresholds, margin, contact, has_rim=has_rim),
        _judge_place(thresholds, seen, off_m),
        *_judge_forces(thresholds, force),
    )


def _judge_images(
    thresholds: ReportSection,
    margin: ForceMargin | None,
    contact: ContactScores | None,
    *,
    has_rim: bool,
) -> Iterator[Criterion]:
    in_spreads = math.nan if margin is None else margin.in_spreads
    if margin is None:
        remedy = NOT_THERE
    elif math.isnan(in_spreads):
        remedy = "a margin needs a dwell of at least four frames and a visible contact"
    else:
        remedy = (
            f"the image of {margin.rival} fits this press equally well: the replay's images belong"
            " to other presses or to none, or the target forces are too close to distinguish"
        )
    limit = thresholds.min_force_margin
    yield Criterion(
        name=MARGIN,
        measured=in_spreads,
        passed=in_spreads >= limit,
        limit="the correct force leaves a smaller residual in the contact than any wrong force and"
        f" no contact, by at least {limit:g} times the noise and repeat scatter",
        unit="spreads",
        remedy=remedy,
    )
    residual = math.nan if contact is None else contact.relative_residual
    limit = thresholds.max_contact_residual
    yield Criterion(
        name=RESIDUAL,
        measured=residual,
        passed=residual <= limit,
        limit=f"at most {limit:g} of the contact's image change unexplained (no contact: 1)",
        unit="",
        remedy=NOT_THERE
        if math.isnan(residual)
        else "look at the difference images: a ring points to the"
        f" {'fillet or the ' * has_rim}pose, a tint to the light, a disc to the force;"
        " calibrate scale and optics for this sensor",
    )


def _judge_place(
    thresholds: ReportSection, pose: PoseResidual | None, off_m: tuple[float, float]
) -> Criterion:
    value, limit = math.nan, thresholds.max_contact_offset * 1e3
    if pose is not None and pose.x_mm is not None and pose.y_mm is not None:
        value = math.hypot(1e3 * off_m[0] + pose.x_mm, 1e3 * off_m[1] + pose.y_mm)
    return Criterion(
        name=OFFSET,
        measured=value,
        passed=value <= limit,
        limit=f"the contact in the image is at most {limit:g} mm from the simulated one",
        unit="mm",
        remedy="`tacauchy-rig calibrate scale` finds the place at the image's centre: write it as"
        " camera.centre_x and centre_y into the sensor's file, and check the tool's centre",
    )


def _judge_forces(thresholds: ReportSection, force: ForceAgreement) -> Iterator[Criterion]:
    error, known = force.prediction_error_n, force.known_uncertainty_n
    value = math.nan if error is None or not known else error / known
    limit = thresholds.coverage_factor
    mismatch = math.nan if force.mismatch_n is None else force.mismatch_n
    if not math.isnan(value):
        remedy = "gel, indenter or force sensor differ from their stated values: check the sensor's"
        remedy += " file, the indenter, and the cell with a known weight"
    elif force.mismatch_n is not None:
        remedy = "the measured depth exceeds all simulated depths: check modulus and gel"
    else:
        remedy = NOT_THERE
    yield Criterion(
        name=PREDICTION,
        measured=value,
        passed=abs(value) <= limit,
        limit=f"the force predicted at the measured depth deviates by at most {limit:g} times its"
        f" standard uncertainty{f' of {known:.3g} N' if known else ''}",
        unit="uncertainties",
        remedy=remedy,
    )
    limit = thresholds.max_force_mismatch
    yield Criterion(
        name="force_mismatch",
        measured=mismatch,
        passed=abs(mismatch) <= limit,
        limit=f"|simulated - measured| at most {limit:g} N",
        unit="N",
        remedy=NOT_THERE
        if math.isnan(mismatch)
        else "lower replay.force_tolerance and replay the run: `tacauchy-rig replay RUN`",
    )


def judge_modulus(model: ReplayModel | None, thresholds: ReportSection) -> Iterator[Criterion]:
    """Yield the criteria of a modulus that the run's own depths decided; none where it was stated.

    A fit takes up whatever is wrong with forces and depths alike, so it must stay within what the
    sensor's file allows, and rest on enough presses.
    """
    if model is None or model.modulus_factor is None:
        return
    stated, trials = model.young_uncertainty_relative, model.modulus_trials or 0
    limit = math.nan if stated is None else thresholds.coverage_factor * stated
    yield Criterion(
        name=MODULUS,
        measured=model.modulus_factor,
        passed=abs(model.modulus_factor - 1.0) <= limit,
        limit=f"within {100.0 * limit:.3g} % of 1, which is {thresholds.coverage_factor:g} times"
        " the standard uncertainty in the sensor's file"
        if stated is not None
        else "the sensor's file states the uncertainty of its modulus",
        unit="times the stated modulus",
        remedy="check the force sensor with a known weight, its unit and range; then the gel's"
        " modulus and height in the sensor's file, and the indenter's sizes",
    )
    fewest = thresholds.min_modulus_trials
    yield Criterion(
        name=MODULUS_TRIALS,
        measured=float(trials),
        passed=trials >= fewest,
        limit=f"at least {fewest} trials have the depths and forces that the modulus fit needs",
        unit="trials",
        remedy='replay with replay.modulus = "stated", or press more trials: the fit'
        " omits depths that no simulated press reached",
    )
