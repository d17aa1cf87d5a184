"""The study of the paper: its model pressed here, and every number of it beside ours."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import InitVar, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sim.scene.material import LawName
from sim.scene.scene import Preset
from sim.sensor.sensor import load_sensor
from sim.studies.modes.runs import BALL, PUNCH, press_in, slide_mode, twist_mode
from sim.studies.paper.claims import RULES, Claim, Verdict, checks, claims, verdict
from sim.studies.paper.kept_results import ENVIRONMENTS, Report, Speeds, read_kept, read_speeds
from sim.studies.paper.presses import (
    ACCURATE,
    AS_CONFIGURED,
    BALANCED,
    DEPTH_M,
    FAST,
    FORCES_N,
    THIN,
    ModelPresses,
    every_press,
    mesh_numbers,
    pressed,
    rest_stress_pa,
    scenes,
)
from tacauchy_rig.core.markdown_page import page
from tacauchy_rig.core.plot_style import BLUE, GREEN, GREY, ORANGE, PAGE_IN, SKY, new_figure
from tacauchy_rig.core.study import About, Case, Result, Study, failures_table
from tacauchy_rig.core.tables import Table, table_of
from tacauchy_rig.core.versions import machine, versions

BENCHMARKS = "docs/results/benchmarks"


class Ours(NamedTuple):
    """A number of ours in the claim's unit, and what it was taken from."""

    value: float
    source: str


class Compared(NamedTuple):
    """A claim, ours beside it, and what follows."""

    claim: Claim
    ours: Ours | None
    verdict: Verdict


Comparison = dict[str, Compared]
"""The whole paper, by claim in their order."""


def compared(measured: Mapping[str, Ours]) -> Comparison:
    """Set measurements, by claim, beside the paper; what has none is not reproduced."""
    found = {}
    for name, claim in claims().items():
        ours = None if claim.out_of_scope else measured.get(name)
        judged = verdict(claim.rule, claim.value, None if ours is None else ours.value)
        found[name] = Compared(claim, ours, Verdict.OUT_OF_SCOPE if claim.out_of_scope else judged)
    return found


def section(rows: Comparison, name: str) -> list[Compared]:
    """Return the claims of one section of the file, such as ``mesh``."""
    return [row for row in rows.values() if row.claim.name.startswith(f"{name}.")]


def counts(rows: Comparison) -> dict[Verdict, int]:
    """Return how many claims ended in each verdict."""
    found = Counter(row.verdict for row in rows.values())
    return {each: found[each] for each in Verdict}


def worst(rows: Comparison, *sections: str) -> Verdict:
    """Return what is true of all claims of some sections at the least."""
    found = [row.verdict for name in sections for row in section(rows, name)]
    inside = [each for each in found if each is not Verdict.OUT_OF_SCOPE]
    return max(inside or found, key=list(Verdict).index)


def model_ours(
    presses: Mapping[str, ModelPresses], reference: ModelPresses, *, rest_stress_pa: float
) -> dict[str, Ours]:
    """Return what the model as configured gives, and our presets beside it."""
    paper = presses[AS_CONFIGURED]
    at_forces, exact = paper["at_forces"], float(reference["at_depth"]["force_n"])

    def off(model: str) -> float:
        return 100.0 * abs(float(presses[model]["at_depth"]["force_n"]) / exact - 1.0)

    def sigma(model: str) -> float:
        return 100.0 * max(each["sigma_off"] for each in every_press(presses[model]))

    found = {
        "force": off(AS_CONFIGURED),
        "force_ours": off(FAST),
        "sigma": sigma(AS_CONFIGURED),
        "sigma_thin": sigma(THIN),
        "sigma_ours": sigma(BALANCED),
        "gap": at_forces[-1]["gap_m"] * 1e3,
        "iterations": max(each["newton_iterations"] for each in every_press(paper)),
        "match": max(each["off_n"] for each in at_forces),
    }
    here = {f"model.{name}": Ours(value, "this command") for name, value in found.items()}
    return {"model.rest_stress": Ours(abs(rest_stress_pa) / 1e3, "law paper-eq4, here"), **here}


def speed_ours(speeds: Speeds) -> dict[str, Ours]:
    """Return the benchmark's slowest scene, alone and in 60 environments."""
    alone, many = speeds.slowest(1), speeds.slowest(ENVIRONMENTS)
    each = many.frames_per_s / ENVIRONMENTS
    source = f"{BENCHMARKS}/{many.file}, {many.scene}"
    return {
        "speed.single": Ours(alone.frames_per_s, f"{BENCHMARKS}/{alone.file}, {alone.scene}"),
        "speed.sixty": Ours(many.frames_per_s, source),
        "speed.sixty_each": Ours(each, source),
        "speed.physics": Ours(1e3 / each, source),
        "speed.stress": Ours(1e3 * speeds.slowest_stress_s(), f"{BENCHMARKS}, slowest scene"),
    }


