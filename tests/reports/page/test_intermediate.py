"""The part of the page in which the force rises: in a browser, without one, and on paper."""

import base64
import json
import re
import shutil
from dataclasses import replace
from hashlib import sha256
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from reports.comparison.result_types import ValidationReport
from reports.evidence.evidence_types import IntermediateFrame, IntermediateState, TrialEvidence
from reports.page import summary_and_junit as report_files
from reports.page.report_html import MOST_PRESSES
from reports.page.summary_and_junit import ReportPaths

STATES, HEIGHT, WIDTH = 8, 120, 160
MANY = MOST_PRESSES + 2  # presses, of which not all have a slider
GROWTH_MOST = 5_000_000  # bytes: twelve presses whose images are nothing but noise
A4_INSIDE_PX = (703, 1016)
"""Width and height that the margins leave of a sheet, and the mark of the latter, at 96 px/in."""


def intermediate(trial: TrialEvidence, rng: np.random.Generator) -> tuple[IntermediateState, ...]:
    """Return made-up states; the first has no frame at this force it."""
    states = []
    for k in range(1, STATES + 1):
        force_n = k / STATES * (trial.force_target_n + 0.01)
        real = rng.integers(0, 255, size=(240, 320, 3), dtype=np.uint8)
        frame = IntermediateFrame(image=real, force_n=force_n + 0.004, depth_m=k * 2e-5)
        states.append(
            IntermediateState(
                force_n=force_n,
                depth_m=k * 3e-5,
                image=rng.integers(0, 255, size=(HEIGHT, WIDTH, 3), dtype=np.uint8),
                dent_m=rng.uniform(0.0, k * 3e-5, size=(HEIGHT, WIDTH)),
                pressure_pa=rng.uniform(0.0, k * 2e4, size=(HEIGHT, WIDTH)),
                frame=None if k == 1 else frame,
            )
        )
    return tuple(states)


def with_intermediate(report: ValidationReport, *, count: int) -> ValidationReport:
    """Return a report of so many presses with states: the run's own, over and over."""
    rng = np.random.default_rng(8)
    recorded, judged = report.evidence.trials, report.trials
    places = [(k + 1, k % len(judged)) for k in range(count)]
    trials = tuple(
        replace(recorded[at], index=index, intermediate=intermediate(recorded[at], rng))
        for index, at in places
    )
    return replace(
        report,
        evidence=replace(report.evidence, trials=trials),
        trials=tuple(replace(judged[at], index=index) for index, at in places),
    )


def write_beside(written: ReportPaths, report: ValidationReport, folder: Path) -> ReportPaths:
    """Write a report with the figures of one that is written, which take most of the time."""
    figures = json.loads(written.summary.read_text("utf-8"))["figures"]

    def copied(_report: object, into: Path, *_: object) -> Any:
        shutil.copytree(written.figures, into)
        return figures

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(report_files, "draw_figures", copied)
        return report_files.write_report(report, folder)


@pytest.fixture(scope="module")
def risen(
    report: ValidationReport, written: ReportPaths, tmp_path_factory: pytest.TempPathFactory
) -> ReportPaths:
    """Three presses and their states on disk."""
    return write_beside(
        written, with_intermediate(report, count=3), tmp_path_factory.mktemp("risen")
    )


@pytest.fixture(scope="module")
def many(
    report: ValidationReport, written: ReportPaths, tmp_path_factory: pytest.TempPathFactory
) -> ReportPaths:
    """More presses than have a slider."""
    return write_beside(
        written, with_intermediate(report, count=MANY), tmp_path_factory.mktemp("many")
    )


def seen(page: Any, trial: int) -> dict[str, Any]:
    """Return what is in sight of a press: its pictures, and what is told of them."""
    found: dict[str, Any] = page.evaluate(
        """(trial) => {
          const press = document.getElementById(`intermediate-${trial}`);
          const shown = [...press.querySelectorAll("img")].filter((each) => each.offsetWidth > 0);
          return {
            pictures: shown.map((each) => each.src),
            captions: [...press.querySelectorAll("figcaption")]
              .filter((each) => each.offsetWidth > 0).map((each) => each.innerText),
            told: press.querySelector("output").innerText,
          };
        }""",
        trial,
    )
    return found


