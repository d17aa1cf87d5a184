"""The report of a run, made from what was recorded and replayed."""

from __future__ import annotations

from reports.comparison.compare import compare
from reports.comparison.results import ValidationReport
from reports.evidence.attempt import RunReading, readable
from reports.evidence.evidence import RunEvidence
from reports.evidence.loading import load_evidence
from reports.figures.draw import draw_some
from reports.page.writing import ReportPaths, write_report
from tacauchy_rig.core.parallel import worker_process
from tacauchy_rig.core.simulated import REPLAY_NAME


def evidence_of(run: RunReading) -> RunEvidence:
    """Return recorded and simulated forces, depths and images of a run.

    Raises:
        RecordError: Nothing is left to report.
    """
    store, is_replayed = run.store, REPLAY_NAME in run.store.replays()
    return load_evidence(
        run, readable(lambda: store.load_replay(REPLAY_NAME)) if is_replayed else None
    )


def report_run(run: RunReading) -> tuple[ValidationReport, ReportPaths]:
    """Judge a run and write its report into its folder; an older report there is overwritten.

    Returns:
        Every score and verdict, and where the report's files lie.

    Raises:
        RecordError: The run cannot be read, or the report cannot be written.
    """
    with worker_process() as other:
        other.submit(_load, draw_some)  # what draws is loaded while the run is read
        report = compare(evidence_of(run))
        return report, write_report(report, run.store.paths.report, other)


def _load(_what: object) -> None:
    """Do nothing: to be asked for it loads what the argument needs."""