def score_ours(reports: Sequence[Report]) -> dict[str, Ours]:
    """Return scores of simulated images against real ones; emulated devices are no reality."""
    real = [report for report in reports if report["ours"] and not report["emulated"]]
    if not real:
        return {}
    best = max(real, key=lambda report: len(report["trials"]))
    found = {f"scores.{score}": value for score, value in best["ours"].items() if score != "mse"}
    trials = sorted(best["trials"], key=lambda trial: float(trial["force_n"]))
    if trials:
        for score in ("ssim", "ncc", "psnr_db"):
            found[f"ends.{score}_first"] = trials[0][score]
            found[f"ends.{score}_last"] = trials[-1][score]
        found["ends.mse_least"] = min(trial["mse"] for trial in trials)
        found["ends.mse_most"] = max(trial["mse"] for trial in trials)
    return {name: Ours(value, f"{BENCHMARKS}, {best['name']}") for name, value in found.items()}


def mode_ours(passed: Mapping[str, Sequence[bool]]) -> dict[str, Ours]:
    """Return the share of criteria that a contact mode meets, by its name."""
    source = "this command, as `modes`"
    return {f"modes.{name}": Ours(sum(each) / len(each), source) for name, each in passed.items()}


_HEIGHT_IN = 2.6
_LOOKS = {
    AS_CONFIGURED: (ORANGE, "o-"),
    THIN: (SKY, "s-"),
    FAST: (GREEN, "^-"),
    BALANCED: (BLUE, "v-"),
}
# Everything that a full frame of a press scores lies above this.
_SSIM_FROM = 0.9


def paper_figure(presses: Mapping[str, ModelPresses], reports: Sequence[Report]) -> Figure:
    """Draw depth and sigma n at the six forces, and SSIM of the paper beside no contact at all."""
    figure = new_figure(PAGE_IN, _HEIGHT_IN, marks=())
    depth, sigma, scores = figure.subplots(1, 3, width_ratios=(1.2, 1.2, 1.0))
    for name, model in presses.items():
        colour, mark = _LOOKS[name]
        looks = {"color": colour, "markersize": 3, "label": name}
        depths = [each["depth_m"] * 1e3 for each in model["at_forces"]]
        missed = [100.0 * each["sigma_off"] for each in model["at_forces"]]
        depth.plot(FORCES_N, depths, mark, **looks)
        sigma.plot(FORCES_N, missed, mark, **looks)
    depth.set(xlabel="$F_z$ [N]", ylabel="depth below first touch [mm]")
    sigma.set(xlabel="$F_z$ [N]", ylabel=r"$\sigma n$ off the contact force [%]")
    for axes in (depth, sigma):
        axes.set_ylim(bottom=0.0)
    figure.legend(*depth.get_legend_handles_labels(), loc="outside lower left", ncols=2)
    _draw_scores(scores, reports)
    return figure


def _draw_scores(axes: Axes, reports: Sequence[Report]) -> None:
    paper = claims()["scores.ssim"].value
    bars = [("the paper's:\nGelSight Mini, real", paper, ORANGE)]
    for report in reports:
        who = f"{report['name']}, {'emulated' if report['emulated'] else 'real'}"
        bars.append((f"no contact:\n{who}", report["no_contact"]["ssim"], GREY))
        if report["ours"]:
            bars.append((f"ours:\n{who}", report["ours"]["ssim"], BLUE))
    names, values, colours = zip(*reversed(bars), strict=True)
    axes.barh(range(len(bars)), values, color=colours, height=0.6)
    axes.set_yticks(range(len(bars)), names, fontsize=5.5)
    axes.axvline(paper, color=ORANGE, linewidth=0.6)
    axes.set(xlim=(_SSIM_FROM, 1.0), xlabel="SSIM of the full frame")


_MESH, _LAW, _MODES = "its mesh's table", "its law at rest", "contact modes"
_SENSORS = ("gelsight-mini", "digit", "9dtact")
_SCORES = {
    "ssim": "SSIM",
    "ncc": "NCC",
    "histogram_correlation": "histogram correlation",
    "psnr_db": "PSNR",
}


