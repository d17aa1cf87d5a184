"""``tacauchy-rig paper``: each number of the paper beside ours, with verdicts, as a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tacauchy_rig.app.cli.options import FigureFolder, FigurePage, JsonFile
from tacauchy_rig.app.cli.output import complain, say, writable_folder, write_json, write_text

if TYPE_CHECKING:
    from sim.studies.paper.as_configured import ModelPresses
    from sim.studies.paper.benchmarks import Speeds
    from sim.studies.paper.comparison import Comparison
    from sim.studies.paper.kept_reports import KeptReport
    from sim.studies.paper.mesh_search import Trial

_BENCHMARKS = Path("docs/results/benchmarks")
_SEARCH = "paper_mesh_search.json"
# Trials of the search on the page, the nearest.
_NEAREST = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """All that the page is made of.

    Attributes:
        presses: By model, in the order of the tables.
        reference: Whose force the others are compared with.
        trials: Of the mesh search, the nearest first.
    """

    comparison: Comparison
    presses: Mapping[str, ModelPresses]
    reference: ModelPresses
    tet_count: int
    speeds: Speeds
    reports: Sequence[KeptReport]
    trials: Sequence[Trial]


def paper(
    out: FigureFolder,
    benchmarks: Annotated[
        Path, typer.Option("--benchmarks", help="Folder of the benchmarks that are kept.")
    ] = _BENCHMARKS,
    report: Annotated[
        list[Path] | None,
        typer.Option(
            "--report",
            metavar="RUN",
            help="Keep this run's scores among the benchmarks, in place of those kept before; "
            "may be repeated.",
        ),
    ] = None,
    search: Annotated[
        bool, typer.Option("--search", help="Search the paper's mesh anew first: five minutes.")
    ] = False,
    page: FigurePage = None,
    json_file: JsonFile = None,
) -> None:
    """Set every number of the paper beside ours: its model pressed here, benchmarks, reports.

    Example: tacauchy-rig study paper --out paper
    """
    from sim.studies.paper.figure import draw_paper

    writable_folder(out)
    images = None if page is None else writable_folder(page.parent / "images")
    if report:
        _keep_reports(report, benchmarks)
    if search:
        _search_mesh(benchmarks)
    found = _measured(benchmarks)
    for path in draw_paper(found.presses, found.reports, out, page_folder=images):
        say(f"figure {path}")
    say(", ".join(f"{count} {each}" for each, count in found.comparison.counts.items()))
    if page is not None:
        command = f"tacauchy-rig paper --out {out} --page {page}"
        write_text(page, paper_page(found, command=command))
        say(f"page {page}")
    rows = [
        {"claim": row.claim, "ours": row.ours, "verdict": row.verdict}
        for row in found.comparison.rows
    ]
    write_json(json_file, {"claims": rows, "presses": list(found.presses.values())})


def _keep_reports(runs: Sequence[Path], folder: Path) -> None:
    from sim.studies.paper.kept_reports import FILE, kept_text, of_run

    write_text(folder / FILE, kept_text([of_run(run) for run in runs]), option="--benchmarks")


def _search_mesh(folder: Path) -> None:
    from sim.studies.paper.mesh_search import searched, trials_text

    trials = []
    for trial in searched():
        trials.append(trial)
        say(f"  {trial.pad}, l_r {trial.share:g}: {trial.miss:.0%} off the paper's table")
    write_text(folder / _SEARCH, trials_text(trials), option="--benchmarks")


def _measured(folder: Path) -> Found:
    from sim.scene.material import LawName
    from sim.studies.paper.as_configured import ACCURATE, pressed, rest_stress_pa, scenes
    from sim.studies.paper.benchmarks import read_speeds
    from sim.studies.paper.comparison import (
        compared,
        mesh_ours,
        mode_ours,
        model_ours,
        score_ours,
        speed_ours,
    )
    from sim.studies.paper.kept_reports import read_kept
    from sim.studies.paper.mesh_search import read_trials
    from sim.studies.paper.mesh_table import mesh_numbers, preset_statistics

    speeds, reports = read_speeds(folder), read_kept(folder)
    presses = {}
    for name, scene in scenes().items():
        complain(f"  {name}")
        presses[name] = (
            pressed(name, scene, forces_n=()) if name == ACCURATE else pressed(name, scene)
        )
    reference = presses.pop(ACCURATE)
    coarse, fine = preset_statistics(scenes()[ACCURATE])
    measured = {
        **mesh_ours(mesh_numbers(coarse, fine)),
        **model_ours(presses, reference, rest_stress_pa=rest_stress_pa(LawName.PAPER_EQ4)),
        **speed_ours(speeds),
        **score_ours(reports),
        **mode_ours(_modes()),
    }
    return Found(
        comparison=compared(measured),
        presses=presses,
        reference=reference,
        tet_count=fine.tet_count,
        speeds=speeds,
        reports=reports,
        trials=read_trials(folder / _SEARCH),
    )


def _modes() -> dict[str, list[bool]]:
    from sim.scene.scene import Preset
    from sim.sensor.sensor import load_sensor
    from sim.studies.modes.runs import BALL, PUNCH, press_in, slide_mode, twist_mode

    complain("  contact modes")
    pressed = press_in(load_sensor("gelsight-mini"), PUNCH, preset=Preset.FAST)
    runs = {"press": [pressed], "slide": [slide_mode(pressed)], "twist": [twist_mode(pressed)]}
    runs["sensors"] = [
        press_in(load_sensor(name), BALL, preset=Preset.FAST)
        for name in ("gelsight-mini", "digit", "9dtact")
    ]
    return {
        name: [criterion.passed for run in each for criterion in run.criteria]
        for name, each in runs.items()
    }


def paper_page(found: Found, *, command: str) -> str:
    """Return what was found as a page of Markdown."""
    from sim.studies.paper.as_configured import AS_CONFIGURED, DEPTH_M, FORCES_N, THIN, scenes
    from sim.studies.paper.claims import claims
    from sim.studies.paper.consistency import checks
    from sim.studies.paper.verdict import RULES, Verdict, verdict
    from tacauchy_rig.core.page import page as written
    from tacauchy_rig.core.versions import machine, versions

    return written(
        "tacauchy_rig.app.cli.studies",
        "paper.md.jinja",
        {
            "c": found.comparison,
            "claims": claims(),
            "rules": RULES,
            "command": command,
            "machine": machine(),
            "versions": versions(),
            "speeds": found.speeds,
            "reports": found.reports,
            "beaten": _beaten(found.reports),
            "friction": scenes()[THIN].friction,
            "tet_count": found.tet_count,
            "depth_mm": DEPTH_M * 1e3,
            "reference_n": found.reference.at_depth.force_n,
            "presses": [*found.presses.values(), found.reference],
            "forces": FORCES_N,
            "thin_sigma": found.presses[THIN].at_depth.sigma_off,
            "wide_gap_mm": found.presses[AS_CONFIGURED].at_depth.gap_m * 1e3,
            "trial_count": len(found.trials),
            "nearest": found.trials[:_NEAREST],
            "share_low": min((trial.share for trial in found.trials), default=0.0),
            "share_high": max((trial.share for trial in found.trials), default=0.0),
            "none_meets": not any(
                all(
                    verdict(claims()[name].rule, claims()[name].value, value) is Verdict.REPRODUCED
                    for name, value in trial.found.items()
                )
                for trial in found.trials
            ),
            "checks": checks(),
        },
    )


def _beaten(reports: Sequence[KeptReport]) -> list[tuple[KeptReport, list[str]]]:
    """Return real sensors with the paper's scores that no contact reaches there."""
    from sim.studies.paper.claims import claims

    labels = {
        "ssim": "SSIM",
        "ncc": "NCC",
        "histogram_correlation": "histogram correlation",
        "psnr_db": "PSNR",
    }
    found = []
    for report in reports:
        reached = [
            label
            for score, label in labels.items()
            if report.no_contact[score] >= claims()[f"scores.{score}"].value
        ]
        if reached and not report.emulated:
            found.append((report, reached))
    return found
