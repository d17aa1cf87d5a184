"""The report in plain sentences: the verdict, what the scores can tell, and what they cannot.

Every sentence is made from the numbers of this run; none is praise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from reports.comparison.criteria import RECORDED
from reports.comparison.results import RunStatistics, TrialResult
from reports.evidence.evidence import RunEvidence
from reports.scores.floors import CONTACT_RESIDUAL, CeilingKind, SkillStatus, WrongForceMatrix
from reports.scores.metrics import Metric
from tacauchy_rig.run import ReplayModel

CLAIM_REPEATS = 5
MINUS = "\u2212"
NAMES = {
    Metric.SSIM: "SSIM",
    Metric.NCC: "NCC",
    Metric.HISTOGRAM_CORRELATION: "histogram correlation",
    Metric.PSNR_DB: "PSNR",
    Metric.MSE: "MSE",
}


def verdict_of(trials: Sequence[TrialResult], evidence: RunEvidence, *, passed: bool) -> str:
    """Say in one sentence whether the run met its criteria, with the worst numbers."""
    if not trials:
        return "Not passed: the run has no trial."
    subject = "presses on emulated devices" if evidence.simulated else "presses"
    if passed:
        worst = max(abs(t.force_mismatch_n or 0.0) for t in trials)
        lowest = min(t.metrics.ssim for t in trials if t.metrics is not None)
        limits = evidence.thresholds
        return (
            f"Passed: all {len(trials)} {subject} met every criterion; simulated and measured"
            f" force differ by at most {worst:.3f} N (limit {limits.max_force_mismatch_n:g} N) and"
            f" the lowest SSIM is {lowest:.3f} (limit {limits.ssim:g})."
        )
    missed = [_first_miss(trial) for trial in trials if not trial.passed]
    count = f"{len(missed)} of {len(trials)} {subject}"
    return f"Not passed: {count} missed a criterion: {'; '.join(missed)}."


def _first_miss(trial: TrialResult) -> str:
    criterion = next(c for c in trial.criteria if not c.passed)
    if criterion.name == "press":
        what = "was not pressed" if trial.outcome == "missing" else trial.outcome
        return f"trial {trial.index} ({what})"
    value = f"{criterion.measured:.3f} {criterion.unit}".rstrip()
    asked = f", asked: {criterion.limit}" if criterion.name in RECORDED else ""
    return f"trial {trial.index} ({criterion.name.replace('_', ' ')} {value}{asked})"


def read_scores(
    trials: Sequence[TrialResult],
    statistics: RunStatistics,
    matrices: Sequence[WrongForceMatrix],
) -> tuple[str, ...]:
    """Say what the scores of this run can and cannot tell."""
    return (
        *_against_floor(statistics),
        *_discrimination(matrices),
        *_contact(trials, statistics),
        *_ceiling(trials),
        *_force_claims(trials, statistics),
    )


def _against_floor(statistics: RunStatistics) -> Iterator[str]:
    ours, floor = statistics.metrics["ssim"].mean, statistics.no_contact["ssim"].mean
    if ours is None or floor is None:
        return
    yield (
        f"The simulated images score SSIM {ours:.3f} on average; the frame without any contact,"
        f" which knows nothing of the press, scores {floor:.3f}. Only the distance between the two"
        " is earned by the simulation."
    )
    losers = [NAMES[m] for m in Metric if _loses(statistics, m)]
    if losers:
        yield (
            f"By {_join(losers)} the simulated images are on average no better than showing no"
            " contact at all."
        )


def _loses(statistics: RunStatistics, metric: Metric) -> bool:
    ours = statistics.metrics[metric.value].mean
    floor = statistics.no_contact[metric.value].mean
    if ours is None or floor is None:
        return False
    return ours <= floor if metric.larger_is_better else ours >= floor


def _discrimination(matrices: Sequence[WrongForceMatrix]) -> Iterator[str]:
    won = {m.metric: (sum(m.diagonal_wins), len(m.trials)) for m in matrices}
    if not won:
        return
    full = [NAMES[m] for m in Metric if m in won and won[m.value][0] == won[m.value][1]]
    partly = [
        f"{NAMES[m]} (right in {won[m.value][0]} of {won[m.value][1]} trials)"
        for m in Metric
        if m in won and won[m.value][0] < won[m.value][1]
    ]
    if full:
        yield f"The right force beats every wrong force in all trials by {_join(full)}."
    if partly:
        yield (
            f"A wrong force sometimes scores as well or better by {_join(partly)}:"
            " there the score does not tell which force was simulated."
        )
    if CONTACT_RESIDUAL in won:
        yield (
            "The residual inside the contact picks the right force in"
            f" {won[CONTACT_RESIDUAL][0]} of {won[CONTACT_RESIDUAL][1]} trials."
        )


def _contact(trials: Sequence[TrialResult], statistics: RunStatistics) -> Iterator[str]:
    zncc, residual = statistics.contact_zncc.mean, statistics.contact_relative_residual.mean
    if zncc is not None and residual is not None:
        yield (
            f"Inside the contact alone the change of the image correlates by {zncc:.3f} and"
            f" {percent(residual, 0)} of its norm is unexplained (showing no contact leaves 100 %)."
        )
    hidden = [str(t.index) for t in trials if t.metrics is not None and t.contact is None]
    if hidden:
        yield f"No contact stands out in the real image of trial {_join(hidden)}."


def _ceiling(trials: Sequence[TrialResult]) -> Iterator[str]:
    kinds = {t.ceiling.kind for t in trials if t.ceiling is not None}
    if CeilingKind.NOISE in kinds:
        yield (
            "The ceiling is two halves of one dwell: camera noise only. A repeat of the press"
            " would score lower, so the skill shown here is a lower bound."
        )
    beaten = [
        NAMES[m]
        for m in Metric
        if any(t.skill[m.value].status is SkillStatus.ABOVE_CEILING for t in trials if t.skill)
    ]
    if beaten:
        yield (
            f"By {_join(beaten)} a simulated image beats the sensor against itself in some trials:"
            " it has no noise. That is no merit of the simulation."
        )
    blunt = [
        NAMES[m]
        for m in Metric
        if any(t.skill[m.value].status is SkillStatus.NOT_DISCRIMINATING for t in trials if t.skill)
    ]
    if blunt:
        yield (
            f"In some trials {_join(blunt)} cannot tell a repeat from no contact beyond its own"
            " noise and is marked not discriminating."
        )


def _force_claims(trials: Sequence[TrialResult], statistics: RunStatistics) -> Iterator[str]:
    yield (
        "That simulated and measured force agree is by construction: the simulated indenter was"
        " moved until they did. It says nothing of the simulator's force."
    )
    interval = statistics.prediction_error_relative
    if interval.mean is None:
        return
    spread = ""
    if interval.low is not None and interval.high is not None:
        spread = (
            f" (95 % interval of the mean {percent(interval.low, 1, signed=True)} to"
            f" {percent(interval.high, 1, signed=True)})"
        )
    count = interval.count
    yield (
        f"Pressed to the measured depth instead, the simulator's force is off by"
        f" {percent(interval.mean, 1, signed=True)} on average over {count} of"
        f" {len(trials)} trials{spread};"
        " that is its prediction."
    )


def limits_of(
    trials: Sequence[TrialResult], statistics: RunStatistics, evidence: RunEvidence
) -> tuple[str, ...]:
    """List what this report does not show."""
    return tuple(_limits(trials, statistics, evidence))


def _limits(
    trials: Sequence[TrialResult], statistics: RunStatistics, evidence: RunEvidence
) -> Iterator[str]:
    if evidence.simulated:
        yield (
            f"Emulated here: {_emulated(evidence)}. The numbers show that the pipeline works, not"
            " that the simulator matches any real sensor."
        )
    yield SYNC_SENTENCES.get(
        evidence.sync_mode, f"Force and images are tied together by {evidence.sync_mode}."
    )
    if statistics.repeats_per_force < CLAIM_REPEATS:
        yield (
            f"Repeats per force: {statistics.repeats_per_force}. A claim about one force needs at"
            f" least {CLAIM_REPEATS}; the intervals are over different forces."
        )
    if evidence.geometry.scale_x_m_px is None:
        yield "The image scale is not calibrated: distances are in pixels only."
    if any(not t.force.budget_complete for t in trials):
        yield (
            "Parts of the uncertainty of the force are unknown (see the budget): the combined"
            " value is a lower bound, and nothing finer than it is claimed."
        )
    if evidence.model is not None and evidence.model.modulus_factor is not None:
        yield _modulus(evidence.model)
    yield (
        "One flat punch cannot identify modulus and Poisson's ratio separately; only their"
        " combination with the layer's thickness acts on the force."
    )


def _modulus(model: ReplayModel) -> str:
    factor, spread = model.modulus_factor, model.modulus_factor_deviation
    modulus = "" if model.layers else f", at {model.young_pa * 1e-6:.4f} MPa"
    return (
        f"The gel was replayed {factor:.3f} times as stiff as stated (between trials +-"
        f"{spread:.3f}){modulus}: that is what the measured depths and forces of"
        f" {model.modulus_trials} trials say; no image had a part in it. Depths and images are"
        " of that gel; forces predicted at measured depths are of the stated one."
    )


def _emulated(evidence: RunEvidence) -> str:
    devices = evidence.provenance.get("devices", {})
    names = [name for name, device in devices.items() if device.get("simulated")]
    return _join([name.replace("_", " ") for name in names]) if names else "one device or more"


SYNC_SENTENCES = {
    "host_clock": (
        "Force and images were stamped on arrival by this computer's clock; nothing was"
        " triggered by hardware, so their relative delay is not known better than the arrival"
        " intervals shown."
    ),
    "do_marker": "A digital output of the robot marks the streams; arrival is stamped by the host.",
    "tap_calibrated": "The delay between force and images was calibrated by a tap.",
    "external_trigger": "Force and images were triggered by one external hardware signal.",
}


def percent(ratio: float, digits: int, *, signed: bool = False) -> str:
    """Write a ratio in percent with a true minus sign."""
    text = f"{100.0 * ratio:+.{digits}f}" if signed else f"{100.0 * ratio:.{digits}f}"
    return f"{text.replace('-', MINUS)} %"


def _join(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
