"""Write a report: figures, images, ``summary.json``, and what is made from it."""

import csv
import io
import json
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from reports.comparison.result_types import TrialResult, ValidationReport, headline_of
from reports.comparison.verdict_sentences import fits_of
from reports.evidence.evidence_types import RunEvidence
from reports.figures.all_figures import draw_figures
from reports.figures.difference_colours import (
    color_difference,
    difference_scale,
    luminance_difference,
)
from reports.page.report_html import is_unknown, passing_states, render_html
from reports.scores.confidence_interval import CONFIDENCE
from reports.scores.image_metrics import NOISE_MULTIPLE, Metric
from tacauchy_rig.core.config.load import leaves
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.image_codec import encode_png
from tacauchy_rig.core.markdown_page import prose
from tacauchy_rig.core.store.json_codec import to_plain

SCHEMA = 1
_LIMITS = "min_force_margin", "max_contact_residual", "coverage_factor", "min_modulus_trials"


def build_summary(report: ValidationReport) -> dict[str, Any]:
    """Return the JSON value of ``summary.json``; units stand in the keys, nothing is NaN."""
    evidence = report.evidence
    geometry, limits = evidence.geometry, evidence.thresholds
    return {
        "schema": SCHEMA,
        "simulated": evidence.simulated,
        "imported": evidence.imported is not None,
        "marks": list(evidence.marks),
        "passed": report.passed,
        "verdict": report.verdict,
        "abstract": report.abstract,
        "headline": to_plain(headline_of(report.trials, report.criteria)),
        "fits": to_plain(fits_of(evidence)),
        "criteria": to_plain(report.criteria),
        "reading": list(report.reading),
        "limits": list(report.limits),
        "thresholds": {
            **{name: getattr(limits, name) for name in _LIMITS},
            "max_contact_offset_m": limits.max_contact_offset,
            "max_force_mismatch_n": limits.max_force_mismatch,
        },
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
                camera=evidence.camera,
                noise_multiple=f"{NOISE_MULTIPLE:g}",
                confidence=f"{CONFIDENCE:.0%}",
            )
            for name in (*Metric, "metrics", "skill", "contact", "interval")
        },
        "optics": None if evidence.optics is None else to_plain(evidence.optics),
        "trials": [_trial(trial, evidence) for trial in report.trials],
        "statistics": to_plain(report.statistics),
        "wrong_force_matrices": to_plain(report.matrices),
        "truth": to_plain(report.truth),
        "sync_mode": evidence.sync_mode,
        "force_check": None
        if evidence.force_check is None
        else {
            **to_plain(evidence.force_check),
            "passed": evidence.force_check.passed,
            "ratio": evidence.force_check.ratio,
        },
        "force_history": {
            **to_plain(evidence.force_history),
            "uncertainty": to_plain(evidence.force_history.uncertainty),
            "weighed_after": evidence.weighed_after,
        },
        "journal": to_plain(evidence.journal),
        "model": {} if evidence.model is None else to_plain(evidence.model),
        "other_models": to_plain(evidence.others),
        "provenance": to_plain(evidence.provenance),
    }


def _trial(trial: TrialResult, evidence: RunEvidence) -> dict[str, Any]:
    value: dict[str, Any] = to_plain(trial)
    model = evidence.model_of(trial.index)
    if model is not None and evidence.others:
        value["pressed_with"] = {
            "indenter": model.indenter,
            "x_m": model.centre_x_m,
            "y_m": model.centre_y_m,
        }
    # Readers find these keys in every trial, with nulls where there was nothing to score.
    value["metrics"] = value["metrics"] or {metric.value: None for metric in Metric}
    value["floors"] = value["floors"] or {"no_contact": None, "flat_mean": None}
    value["floors"]["wrong_force"] = value["floors"].get("wrong_force") or {}
    return value


def _millimetres(value_m: float | None) -> float | None:
    return None if value_m is None else value_m * 1e3


def metrics_csv(summary: Mapping[str, Any]) -> str:
    """Return one line a trial with every scalar of ``summary.json``, empty where unknown.

    Nested names are joined by dots, such as ``floors.no_contact.ssim``.
    """
    rows = [
        {name: value for name, value in leaves(trial) if not isinstance(value, list)}
        for trial in summary["trials"]
    ]
    columns = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    marks = {key: summary[key] for key in ("simulated", "imported")}
    writer = csv.DictWriter(text, [*marks, *columns], lineterminator="\n", restval="")
    writer.writeheader()
    for row in rows:
        writer.writerow({**marks, **row})
    return text.getvalue()


