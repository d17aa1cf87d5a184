"""The report of a run, made from what was recorded and replayed."""

from __future__ import annotations

from concurrent.futures import Future
from typing import TYPE_CHECKING

from reports.comparison.compare import compare
from reports.comparison.results import ValidationReport
from reports.evidence.attempt import RunReading, readable
from reports.evidence.evidence import RunEvidence
from reports.evidence.loading import check_folder, load_evidence
from tacauchy_rig.core.parallel import worker_process
from tacauchy_rig.core.simulated import REPLAY_NAME

if TYPE_CHECKING:
    from reports.page.writing import ReportPaths
    from tacauchy_rig.core.store.check.run import RunCheck


def evidence_of(run: RunReading, checked: Future[RunCheck] | None = None) -> RunEvidence:
    """Return recorded and simulated forces, depths and images of a run.

    Raises:
        RecordError: Nothing is left to report.
    """
    store, is_replayed = run.store, REPLAY_NAME in run.store.replays()
    replay = readable(lambda: store.load_replay(REPLAY_NAME)) if is_replayed else None
    return load_evidence(run, replay, checked=checked)


def report_run(run: RunReading) -> tuple[ValidationReport, ReportPaths]:
    """Judge a run and write its report into its folder; an older report there is overwritten.

    Returns:
        Every score and verdict, and where the report's files lie.

    Raises:
        RecordError: The run cannot be read, or the report cannot be written.
    """
    with worker_process() as other:
        # It begins while this one imports what draws, which it does while this one reads.
        checked = other.submit(check_folder, run.store.paths.root)
        from reports.figures.draw import RECORDED, draw_some  # noqa: PLC0415
        from reports.page.writing import ReportPaths, make_room, write_report  # noqa: PLC0415

        other.submit(id, draw_some)  # to be given it loads it
        evidence = evidence_of(run, checked)
        paths = ReportPaths(run.store.paths.report)
        make_room(paths.folder)
        recorded = other.submit(draw_some, evidence.drawn, paths.figures, RECORDED)
        report = compare(evidence)
        return report, write_report(report, paths.folder, other, recorded)
