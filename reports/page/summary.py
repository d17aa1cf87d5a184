"""``summary.json``: every number of the report; the HTML is made from it and the figures."""

from __future__ import annotations

from typing import Any

from reports.comparison.results import TrialResult, ValidationReport
from reports.scores.floors import NOISE_MULTIPLE
from reports.scores.metrics import Metric
from reports.scores.statistics import CONFIDENCE
from tacauchy_rig.page import prose
from tacauchy_rig.store.codec import to_plain

SCHEMA = 1


def build_summary(report: ValidationReport) -> dict[str, Any]:
    """Return the JSON value of ``summary.json``; units stand in the keys, nothing is NaN."""
    evidence = report.evidence
    geometry = evidence.geometry
    return {
        "schema": SCHEMA,
        "simulated": evidence.simulated,
        "passed": report.passed,
        "verdict": report.verdict,
        "reading": list(report.reading),
        "limits": list(report.limits),
        "thresholds": to_plain(evidence.thresholds),
        "image": {
            "width_px": geometry.width_px,
            "height_px": geometry.height_px,
            "crop_fraction_per_border": geometry.crop_fraction,
            "scale_x_mm_px": _millimetres(geometry.scale_x_m_px),
            "scale_y_mm_px": _millimetres(geometry.scale_y_m_px),
            "mask": "none: the whole scored frame",
            "real": "pixelwise median of the frames of the dwell",
            "reference": "pixelwise median of the no-contact frames before the press",
        },
        "definitions": {
            name: prose(
                "reports",
                "templates/definitions.txt.jinja",
                name,
                noise_multiple=f"{NOISE_MULTIPLE:g}",
                confidence=f"{CONFIDENCE:.0%}",
            )
            for name in (*Metric, "metrics", "skill", "contact", "interval")
        },
        "trials": [_trial(trial) for trial in report.trials],
        "statistics": to_plain(report.statistics),
        "wrong_force_matrices": to_plain(report.matrices),
        "truth": to_plain(report.truth),
        "sync_mode": evidence.sync_mode,
        "journal": to_plain(evidence.journal),
        "model": {} if evidence.model is None else to_plain(evidence.model),
        "provenance": {
            "versions": {},
            "config_hash": None,
            "seed": None,
            **to_plain(evidence.provenance),
        },
    }


def _trial(trial: TrialResult) -> dict[str, Any]:
    value: dict[str, Any] = to_plain(trial)
    # Readers find these keys in every trial, with nulls where there was nothing to score.
    value["metrics"] = value["metrics"] or {metric.value: None for metric in Metric}
    value["floors"] = value["floors"] or {"no_contact": None, "flat_mean": None}
    value["floors"]["wrong_force"] = value["floors"].get("wrong_force") or {}
    return value


def _millimetres(value_m: float | None) -> float | None:
    return None if value_m is None else value_m * 1e3