@dataclass
class Paper(Study):
    """Its models pressed, beside benchmarks and reports that are kept in a folder."""

    benchmarks: InitVar[Path]
    speeds: Speeds = field(init=False)
    reports: list[Report] = field(init=False)

    name, title, kind = "paper", "The paper, claim by claim", "measurement"

    def __post_init__(self, benchmarks: Path) -> None:
        self.speeds, self.reports = read_speeds(benchmarks), read_kept(benchmarks)

    def cases(self) -> Sequence[Case]:
        """Return the models, and what else is measured here."""
        measures: dict[str, Callable[[], Any]] = {name: partial(pressed, name) for name in scenes()}
        measures[ACCURATE] = partial(pressed, ACCURATE, forces_n=())
        measures[_MESH] = mesh_numbers
        measures[_LAW] = partial(rest_stress_pa, LawName.PAPER_EQ4)
        measures[_MODES] = _modes
        return [Case(name=name, measure=measure) for name, measure in measures.items()]

    def comparison(self, results: Sequence[Result]) -> Comparison:
        """Return every claim beside what was measured or is kept."""
        found = {each.name: each.found for each in results if not each.failure}
        ours: dict[str, Ours] = speed_ours(self.speeds) | score_ours(self.reports)
        if _MESH in found:
            ours |= {name: Ours(value, "preset paper") for name, value in found[_MESH].items()}
        if _MODES in found:
            ours |= mode_ours(found[_MODES])
        if {*scenes(), _LAW} <= found.keys():
            models = self.models(results)
            ours |= model_ours(models, found[ACCURATE], rest_stress_pa=found[_LAW])
        return compared(ours)

    def models(self, results: Sequence[Result]) -> dict[str, ModelPresses]:
        """Return the models that were pressed, by name, but for the reference."""
        names = set(scenes()) - {ACCURATE}
        return {r.name: r.found for r in results if r.name in names and not r.failure}

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return the claims with their verdicts."""
        found = self.comparison(results)
        table = table_of(
            found.values(),
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
            note=", ".join(f"{count} {each}" for each, count in counts(found).items()),
        )
        return [table, *failures_table(results, kind=self.kind)]

    def facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the claims with ours and the verdicts, and the models' presses."""
        rows = [
            {"claim": row.claim, "ours": row.ours and row.ours._asdict(), "verdict": row.verdict}
            for row in self.comparison(results).values()
        ]
        return {"claims": rows, "presses": list(self.models(results).values())}

    def figures(self, results: Sequence[Result]) -> Mapping[str, Figure]:
        """Draw the models at the six forces, and what no contact scores."""
        return {"paper": paper_figure(self.models(results), self.reports)}

    def page(self, results: Sequence[Result], about: About, images: Sequence[str]) -> str:
        """Return the page; until all is measured, the claims alone."""
        models, found = self.models(results), {r.name: r.found for r in results if not r.failure}
        if len(found) < len(self.cases()):
            return super().page(results, about, images)
        reference, rows = found[ACCURATE], self.comparison(results)
        facts = {
            "c": rows,
            "counts": counts(rows),
            "section": partial(section, rows),
            "worst": partial(worst, rows),
            "claims": claims(),
            "rules": RULES,
            "command": about.command,
            "machine": machine(),
            "versions": versions(),
            "speeds": self.speeds,
            "reports": self.reports,
            "beaten": beaten(self.reports),
            "friction": scenes()[THIN].friction,
            "tet_count": found[_MESH]["mesh.tets"],
            "depth_mm": DEPTH_M * 1e3,
            "reference_n": reference["at_depth"]["force_n"],
            "presses": [*models.values(), reference],
            "forces": FORCES_N,
            "thin": models[THIN]["at_depth"],
            "wide": models[AS_CONFIGURED]["at_depth"],
            "checks": checks(),
        }
        return page("sim.studies.paper", "page.md.jinja", facts)


def _modes() -> dict[str, list[bool]]:
    """Return which criteria each contact mode meets."""
    punched = press_in(load_sensor("gelsight-mini"), PUNCH, preset=Preset.FAST)
    balls = [press_in(load_sensor(name), BALL, preset=Preset.FAST) for name in _SENSORS]
    slid, turned = slide_mode(punched), twist_mode(punched)
    runs = {"press": [punched], "slide": [slid], "twist": [turned], "sensors": balls}
    return {
        name: [criterion.passed for run in each for criterion in run.criteria]
        for name, each in runs.items()
    }


def beaten(reports: Sequence[Report]) -> list[tuple[Report, list[str]]]:
    """Return real sensors with the paper's scores that no contact reaches there."""

    def reached(report: Report, score: str) -> bool:
        return bool(report["no_contact"][score] >= claims()[f"scores.{score}"].value)

    real = [report for report in reports if not report["emulated"]]
    found = [(r, [label for score, label in _SCORES.items() if reached(r, score)]) for r in real]
    return [(report, labels) for report, labels in found if labels]
