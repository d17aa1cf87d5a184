"""The files of a report: readable by strict readers, whole in one page, and marked."""

import csv
import json
import re
import struct
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from matplotlib.figure import Figure

from reports.comparison.result_types import ValidationReport
from reports.evidence.evidence_types import camera_of
from reports.page.report_html import criterion_groups, number, plain, signed, words
from reports.page.summary_and_junit import (
    ReportPaths,
    build_summary,
    junit_xml,
    metrics_csv,
    write_report,
)
from tacauchy_rig.core.errors import RecordError

METRICS = {"ssim", "ncc", "histogram_correlation", "psnr_db", "mse"}


@pytest.fixture(scope="module")
def incomplete_written(
    incomplete: ValidationReport, tmp_path_factory: pytest.TempPathFactory
) -> ReportPaths:
    """The incomplete run's report on disk; its figures are drawn, but not encoded."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Figure, "savefig", lambda _, path, **__: path.write_bytes(b""))
        return write_report(incomplete, tmp_path_factory.mktemp("incomplete"))


def read_strictly(path: Path) -> dict[str, Any]:
    """Read JSON and refuse NaN and infinity, as other readers do."""

    def refuse(name: str) -> None:
        raise ValueError(f"{name} in {path.name}")

    content: dict[str, Any] = json.loads(path.read_text("utf-8"), parse_constant=refuse)
    return content


def test_summary_has_the_agreed_keys(written: ReportPaths) -> None:
    """Keys that other programs rely on are there, and the numbers are finite."""
    summary = read_strictly(written.summary)
    assert summary["simulated"] is True
    assert summary["passed"] is True
    assert set(summary["provenance"]) >= {"versions", "config_hash", "seed"}
    assert len(summary["trials"]) == 6
    for trial in summary["trials"]:
        assert set(trial) >= {
            "force_target_n",
            "force_measured_n",
            "force_simulated_n",
            "depth_simulated_m",
            "passed",
        }
        assert set(trial["metrics"]) == METRICS
        assert set(trial["floors"]["no_contact"]) == METRICS
        assert set(trial["floors"]["wrong_force"]) == METRICS
        assert abs(trial["force_simulated_n"] - trial["force_measured_n"]) <= 0.08


def test_the_page_says_what_the_accuracy_cost(written: ReportPaths) -> None:
    """The replay's own settings and its neighbours stand in one table, the unknown as a dash."""
    page = written.html.read_text("utf-8")
    table = page[page.index("Cost of this accuracy, chosen to meet 2% of F_z") :]
    table = table[: table.index("</table>")]
    assert re.search(r"this replay</td>.*balanced</td><td>1\.23</td><td>1\.00</td>", table)
    assert re.search(r"next cheaper</td>.*fast</td><td>3\.21</td><td>0\.25</td>", table)
    assert re.search(r"next better</td>.*accurate</td><td>–</td><td>2\.50</td>", table)
    assert "alternatives" not in page.replace(table, "")


def test_the_page_says_what_the_residual_is_made_of(written: ReportPaths) -> None:
    """In a table, in words and in the summary: what pays most, and what is left."""
    summary, page = read_strictly(written.summary), written.html.read_text("utf-8")
    assert summary["model"]["residual"]["shares"]["pose"] == 0.3
    table = page[page.index("Causes of the residual") :]
    assert re.search(r"Optics</th>.*<td>−6\.0</td>", table)
    assert "tilt towards x +0.57 deg" in table
    assert any("cause is pose with 30 %" in s and "to 16.7 %" in s for s in summary["reading"])


def test_the_page_shows_no_code(written: ReportPaths) -> None:
    """Neither JSON nor powers of ten of what is nothing in newtons."""
    text = re.sub(r"<style>.*?</style>|<[^>]+>", " ", written.html.read_text("utf-8"), flags=re.S)
    assert not re.search(r'\[\]|\{"|\[\[|null|e−\d+ N', text)


