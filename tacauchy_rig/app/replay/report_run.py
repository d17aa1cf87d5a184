"""The report of a run, made from what was recorded and replayed."""

from reports.comparison.result_types import ValidationReport
from reports.comparison.run_comparison import compare
from reports.evidence.evidence_types import RunEvidence
from reports.evidence.frames_and_curves import RunReading, readable
from reports.evidence.gather_evidence import load_evidence
from reports.figures.all_figures import RECORDED, draw_some, load_drawers
from reports.page.summary_and_junit import ReportPaths, make_room, write_report
from tacauchy_rig.core.parallel import worker_process
from tacauchy_rig.core.simulated import REPLAY_NAME


def evidence_of(run: RunReading) -> RunEvidence:
    """Return recorded and simulated forces, depths and images of a run.

    Raises:
        RecordError: Nothing is left to report.
    """
    store, is_replayed = run.store, REPLAY_NAME in run.store.replays()
    replay = readable(lambda: store.load_replay(REPLAY_NAME)) if is_replayed else None
    return load_evidence(run, replay)


def report_run(run: RunReading) -> tuple[ValidationReport, ReportPaths]:
    """Judge a run and write its report into its folder; an older report there is overwritten.

    Returns:
        Every score and verdict, and where the report's files lie.

    Raises:
        RecordError: The run cannot be read, or the report cannot be written.
    """
    with worker_process() as other:
        other.submit(_load)
        evidence = evidence_of(run)
        paths = ReportPaths(run.store.paths.report)
        make_room(paths.folder)
        recorded = other.submit(draw_some, evidence.drawn, paths.figures, RECORDED)
        report = compare(evidence)
        return report, write_report(report, paths.folder, other, recorded)


def _load() -> None:
    """Load what draws, and return none of it: that would load it in the other process, too."""
    load_drawers()
