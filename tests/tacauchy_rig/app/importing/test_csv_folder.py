"""Folders of images come back as their presses, with an import.toml of a person's or guessed."""

import json
import tomllib
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from tacauchy_rig.app.importing.guess_import_toml import write_guess
from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.app.replay.open_run import open_run
from tacauchy_rig.app.replay.report_run import report_run
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.image_codec import decode_rgb
from tacauchy_rig.core.run import Outcome
from tacauchy_rig.core.store.check.run_and_press_check import check_run
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.run_store import RunStore
from tests.tacauchy_rig.app.importing.sources import (
    BLUE,
    RED,
    counting,
    make_records,
    record,
    write_csv,
)
from tests.tacauchy_rig.app.importing.test_kinds import comma, image


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
    """Neither time nor place is made up; the run says so, and keeps images to the byte."""
    store = import_run(small, parent=tmp_path)
    frames = list(Recording.open(store.paths.recording(1, 1)).frames())
    stored = [(small / name).read_bytes() for name in ("rest.png", "press.png")]
    assert [frame.jpeg for frame in frames] == stored
    imported = store.imported.load()
    assert imported is not None
    assert (imported.has_clock, imported.trials[0].place_m) == (False, None)
    assert "The position of a press is not known." in imported.unknown
    (record,) = counting(store)
    assert (record.force_measured_n, record.depth_measured_m) == (1.5, pytest.approx(0.25e-3))
    assert record.tare_before is None
    assert store.config.run.sync_mode == "unknown"
    assert (store.config.is_imported, store.simulated) == (True, False)


def test_an_imported_run_is_marked_and_not_passed(small: Path, tmp_path: Path) -> None:
    """Page, summary, table and JUnit say imported; what rests on no data is not known."""
    store = import_run(small, parent=tmp_path)
    report, paths = report_run(open_run(store.paths.root))
    assert not report.passed
    assert report.verdict.startswith("Imported from small (csv)")
    page, summary = paths.html.read_text(), json.loads(paths.summary.read_text())
    assert page.count("IMPORTED: recorded elsewhere") == 2
    assert (summary["imported"], summary["passed"]) == (True, False)
    assert "not known" in page
    press = next(c for c in summary["trials"][0]["criteria"] if c["name"] == "press")
    assert (press["passed"], press["measured"]) == (False, None)
    suite = ET.parse(paths.junit).getroot()  # noqa: S314 - our own file
    skipped = [case for case in suite.iter("testcase") if case.find("skipped") is not None]
    assert {"press", "contact_offset", "force_margin"} <= {case.get("name") for case in skipped}
    assert "the delay between force and image of a row" in " ".join(report.limits).lower()


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """Two straight presses of a ball and a punch, and one that slides."""
    return make_records(tmp_path / "source")


def test_records_become_presses(source: Path, tmp_path: Path) -> None:
    """Force, depth, place and indenter as told; red is red; who slides is left out and counted."""
    store = import_run(source, parent=tmp_path)
    assert check_run(store).passed, list(check_run(store).missed())
    ball, punch = counting(store)
    assert (ball.force_measured_n, ball.depth_measured_m) == pytest.approx((2.5, 0.4e-3))
    assert (punch.force_measured_n, punch.depth_measured_m) == pytest.approx((4.0, 0.3e-3))
    told = store.imported_trials
    assert [each.name for each in told.values()] == ["1_sphere_10", "2_cylinder_5"]
    assert told[1].place_m == pytest.approx((1.5e-3, -2e-3))
    assert told[1].indenter == "sphere:diameter=10mm"
    frames = [each.jpeg for each in Recording.open(store.paths.recording(1, 1)).frames()]
    rest, pressed = (decode_rgb(data) for data in frames)
    assert rest is not None
    assert pressed is not None
    assert rest[0, 0].tolist() == [90, 90, 90]
    assert pressed[0, 0].tolist() == [RED, 60, BLUE]
    imported = store.imported.load()
    assert imported is not None
    assert any("1 records were left out" in note for note in imported.notes)


def test_a_structured_array_is_a_record(source: Path, tmp_path: Path) -> None:
    """An array with named fields needs no archive; a pickle beside its archive is not touched."""
    np.save(source / "feats/1_sphere_10.npy", np.array(record(), dtype=object), allow_pickle=True)
    values = {key: np.asarray(value) for key, value in record(fz=3.0).items()}
    kind = [(key, value.dtype, value.shape) for key, value in values.items()]
    np.save(source / "feats/4_sphere_10.npy", np.array([tuple(values.values())], dtype=kind))
    store = import_run(source, parent=tmp_path)
    forces = [each.force_measured_n for each in counting(store)]
    assert forces == pytest.approx([2.5, 4.0, 3.0])