@pytest.mark.slow
def test_the_slider_moves_pictures_and_numbers(risen: ReportPaths, chromium: Any) -> None:
    """By the keyboard alone, from a file, and of its own press only."""
    page = chromium.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda message: errors.append(message.text))
    page.goto(risen.html.as_uri())
    last, other = seen(page, 2), seen(page, 3)
    assert len(last["pictures"]) == 4
    assert last["told"] == "1.961 N at 0.240 mm"
    assert "Emulated 1.965 N, arm depth 0.160 mm" in last["captions"]
    page.locator("#intermediate-2 input").focus()
    page.keyboard.press("ArrowLeft")
    before = seen(page, 2)
    assert before["told"] == "1.716 N at 0.210 mm"
    assert "Emulated 1.720 N, arm depth 0.140 mm" in before["captions"]
    assert not set(before["pictures"]) & set(last["pictures"])
    page.keyboard.press("Home")
    first = seen(page, 2)
    assert first["told"] == "0.245 N at 0.030 mm"
    assert len(first["pictures"]) == 3
    assert page.inner_text("#intermediate-2 .now .none") == "no frame at this force"
    page.keyboard.press("End")
    assert seen(page, 2) == last
    assert seen(page, 3) == other
    assert errors == []
    page.close()


def test_the_end_is_there_without_javascript(risen: ReportPaths, chromium: Any) -> None:
    """The press's own force, no control that would do nothing."""
    context = chromium.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(risen.html.as_uri())
    assert page.locator("#intermediate-2 .state").count() == STATES
    assert page.locator("#intermediate-2 .state:visible").count() == 1
    assert "Simulated 1.961 N at 0.240 mm" in page.inner_text("#intermediate-2 .state.now")
    assert not page.is_visible("#intermediate-2 input")
    context.close()


def test_the_page_stays_one_file_that_runs_nothing_else(risen: ReportPaths) -> None:
    """No address but of pictures; only the script whose hash the page states may run."""
    page = risen.html.read_text("utf-8")
    assert all(
        address.startswith(("data:image/png;base64,", "data:image/jpeg;base64,", "#"))
        for address in re.findall(r'\b(?:src|href)="([^"]*)"', page)
    )
    (script,) = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    assert page.count("<script") == 1
    digest = base64.b64encode(sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in unescape(page[: page.index("<title>")])
    assert "default-src 'none'" in page
    assert not re.search(r" on[a-z]+=", page)


def test_the_file_stays_small(risen: ReportPaths, many: ReportPaths, written: ReportPaths) -> None:
    """Twelve presses have a slider, however many there are, even if all images are noise."""
    page = many.html.read_text("utf-8")
    assert page.count('<section class="intermediate"') == MOST_PRESSES
    assert f"{MOST_PRESSES} of {MANY} presses" in page
    pictures = re.findall(r"data:image/jpeg;base64,[^\"]*", page)
    assert sum(map(len, pictures)) < GROWTH_MOST
    assert risen.html.stat().st_size - written.html.stat().st_size < GROWTH_MOST / 4


def test_a_replay_from_before_is_told_what_to_do(written: ReportPaths) -> None:
    """No slider, and the command that makes one."""
    page = written.html.read_text("utf-8")
    assert "tacauchy-rig replay RUN" in page[page.index("As the force rises") :]
    assert 'class="intermediate"' not in page


def test_paper_cuts_nothing(many: ReportPaths, chromium: Any, tmp_path: Path) -> None:
    """At most ten sheets, the states of the largest force on them; nothing wider or cut."""
    page = chromium.new_page(viewport={"width": A4_INSIDE_PX[0], "height": A4_INSIDE_PX[1]})
    page.goto(many.html.as_uri())
    page.emulate_media(media="print")
    assert page.locator("[data-printed] .state:visible").count() == STATES
    assert page.locator(".intermediate:visible").count() == 1
    assert not page.is_visible("[data-printed] input")
    assert page.evaluate("document.documentElement.scrollWidth") <= A4_INSIDE_PX[0]
    heights = page.evaluate(
        """() => [...document.querySelectorAll("main *")]
          .filter((each) => getComputedStyle(each).breakInside === "avoid")
          .map((each) => each.getBoundingClientRect().height)"""
    )
    assert len(heights) > 8
    assert max(heights) < A4_INSIDE_PX[1]
    headed = page.evaluate(
        """() => [...document.querySelectorAll("main table")].filter((each) => each.tHead
          && getComputedStyle(each.tHead).display !== "table-header-group").length"""
    )
    assert headed == 0
    pdf = page.pdf(path=tmp_path / "report.pdf", prefer_css_page_size=True)
    assert 4 <= len(re.findall(rb"/Type\s*/Page\b", pdf)) <= 10
    page.close()
