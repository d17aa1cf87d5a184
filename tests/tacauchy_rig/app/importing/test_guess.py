"""``--init`` describes a lab's folder so that it imports, and asks where it cannot know."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from tacauchy_rig.app.importing.guess import write_guess
from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.core.errors import RecordError
from tests.tacauchy_rig.app.importing.sources import counting
from tests.tacauchy_rig.app.importing.test_kinds import comma, image

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


def test_what_is_there_is_not_written_over(tmp_path: Path) -> None:
    """Whoever wrote it."""
    lab(tmp_path / "lab", np.random.default_rng(6), 1)
    write_guess(tmp_path / "lab")
    with pytest.raises(RecordError, match="is there already"):
        write_guess(tmp_path / "lab")
