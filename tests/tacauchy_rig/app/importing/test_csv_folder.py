"""A folder of images with a CSV comes back as what it says, and unknown where it says nothing."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.app.replay.opening import open_run
from tacauchy_rig.app.replay.report import report_run
from tacauchy_rig.core.run import Outcome
from tacauchy_rig.core.store.check.run import check_run
from tacauchy_rig.core.store.recording.reading import Recording
from tacauchy_rig.core.store.run_store import RunStore
from tests.tacauchy_rig.app.importing.sources import counting, write_csv


def test_a_run_of_ours_comes_back(ours: RunStore, tmp_path: Path) -> None:
    """Forces and depths are to rounding what they were, and every check of the run holds."""
    store = import_run(write_csv(ours, tmp_path / "source"), parent=tmp_path)
    assert check_run(store).passed, list(check_run(store).missed())
    assert len(counting(store)) == len(counting(ours)) == 2
    for theirs, own in zip(counting(store), counting(ours), strict=True):
        assert theirs.outcome is Outcome.IMPORTED
        assert not theirs.criteria
        assert theirs.force_measured_n == pytest.approx(own.force_measured_n, abs=1e-9)
        assert theirs.force_deviation_n == pytest.approx(own.force_deviation_n, abs=1e-9)
        assert theirs.depth_measured_m == pytest.approx(own.depth_measured_m, abs=1e-12)


def test_what_is_not_said_is_not_known(small: Path, tmp_path: Path) -> None:
    """Without columns of time and place neither is made up; the run says so."""
    store = import_run(small, parent=tmp_path)
    imported = store.imported.load()
    assert imported is not None
    assert not imported.has_clock
    assert imported.trials[0].place_m is None
    assert "The position of a press on the pad is not known." in imported.unknown
    (record,) = counting(store)
    assert (record.force_measured_n, record.depth_measured_m) == (1.5, pytest.approx(0.25e-3))
    assert record.tare_before is None
    assert store.config.run.sync_mode == "unknown"
    assert store.config.is_imported
    assert not store.simulated


def test_images_are_kept_to_the_byte(small: Path, tmp_path: Path) -> None:
    """A PNG goes into the recording as it is, and comes out so."""
    store = import_run(small, parent=tmp_path)
    frames = list(Recording.open(store.paths.recording(1, 1)).frames())
    assert [frame.jpeg for frame in frames] == [
        (small / name).read_bytes() for name in ("rest.png", "press.png")
    ]


def test_presses_without_force_and_with_place_and_indenter(small: Path, tmp_path: Path) -> None:
    """Any of force, depth, place and indenter may be given, each in its unit."""
    (small / "presses.csv").write_text(
        "image,depth,at x,at y,tool\npress.png,0.25,1.5,-2,sphere:diameter=6mm\n"
    )
    text = (small / "import.toml").read_text()
    text = text.replace('force = { column = "fz", unit = "N" }', 'indenter = "tool"')
    axes = "\n".join(f'{a} = {{ column = "at {a}", unit = "mm" }}' for a in "xy")
    text = text.replace("[rig.sensor]", f"{axes}\n[rig.sensor]")
    (small / "import.toml").write_text(text)
    store = import_run(small, parent=tmp_path)
    trial = store.imported_trials[1]
    assert trial.place_m == pytest.approx((1.5e-3, -2e-3))
    assert trial.indenter == "sphere:diameter=6mm"
    (record,) = counting(store)
    assert record.force_measured_n is None
    assert record.depth_measured_m == pytest.approx(0.25e-3)


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
    assert "the delay between force and image of a row" in " ".join(report.limits).lower()