def test_incomplete_run_is_written_without_nan(incomplete_written: ReportPaths) -> None:
    """Numbers that do not exist are null, in the trials that lack them only."""
    trials = read_strictly(incomplete_written.summary)["trials"]
    assert trials[3]["metrics"] == dict.fromkeys(METRICS)
    assert trials[3]["floors"]["wrong_force"] == {}
    assert trials[0]["metrics"]["ssim"] > 0.9
    page = incomplete_written.html.read_text("utf-8")
    assert "Missed criteria and remedies" in page
    assert "tacauchy-rig resume RUN" in page
    assert "Trial 4 was not pressed" in page
    assert "camera &lt;went&gt; away" in page
    assert "SIMULATED" not in page


class LinkFinder(HTMLParser):
    """Collects every address that a page would load or lead to."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.tags: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note addresses."""
        self.tags.add(tag)
        self.found += [v or "" for k, v in attrs if k in ("src", "href", "data", "action")]


def test_page_is_one_file_without_network(written: ReportPaths) -> None:
    """Every address is a data URL, nothing runs, and nothing is imported by the style."""
    page = written.html.read_text("utf-8")
    finder = LinkFinder()
    finder.feed(page)
    assert finder.found
    inside = [address for address in finder.found if address.startswith("#")]
    assert all(f'id="{address[1:]}"' in page for address in inside)
    assert len(inside) > 4
    others = set(finder.found) - set(inside)
    assert all(address.startswith("data:image/png;base64,") for address in others)
    assert not finder.tags & {"script", "link", "iframe", "object"}
    assert "://" not in re.sub(r"data:image/png;base64,[A-Za-z0-9+/=]+", "", page)
    assert "@import" not in page
    assert "url(" not in page


def test_page_says_verdict_first_and_marks_the_dry_run(written: ReportPaths) -> None:
    """Mark, verdict and its criteria come before SSIM, which is none; the mark repeats in print."""
    page = written.html.read_text("utf-8")
    body = page[page.index("<body>") :]
    said = (">SIMULATED", ">PASSED<", "In all 6 presses", "In 6 presses", "not depend on SSIM")
    places = [body.index(mark) for mark in (*said, '<table class="stack', "<nav", "<img")]
    assert places == sorted(places)
    assert "Passed: in all 6" not in body
    assert page.count("SIMULATED: emulated devices") == 2
    assert page.count('<img src="data:image/png') == 18 + 4


def test_what_was_emulated_is_not_called_real(
    written: ReportPaths, incomplete_written: ReportPaths
) -> None:
    """Pages and captions say whose the images are; only a caveat may name real sensors."""
    emulated = written.html.read_text("utf-8")
    caveat = "not that the simulator matches any real sensor"
    assert "<th>Emulated</th>" in emulated
    assert caveat in emulated
    assert not re.search(r"\breal\b", emulated.replace(caveat, ""), flags=re.IGNORECASE)
    page = incomplete_written.html.read_text("utf-8")
    assert "<th>Real</th>" in page
    assert "Emulated" not in page
    assert "Score of every real press" not in emulated


def test_images_are_the_cameras_whatever_the_arm_is() -> None:
    """A real camera beside an emulated arm gives real images."""
    devices = {"camera": {"simulated": False}, "robot": {"simulated": True}}
    assert camera_of({"devices": devices}, simulated=True) == "real"
    assert camera_of({"devices": {}}, simulated=True) == "emulated"


