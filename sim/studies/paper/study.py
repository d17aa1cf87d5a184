"""The study of the paper: its model pressed here, and every number of it beside ours."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from sim.scene.material import LawName
from sim.scene.scene import Preset
from sim.sensor.sensor import load_sensor
from sim.studies.modes.runs import BALL, PUNCH, press_in, slide_mode, twist_mode
from sim.studies.paper.claims import RULES, Verdict, checks, claims, verdict
from sim.studies.paper.comparison import (
    Comparison,
    Ours,
    compared,
    draw_paper,
    mesh_ours,
    mode_ours,
    model_ours,
    score_ours,
    speed_ours,
)
from sim.studies.paper.kept import KeptReport, read_kept, read_speeds
from sim.studies.paper.mesh import mesh_numbers, preset_statistics, read_trials
from sim.studies.paper.presses import (
    ACCURATE,
    AS_CONFIGURED,
    DEPTH_M,
    FORCES_N,
    THIN,
    ModelPresses,
    pressed,
    rest_stress_pa,
    scenes,
)
from tacauchy_rig.core.page import page
from tacauchy_rig.core.study import About, Case, Result, Study, failures_table
from tacauchy_rig.core.tables import Table, table_of
from tacauchy_rig.core.versions import machine, versions

SEARCH_FILE = "paper_mesh_search.json"
_MESH, _LAW, _MODES = "its mesh's table", "its law at rest", "contact modes"
_SENSORS = ("gelsight-mini", "digit", "9dtact")
# Trials of the search on the page, the nearest.
_NEAREST = 4
_SCORES = {
    "ssim": "SSIM",
    "ncc": "NCC",
    "histogram_correlation": "histogram correlation",
    "psnr_db": "PSNR",
}
_model: Callable[[Any], ModelPresses] = TypeAdapter(ModelPresses).validate_python


class Paper(Study):
    """Its models pressed, beside benchmarks and reports that are kept.

    Args:
        benchmarks: Folder of what is kept.

    Raises:
        RecordError: There is no benchmark of a GPU.
    """

    name, title, kind = "paper", "The paper, claim by claim", "measurement"

    def __init__(self, benchmarks: Path) -> None:
        self._speeds, self._reports = read_speeds(benchmarks), read_kept(benchmarks)
        self._trials = read_trials(benchmarks / SEARCH_FILE)

    def cases(self) -> Sequence[Case]:
        """Return the models, and what else is measured here."""
        models = [Case(name=name, measure=partial(_pressed, name)) for name in scenes()]
        others = {_MESH: _meshes, _LAW: _rest_stress, _MODES: _modes}
        return models + [Case(name=name, measure=measure) for name, measure in others.items()]

    def comparison(self, results: Sequence[Result]) -> Comparison:
        """Return every claim beside what was measured or is kept."""
        found = {each.name: each.found for each in results if not each.failure}
        ours: dict[str, Ours] = speed_ours(self._speeds) | score_ours(self._reports)
        if _MESH in found:
            ours |= mesh_ours(found[_MESH]["numbers"])
        if _MODES in found:
            ours |= mode_ours(found[_MODES])
        if {*scenes(), _LAW} <= found.keys():
            models = self.models(results)
            reference = models.pop(ACCURATE)
            ours |= model_ours(models, reference, rest_stress_pa=found[_LAW])
        return compared(ours)

    def models(self, results: Sequence[Result]) -> dict[str, ModelPresses]:
        """Return the models that were pressed, by name."""
        names = set(scenes())
        return {r.name: _model(r.found) for r in results if r.name in names and not r.failure}

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return the claims with their verdicts."""
        found = self.comparison(results)
        counts = ", ".join(f"{count} {each}" for each, count in found.counts.items())
        table = table_of(
            found.rows,
            {
                "what": lambda row: row.claim.says,
                "where": lambda row: row.claim.where,
                "paper": lambda row: row.claim.value,
                "ours": lambda row: None if row.ours is None else row.ours.value,
                "unit": lambda row: row.claim.unit,
                "verdict": lambda row: row.verdict.value,
            },
            title=self.title,
            criterion="none: a verdict is no criterion of ours",
            note=counts,
        )
        return [table, *failures_table(results, kind=self.kind)]

    def facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the claims with ours and the verdicts, and the models' presses."""
        rows = [
            {"claim": row.claim, "ours": row.ours, "verdict": row.verdict}
            for row in self.comparison(results).rows
        ]
        models = self.models(results)
        models.pop(ACCURATE, None)
        return {"claims": rows, "presses": list(models.values())}

    def draw(self, results: Sequence[Result], folder: Path, page_folder: Path) -> list[Path]:
        """Draw the models at the six forces, and what no contact scores."""
        models = self.models(results)
        models.pop(ACCURATE, None)
        return draw_paper(models, self._reports, folder, page_folder=page_folder)

    def page(self, results: Sequence[Result], about: About, images: Sequence[str]) -> str:
        """Return the page; until all is measured, the claims alone."""
        models, found = self.models(results), {r.name: r.found for r in results if not r.failure}
        if len(found) < len(self.cases()):
            return super().page(results, about, images)
        reference = models.pop(ACCURATE)
        shares = [trial.share for trial in self._trials]
        facts = {
            "c": self.comparison(results),
            "claims": claims(),
            "rules": RULES,
            "command": about.command,
            "machine": machine(),
            "versions": versions(),
            "speeds": self._speeds,
            "reports": self._reports,
            "beaten": beaten(self._reports),
            "friction": scenes()[THIN].friction,
            "tet_count": found[_MESH]["tet_count"],
            "depth_mm": DEPTH_M * 1e3,
            "reference_n": reference.at_depth.force_n,
            "presses": [*models.values(), reference],
            "forces": FORCES_N,
            "thin_sigma": models[THIN].at_depth.sigma_off,
            "wide_gap_mm": models[AS_CONFIGURED].at_depth.gap_m * 1e3,
            "trial_count": len(self._trials),
            "nearest": self._trials[:_NEAREST],
            "share_low": min(shares, default=0.0),
            "share_high": max(shares, default=0.0),
            "none_meets": not any(
                all(
                    verdict(claims()[name].rule, claims()[name].value, value) is Verdict.REPRODUCED
                    for name, value in trial.found.items()
                )
                for trial in self._trials
            ),
            "checks": checks(),
        }
        return page("sim.studies.paper", "page.md.jinja", facts)


