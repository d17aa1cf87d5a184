"""What is known of an attempt so far, and every criterion that it is judged by at its end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from protocols.control.window import ReferenceWindow
from protocols.steps.press import Dwell
from protocols.steps.tare import judge_tare
from tacauchy_rig.config.model import RigConfig
from tacauchy_rig.run import Criterion, Outcome, Tare, TrialRecord, TrialSpec


@dataclass(slots=True, kw_only=True)
class Findings:
    """Filled step by step."""

    spec: TrialSpec
    attempt: int
    tare_before: Tare | None = None
    tare_after: Tare | None = None
    reference: ReferenceWindow | None = None
    contact_z_m: float | None = None
    dwell: Dwell | None = None
    drift_n: float | None = None

    def record(
        self,
        outcome: Outcome,
        *,
        rates: dict[str, float],
        reason: str = "",
        criteria: tuple[Criterion, ...] = (),
    ) -> TrialRecord:
        """Return the record of the attempt."""
        dwell, reference = self.dwell, self.reference
        return TrialRecord(
            index=self.spec.index,
            attempt=self.attempt,
            outcome=outcome,
            force_target_n=self.spec.force_target_n,
            reason=reason,
            force_measured_n=dwell.force.mean_n if dwell else None,
            force_deviation_n=dwell.force.deviation_n if dwell else None,
            force_rate_n_s=dwell.force.slope_n_s if dwell else None,
            force_drift_n=self.drift_n,
            contact_z_m=self.contact_z_m,
            depth_measured_m=dwell.depth_m if dwell else None,
            tare_before=self.tare_before,
            tare_after=self.tare_after,
            dwell_start_ns=dwell.force.start_ns if dwell else None,
            dwell_end_ns=dwell.force.end_ns if dwell else None,
            reference_start_ns=reference.start_ns if reference else None,
            reference_end_ns=reference.end_ns if reference else None,
            criteria=criteria,
            rates=rates,
        )


MIN_DWELL_FRAMES = 5
MIN_REFERENCE_FRAMES = 3
MAX_CLIPPED_RATIO = 0.25
"""Of the pixels of an image at full scale; a lit gel has next to none."""


def judge(findings: Findings, config: RigConfig, rates: dict[str, float]) -> tuple[Criterion, ...]:
    """Compare what was found with ``[protocol]``."""
    return tuple(_criteria(findings, config, rates))


def _criteria(
    findings: Findings, config: RigConfig, rates: dict[str, float]
) -> Iterator[Criterion]:
    if findings.tare_before is not None:
        yield from judge_tare(findings.tare_before, config)
    if findings.dwell is not None:
        yield from _force(findings.dwell, findings.spec.force_target_n, config)
        yield _frames("dwell_frames", findings.dwell.frame_count, MIN_DWELL_FRAMES)
    if findings.reference is not None:
        yield _frames("reference_frames", findings.reference.frame_count, MIN_REFERENCE_FRAMES)
    if findings.drift_n is not None:
        yield _at_most(
            "force_drift",
            abs(findings.drift_n),
            config.protocol.drift,
            "N",
            "let the force sensor warm up; keep draughts off; shorten the trial",
        )
    yield from _rates(rates, config)
    yield from _losses(rates, config)
    yield _at_most(
        "image_clipped_ratio",
        rates["image_clipped_ratio"],
        MAX_CLIPPED_RATIO,
        "",
        "too much light: lower camera.exposure and camera.gain, keep daylight off the gel",
    )


def _force(dwell: Dwell, target_n: float, config: RigConfig) -> Iterator[Criterion]:
    protocol = config.protocol
    yield _at_most(
        "force_mean",
        abs(dwell.force.mean_n - target_n),
        protocol.force_tolerance,
        "N",
        "raise protocol.settle_timeout, or force_tolerance if the noise is larger",
    )
    yield _at_most(
        "force_rate",
        abs(dwell.force.slope_n_s),
        protocol.dwell_force_rate,
        "N/s",
        "the gel was still creeping: raise protocol.settle_timeout",
    )
    yield Criterion(
        name="settled",
        passed=dwell.settled,
        measured=float(dwell.settled),
        limit="the force settled before the dwell",
        unit="",
        remedy="raise protocol.settle_timeout",
    )


def _rates(rates: dict[str, float], config: RigConfig) -> Iterator[Criterion]:
    for name, least, remedy in (
        ("force_rate_hz", config.protocol.min_force_rate, "see `tacauchy-rig doctor`: serial port"),
        ("image_rate_hz", config.protocol.min_image_rate, "see `tacauchy-rig doctor`: camera"),
    ):
        yield Criterion(
            name=name,
            passed=rates[name] >= least,
            measured=rates[name],
            limit=f">= {least:g} Hz",
            unit="Hz",
            remedy=remedy,
        )


def _losses(rates: dict[str, float], config: RigConfig) -> Iterator[Criterion]:
    for name in ("force", "image"):
        lost = rates[f"{name}_lost_count"]
        total = max(lost + rates[f"{name}_count"], 1.0)
        yield _at_most(
            f"{name}_lost_ratio",
            lost / total,
            config.limits.corrupt_ratio,
            "",
            f"see `tacauchy-rig doctor`: the {name} stream loses or damages data",
        )


def _at_most(name: str, measured: float, limit: float, unit: str, remedy: str) -> Criterion:
    return Criterion(
        name=name,
        passed=measured <= limit,
        measured=measured,
        limit=f"<= {limit:g} {unit}".strip(),
        unit=unit,
        remedy=remedy,
    )


def _frames(name: str, count: int, least: int) -> Criterion:
    return Criterion(
        name=name,
        passed=count >= least,
        measured=float(count),
        limit=f">= {least} frames",
        unit="frames",
        remedy="see `tacauchy-rig doctor`: the rate that the camera really gives",
    )