def test_figures_are_vector_pdf_with_embedded_fonts_and_png(written: ReportPaths) -> None:
    """Each figure is there twice; its PDF embeds TrueType fonts and no Type 3."""
    names = [f["name"] for f in read_strictly(written.summary)["figures"]]
    assert names == ["images", "scores", "wrong-force", "time", "force-depth"]
    for name in names:
        pdf = (written.figures / f"{name}.pdf").read_bytes()
        assert pdf.startswith(b"%PDF")
        assert b"/FontFile2" in pdf
        assert b"/Type3" not in pdf
        assert (written.figures / f"{name}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(("name", "width_in"), [("images", 7.16), ("force-depth", 3.5)])
def test_figures_have_ieee_widths(written: ReportPaths, name: str, width_in: float) -> None:
    """Double and single columns at 300 dpi."""
    header = (written.figures / f"{name}.png").read_bytes()[16:24]
    assert struct.unpack(">II", header)[0] == pytest.approx(300 * width_in, abs=1)


def test_junit_has_one_case_per_trial_and_criterion(
    written: ReportPaths, incomplete: ValidationReport
) -> None:
    """Counts agree with the cases, and a failure carries its remedy."""
    root = ET.fromstring(written.junit.read_text("utf-8"))  # noqa: S314 (our own file)
    assert len(root.findall(".//testcase")) == 6 * 6 == int(root.attrib["tests"])
    assert root.attrib["failures"] == "0"
    assert "SIMULATED" in root.attrib["name"]
    failed = ET.fromstring(junit_xml(build_summary(incomplete)))  # noqa: S314
    failures = failed.findall(".//failure")
    assert len(failures) == int(failed.attrib["failures"]) == 12
    assert all(f.text for f in failures)


def test_csv_has_one_line_per_trial(written: ReportPaths) -> None:
    """The table reads back with the numbers of the summary."""
    with written.metrics.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    trials = read_strictly(written.summary)["trials"]
    assert len(rows) == 6
    for row, trial in zip(rows, trials, strict=True):
        assert row["simulated"] == "True"
        assert float(row["metrics.ssim"]) == trial["metrics"]["ssim"]
        assert float(row["floors.no_contact.ncc"]) == trial["floors"]["no_contact"]["ncc"]


def test_csv_keeps_columns_that_only_some_trials_have() -> None:
    """A missing value is an empty field, never a shifted one."""
    trials = [{"a": None}, {"a": 1.0, "b": {"c": 2}}]
    text = metrics_csv({"simulated": False, "imported": True, "trials": trials})
    assert text == "simulated,imported,a,b.c\nFalse,True,,\nFalse,True,1.0,2\n"


def test_unwritable_folder_is_named(report: ValidationReport, tmp_path: Path) -> None:
    """A folder that cannot be made gives a message with a remedy."""
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(RecordError, match="cannot be written") as caught:
        write_report(report, tmp_path / "taken")
    assert "tacauchy-rig report" in caught.value.remedy


def test_numbers_are_written_for_people() -> None:
    """True minus, no negative zero, dashes for what is unknown, units out of keys."""
    assert number(-0.00001, 3) == "0.000"
    assert number(-1.5, 1) == "−1.5"
    assert signed(0.25, 2) == "+0.25"
    assert signed(None) == number(None) == plain(None) == "–"
    assert plain([]) == plain({}) == "none"
    assert plain({"ball_m": 0.5, "at": [1.0, -2.0]}) == "ball (m) 0.5; at 1, −2"
    assert words("scale_x_m_px") == "scale x (m/px)"
    assert words("force_rate_hz") == "force rate (Hz)"
    assert words("control_loop_ms_p99") == "control loop p99 (ms)"


def test_advice_is_given_once_for_all_presses_that_need_it() -> None:
    """Presses are in the order of their forces; what an import does not tell needs no advice."""

    def trial(index: int, force_n: float, measured: float | None) -> dict[str, Any]:
        criterion = {
            "name": "contact_residual",
            "passed": False,
            "measured": measured,
            "limit": f"trials/{index:02d}/attempt-1/x at most 0.25",
            "unit": "",
            "remedy": f"image {index} fits as well",
        }
        found = {"index": index, "force_target_n": force_n, "outcome": "imported"}
        return found | {"criteria": [criterion]}

    trials = [trial(1, 3.0, 0.3), trial(2, 1.0, 0.9), trial(3, 2.0, None)]
    (group,) = criterion_groups({"imported": True, "criteria": [], "trials": trials})
    assert [(a["text"], len(a["where"])) for a in group["advice"]] == [("image 2 fits as well", 2)]
    assert [where.split()[0] for where in group["advice"][0]["where"]] == ["1.00", "3.00"]
    assert (group["met"], group["known"], group["count"]) == (0, 2, 3)
    assert group["worst"]["measured"] == 0.9
    assert group["limit"] == "x at most 0.25"