GF = 9.80665e-3
TOOLS = ("Kugel 6 mm", "Kugel 8 mm", "Zylinder 5mm")


def lab(folder: Path, random: np.random.Generator, count: int) -> np.ndarray:
    """Write presses of a DIGIT at unlike places as spreadsheets do; return their forces [N]."""
    (folder / "bilder").mkdir(parents=True)
    force = random.uniform(0.5, 3.0, count)
    rows = ["Nr;Zeit;Bild;Werkzeug;Kraft [gf];Tiefe [mm];x [mm];y [mm]"]
    (folder / "bilder" / "leer_digit.png").write_bytes(image(random, 0.0))
    for k, newton in enumerate(force.tolist(), start=1):
        (folder / "bilder" / f"p{k:02d}.png").write_bytes(image(random, 0.4))
        x, y = random.uniform(-5.0, 5.0, 2).tolist()
        time = f"2026-11-27T10:{k:02d}:00.250"
        numbers = ";".join(comma(v) for v in (newton / GF, 0.3 * newton ** (2 / 3), x, y))
        rows.append(f"{k};{time};p{k:02d}.png;{TOOLS[k % 3]};{numbers}")
    (folder / "messung.csv").write_bytes(b"\xef\xbb\xbf" + "\r\n".join(rows).encode())
    return force


def test_a_spreadsheet_of_a_lab(tmp_path: Path) -> None:
    """Columns, units, times, tools, images and sensor are found; forces come out."""
    force = lab(tmp_path / "lab", np.random.default_rng(5), 4)
    path, guesses = write_guess(tmp_path / "lab")
    spec = tomllib.loads(path.read_text())
    data, columns = spec["data"], spec["data"]["columns"]
    assert (data["separator"], data["decimal"], data["images"]) == (";", ",", "bilder")
    assert data["no_contact"] == "bilder/leer_digit.png"
    assert (columns["time"]["unit"], columns["force"]["unit"]) == ("iso", "gf")
    assert data["indenters"][TOOLS[0]] == "sphere:diameter=6mm"
    assert data["indenters"][TOOLS[2]] == "cylinder:diameter=5mm"
    assert spec["rig"]["sensor"]["name"] == "digit"
    assert any("indenters" in each or "Kugel" in each for each in guesses.asked)
    store = import_run(tmp_path / "lab", parent=tmp_path)
    assert [r.force_measured_n for r in counting(store)] == pytest.approx(force, abs=1e-5)
    assert len({trial.place_m for trial in store.imported_trials.values()}) == len(force)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("zero_gf", [-115.0, 115.0])
def test_a_sign_is_of_forces_over_those_at_rest(tmp_path: Path, sign: int, zero_gf: float) -> None:
    """A cell's zero may be larger than the forces; a sign that no file states is asked for."""
    force = lab(tmp_path / "lab", np.random.default_rng(7), 4)
    table = tmp_path / "lab" / "messung.csv"
    head, *rows = table.read_text("utf-8-sig").splitlines()
    shown = [head.replace("Nr;", "Nr;Zustand;")]
    for row, newton in zip(rows, force.tolist(), strict=True):
        cells = row.split(";")
        for state, shot, felt in (("ruhe", "leer_digit.png", 0.0), ("last", cells[2], newton)):
            number = comma(zero_gf + sign * felt / GF)
            shown.append(";".join([cells[0], state, cells[1], shot, cells[3], number, *cells[5:]]))
    table.write_text("\n".join(shown), "utf-8")
    write_guess(tmp_path / "lab")
    stated = [f"rig.force_sensor.compression_sign={sign}"]
    if sign < 0:
        with pytest.raises(RecordError, match="all 4 forces are negative") as refused:
            import_run(tmp_path / "lab", parent=tmp_path)
        assert stated[0].replace("=", " = ") in refused.value.remedy
    store = import_run(tmp_path / "lab", parent=tmp_path, overrides=stated)
    assert [r.force_measured_n for r in counting(store)] == pytest.approx(force, abs=1e-5)


def test_what_is_there_is_not_written_over(tmp_path: Path) -> None:
    """Whoever wrote it."""
    lab(tmp_path / "lab", np.random.default_rng(6), 1)
    write_guess(tmp_path / "lab")
    with pytest.raises(RecordError, match="is there already"):
        write_guess(tmp_path / "lab")
