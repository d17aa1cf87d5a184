"""What is known of an attempt so far, and every criterion that it is judged by at its end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from protocols.steps.tare import judge_tare
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.run import Criterion, TrialRecord


@dataclass(slots=True, kw_only=True)
class Findings:
    """Filled step by step.

    Attributes:
        record: What was measured so far; its outcome is written last.
        settled: Whether the force had settled before the dwell.
        dwell_frame_count: Camera frames that arrived within the dwell.
        reference_frame_count: The same of the window without contact.
        repeated_frame_count: Frames of the dwell that are another one, byte by byte.
    """

    record: TrialRecord
    settled: bool = False
    dwell_frame_count: int = 0
    reference_frame_count: int = 0
    repeated_frame_count: int = 0


MIN_DWELL_FRAMES = 5
MIN_REFERENCE_FRAMES = 3
MAX_CLIPPED_RATIO = 0.25
"""Of the pixels of an image at full scale; a lit gel has next to none."""


def judge(findings: Findings, config: RigConfig, rates: dict[str, float]) -> Iterator[Criterion]:
    """Compare what was found with ``[protocol]``."""
    record, protocol = findings.record, config.protocol
    if record.tare_before is not None:
        yield from judge_tare(record.tare_before, config)
    if record.force_measured_n is not None and record.force_rate_n_s is not None:
        yield Criterion.at_most(
            "force_mean",
            abs(record.force_measured_n - record.force_target_n),
            protocol.force_tolerance,
            unit="N",
            remedy="raise protocol.settle_timeout, or force_tolerance if the noise is larger",
        )
        yield Criterion.at_most(
            "force_rate",
            abs(record.force_rate_n_s),
            protocol.dwell_force_rate,
            unit="N/s",
            remedy="the gel was still creeping: raise protocol.settle_timeout",
        )
        yield Criterion(
            name="settled",
            passed=findings.settled,
            measured=float(findings.settled),
            limit="the force settled before the dwell",
            unit="",
            remedy="raise protocol.settle_timeout",
        )
        yield _frames("dwell_frames", findings.dwell_frame_count, MIN_DWELL_FRAMES)
        yield Criterion.at_most(
            "repeated_frames",
            float(findings.repeated_frame_count),
            0.0,
            unit="frames",
            remedy="the camera sent the same bytes twice, so its picture is an old one: unplug it "
            "and plug it in again",
        )
    if record.reference_start_ns is not None:
        yield _frames("reference_frames", findings.reference_frame_count, MIN_REFERENCE_FRAMES)
    if record.force_drift_n is not None:
        yield Criterion.at_most(
            "force_drift",
            abs(record.force_drift_n),
            protocol.drift,
            unit="N",
            remedy="let the force sensor warm up; keep draughts off; shorten the trial",
        )
    yield from _rates(rates, config)
    yield from _losses(rates, config)
    yield Criterion.at_most(
        "image_clipped_ratio",
        rates["image_clipped_ratio"],
        MAX_CLIPPED_RATIO,
        remedy="too much light: lower camera.exposure and camera.gain, keep daylight off the gel",
    )


def _rates(rates: dict[str, float], config: RigConfig) -> Iterator[Criterion]:
    for name, least, remedy in (
        ("force_rate_hz", config.protocol.min_force_rate, "see `tacauchy-rig doctor`: serial port"),
        ("image_rate_hz", config.protocol.min_image_rate, "see `tacauchy-rig doctor`: camera"),
    ):
        yield Criterion.at_least(name, rates[name], least, unit="Hz", remedy=remedy)


def _losses(rates: dict[str, float], config: RigConfig) -> Iterator[Criterion]:
    for name in ("force", "image"):
        lost = rates[f"{name}_lost_count"]
        total = max(lost + rates[f"{name}_count"], 1.0)
        yield Criterion.at_most(
            f"{name}_lost_ratio",
            lost / total,
            config.limits.corrupt_ratio,
            remedy=f"see `tacauchy-rig doctor`: the {name} stream loses or damages data",
        )


def _frames(name: str, count: int, least: int) -> Criterion:
    remedy = "see `tacauchy-rig doctor`: the rate that the camera really gives"
    return Criterion.at_least(name, float(count), least, unit="frames", remedy=remedy)