def _pressed(name: str) -> dict[str, Any]:
    forces = () if name == ACCURATE else FORCES_N
    return asdict(pressed(name, scenes()[name], forces_n=forces))


def _meshes() -> dict[str, Any]:
    coarse, fine = preset_statistics(scenes()[ACCURATE])
    return {"numbers": mesh_numbers(coarse, fine), "tet_count": fine.tet_count}


def _rest_stress() -> float:
    return rest_stress_pa(LawName.PAPER_EQ4)


def _modes() -> dict[str, list[bool]]:
    """Return which criteria each contact mode meets."""
    punched = press_in(load_sensor("gelsight-mini"), PUNCH, preset=Preset.FAST)
    balls = [press_in(load_sensor(name), BALL, preset=Preset.FAST) for name in _SENSORS]
    runs = {
        "press": [punched],
        "slide": [slide_mode(punched)],
        "twist": [twist_mode(punched)],
        "sensors": balls,
    }
    return {
        name: [criterion.passed for run in each for criterion in run.criteria]
        for name, each in runs.items()
    }


def beaten(reports: Sequence[KeptReport]) -> list[tuple[KeptReport, list[str]]]:
    """Return real sensors with the paper's scores that no contact reaches there."""
    found = []
    for report in reports:
        reached = [
            label
            for score, label in _SCORES.items()
            if report.no_contact[score] >= claims()[f"scores.{score}"].value
        ]
        if reached and not report.emulated:
            found.append((report, reached))
    return found
