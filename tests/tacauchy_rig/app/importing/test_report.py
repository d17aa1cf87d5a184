"""A report of an imported run says so everywhere, and never that something passed by itself."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree as ET

from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.app.replay.opening import open_run
from tacauchy_rig.app.replay.report import report_run


def test_an_imported_run_is_marked_and_not_passed(small: Path, tmp_path: Path) -> None:
    """Page, summary, table and JUnit say imported; what rests on no data is not known."""
    store = import_run(small, parent=tmp_path)
    report, paths = report_run(open_run(store.paths.root))
    assert not report.passed
    assert report.verdict.startswith("Imported from small (csv)")
    page, summary = paths.html.read_text(), json.loads(paths.summary.read_text())
    assert page.count("IMPORTED: recorded elsewhere") == 2
    assert summary["imported"]
    assert not summary["passed"]
    assert "not known" in page
    press = next(c for c in summary["trials"][0]["criteria"] if c["name"] == "press")
    assert (press["passed"], press["measured"]) == (False, None)
    suite = ET.parse(paths.junit).getroot()  # noqa: S314 - our own file
    skipped = {
        case.get("name") for case in suite.iter("testcase") if case.find("skipped") is not None
    }
    assert {"press", "contact_offset", "force_margin"} <= skipped
    assert "what ties force and image of a row together" in " ".join(report.limits).lower()