def junit_xml(summary: Mapping[str, Any]) -> str:
    """Return a JUnit report of a case per criterion of the run and of each trial."""
    cases = [("run", criterion) for criterion in summary["criteria"]]
    for trial in summary["trials"]:
        target = trial["force_target_n"]
        force = "" if target is None else f"-{target:.4f}N"
        name = f"trial-{trial['index']:02d}{force}"
        cases += [(name, criterion) for criterion in trial["criteria"]]
    unknown = [is_unknown(criterion, summary) for _, criterion in cases]
    failures = sum(not criterion["passed"] for _, criterion in cases) - sum(unknown)
    name = f"tacauchy-rig {summary['provenance'].get('name', 'run')}"
    name += "".join(f" ({mark.partition(':')[0]})" for mark in summary["marks"])
    counted = {"tests": len(cases), "failures": failures, "skipped": sum(unknown), "errors": 0}
    root = ET.Element("testsuites", {"name": name, **{k: str(n) for k, n in counted.items()}})
    suite = ET.SubElement(root, "testsuite", root.attrib)
    properties = ET.SubElement(suite, "properties")
    for key in ("simulated", "imported", "passed"):
        ET.SubElement(properties, "property", name=key, value=str(summary[key]).lower())
    for (where, criterion), skipped in zip(cases, unknown, strict=True):
        case = ET.SubElement(suite, "testcase", classname=where, name=criterion["name"])
        if skipped:
            ET.SubElement(case, "skipped", message=f"not known; {criterion['limit']}")
        elif not criterion["passed"]:
            message = f"{_measured(criterion)}; limit: {criterion['limit']}"
            failure = ET.SubElement(case, "failure", message=message, type="criterion")
            failure.text = criterion["remedy"]
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _measured(criterion: Mapping[str, Any]) -> str:
    if criterion["measured"] is None:
        return "not measured"
    return f"measured {criterion['measured']:.6g} {criterion['unit']}".rstrip()


OPTICS_PICTURE = "optics-held-out.png"


class ReportPaths:
    """Where the parts of a report lie."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.html = folder / "report.html"
        self.summary = folder / "summary.json"
        self.junit = folder / "junit.xml"
        self.metrics = folder / "metrics.csv"
        self.figures = folder / "figures"
        self.images = folder / "images"


def write_report(
    report: ValidationReport,
    folder: Path,
    other: Executor | None = None,
    recorded: Future[list[str]] | None = None,
) -> ReportPaths:
    """Write all files of a report into ``folder``; an older report there is overwritten.

    Another process, if there is one, draws the figures, or ``recorded`` is what it drew.

    Raises:
        RecordError: The folder cannot be written.
    """
    paths = ReportPaths(folder)
    with _refusing(folder):
        _write(report, paths, draw_figures(report, paths.figures, other, recorded))
    return paths


def make_room(folder: Path) -> None:
    """Take out of a report's folder the files that have another name, which keeps their content."""
    with _refusing(folder):
        for path in folder.rglob("*"):
            if path.is_file() and path.stat().st_nlink > 1:
                path.unlink()


@contextmanager
def _refusing(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RecordError(
            f"report in {folder}: cannot be written: {error.strerror or error}",
            remedy="check space and permissions, then `tacauchy-rig report RUN` writes it again",
        ) from error


def _write(report: ValidationReport, paths: ReportPaths, figures: list[dict[str, str]]) -> None:
    pictures = _write_pictures(report.evidence, paths.images)
    if picture := report.evidence.optics_picture:
        (paths.images / OPTICS_PICTURE).write_bytes(picture)
    summary = build_summary(report)
    summary["figures"] = figures
    numbers, shown = passing_states(report.evidence)
    for trial in summary["trials"]:
        trial["images"] = pictures.get(trial["index"], {})
        trial["passing"] = numbers.get(trial["index"], [])
    # allow_nan=False: a NaN that slipped through is a bug of ours and must not reach a reader.
    summary["optics_picture"] = OPTICS_PICTURE if picture else None
    text = json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False)
    paths.summary.write_text(text + "\n", encoding="utf-8")
    paths.metrics.write_text(metrics_csv(summary), encoding="utf-8")
    paths.junit.write_text(junit_xml(summary), encoding="utf-8")
    html = render_html(summary, figures=paths.figures, images=paths.images, intermediate=shown)
    paths.html.write_text(html, encoding="utf-8")


def _write_pictures(evidence: RunEvidence, folder: Path) -> dict[int, dict[str, str]]:
    """Write the images of every trial; return their file names by trial and kind."""
    folder.mkdir(parents=True, exist_ok=True)
    scale = difference_scale(map(luminance_difference, evidence.trials))
    names: dict[int, dict[str, str]] = {}
    for trial in evidence.trials:
        difference = luminance_difference(trial)
        images = {
            "real": None if trial.images is None else trial.images.real,
            "reference": None if trial.images is None else trial.images.reference,
            "simulated": trial.simulated_image,
            "difference": None if difference is None else color_difference(difference, scale),
        }
        for kind, image in images.items():
            if image is not None:
                name = f"{trial.index:02d}-{kind}.png"
                (folder / name).write_bytes(encode_png(image))
                names.setdefault(trial.index, {})[kind] = name
    return names
