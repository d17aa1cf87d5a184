"""Ours beside the paper's: every claim with its measurement and its verdict, and the figure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes

from sim.studies.paper.claims import Claim, Verdict, claims, verdict
from sim.studies.paper.kept import ENVIRONMENTS, KeptReport, Speeds
from sim.studies.paper.presses import (
    AS_CONFIGURED,
    BALANCED,
    FAST,
    FORCES_N,
    THIN,
    ModelPresses,
)
from tacauchy_rig.core.figure_style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PAGE_IN,
    SKY,
    STYLE,
    new_figure,
    save_figure,
)

BENCHMARKS = "docs/results/benchmarks"


@dataclass(frozen=True, slots=True, kw_only=True)
class Ours:
    """A number of ours in the claim's unit, and what it was taken from."""

    value: float
    source: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """A claim, ours beside it, and what follows."""

    claim: Claim
    ours: Ours | None

    @property
    def verdict(self) -> Verdict:
        """What became of the claim."""
        if self.claim.out_of_scope:
            return Verdict.OUT_OF_SCOPE
        ours = None if self.ours is None else self.ours.value
        return verdict(self.claim.rule, self.claim.value, ours)


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """The whole paper.

    Attributes:
        rows: In the order of the claims.
    """

    rows: tuple[Compared, ...]
    by_name: dict[str, Compared] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "by_name", {row.claim.name: row for row in self.rows})

    def section(self, name: str) -> list[Compared]:
        """Return the claims of one section of the file, such as ``mesh``."""
        return [row for row in self.rows if row.claim.name.startswith(f"{name}.")]

    @property
    def counts(self) -> dict[Verdict, int]:
        """How many claims ended in each verdict."""
        found = Counter(row.verdict for row in self.rows)
        return {each: found[each] for each in Verdict}

    def worst(self, *sections: str) -> Verdict:
        """Return what is true of all claims of some sections at the least."""
        order = list(Verdict)
        found = [row.verdict for name in sections for row in self.section(name)]
        inside = [each for each in found if each is not Verdict.OUT_OF_SCOPE]
        return max(inside or found, key=order.index)


def compared(measured: Mapping[str, Ours]) -> Comparison:
    """Set measurements, by claim, beside the paper; what has none is not reproduced."""
    return Comparison(
        rows=tuple(
            Compared(claim=claim, ours=None if claim.out_of_scope else measured.get(name))
            for name, claim in claims().items()
        )
    )


def mesh_ours(numbers: Mapping[str, float]) -> dict[str, Ours]:
    """Return the mesh table of preset paper."""
    return {name: Ours(value=value, source="preset paper") for name, value in numbers.items()}


def model_ours(
    presses: Mapping[str, ModelPresses], reference: ModelPresses, *, rest_stress_pa: float
) -> dict[str, Ours]:
    """Return what the model as configured gives, and our presets beside it."""
    here = "this command"
    paper, thin = presses[AS_CONFIGURED], presses[THIN]
    fast, balanced = presses[FAST], presses[BALANCED]
    every = (paper.at_depth, *paper.at_forces)
    exact = reference.at_depth.force_n

    def off(model: ModelPresses) -> Ours:
        return Ours(value=100.0 * abs(model.at_depth.force_n / exact - 1.0), source=here)

    def sigma(model: ModelPresses) -> Ours:
        return Ours(value=100.0 * model.sigma_off_most, source=here)

    return {
        "model.rest_stress": Ours(value=abs(rest_stress_pa) / 1e3, source="law paper-eq4, here"),
        "model.force": off(paper),
        "model.force_ours": off(fast),
        "model.sigma": sigma(paper),
        "model.sigma_thin": sigma(thin),
        "model.sigma_ours": sigma(balanced),
        "model.gap": Ours(value=paper.at_forces[-1].gap_m * 1e3, source=here),
        "model.iterations": Ours(value=max(each.newton_iterations for each in every), source=here),
        "model.match": Ours(value=max(each.off_n for each in paper.at_forces), source=here),
    }


def speed_ours(speeds: Speeds) -> dict[str, Ours]:
    """Return the benchmark's slowest scene, alone and in 60 environments."""
    alone, many = speeds.slowest(1), speeds.slowest(ENVIRONMENTS)
    each = many.frames_per_s / ENVIRONMENTS
    source = f"{BENCHMARKS}/{many.file}, {many.scene}"
    return {
        "speed.single": Ours(
            value=alone.frames_per_s, source=f"{BENCHMARKS}/{alone.file}, {alone.scene}"
        ),
        "speed.sixty": Ours(value=many.frames_per_s, source=source),
        "speed.sixty_each": Ours(value=each, source=source),
        "speed.physics": Ours(value=1e3 / each, source=source),
        "speed.stress": Ours(
            value=1e3 * speeds.slowest_stress_s(), source=f"{BENCHMARKS}, slowest scene"
        ),
    }


def score_ours(reports: Sequence[KeptReport]) -> dict[str, Ours]:
    """Return scores of simulated images against real ones; emulated devices are no reality."""
    real = [report for report in reports if report.ours and not report.emulated]
    if not real:
        return {}
    best = max(real, key=lambda report: len(report.trials))
    found = {f"scores.{score}": value for score, value in best.ours.items() if score != "mse"}
    trials = sorted(best.trials, key=lambda trial: trial["force_n"])
    if trials:
        for score in ("ssim", "ncc", "psnr_db"):
            found[f"ends.{score}_first"] = trials[0][score]
            found[f"ends.{score}_last"] = trials[-1][score]
        found["ends.mse_least"] = min(trial["mse"] for trial in trials)
        found["ends.mse_most"] = max(trial["mse"] for trial in trials)
    source = f"{BENCHMARKS}, {best.name}"
    return {name: Ours(value=value, source=source) for name, value in found.items()}


def mode_ours(passed: Mapping[str, Sequence[bool]]) -> dict[str, Ours]:
    """Return the share of criteria that a contact mode meets, by its name."""
    return {
        f"modes.{name}": Ours(value=sum(each) / len(each), source="this command, as `modes`")
        for name, each in passed.items()
    }


NAME = "paper"
_HEIGHT_IN = 2.6
_LOOKS = {
    AS_CONFIGURED: (ORANGE, "o-"),
    THIN: (SKY, "s-"),
    FAST: (GREEN, "^-"),
    BALANCED: (BLUE, "v-"),
}
# Everything that a full frame of a press scores lies above this.
_SSIM_FROM = 0.9


def draw_paper(
    presses: Mapping[str, ModelPresses],
    reports: Sequence[KeptReport],
    folder: Path,
    *,
    page_folder: Path | None = None,
) -> list[Path]:
    """Draw depth and sigma n at the six forces, and SSIM of the paper beside no contact at all.

    Raises:
        RecordError: The files cannot be written.
    """
    with mpl.rc_context(STYLE):
        figure = new_figure(PAGE_IN, _HEIGHT_IN, marks=())
        depth, sigma, scores = figure.subplots(1, 3, width_ratios=(1.2, 1.2, 1.0))
        for name, model in presses.items():
            colour, mark = _LOOKS[name]
            looks = {"color": colour, "markersize": 3, "label": name}
            depths = [each.depth_m * 1e3 for each in model.at_forces]
            missed = [100.0 * each.sigma_off for each in model.at_forces]
            depth.plot(FORCES_N, depths, mark, **looks)
            sigma.plot(FORCES_N, missed, mark, **looks)
        depth.set(xlabel="$F_z$ [N]", ylabel="depth below first touch [mm]")
        sigma.set(xlabel="$F_z$ [N]", ylabel=r"$\sigma n$ off the contact force [%]")
        for axes in (depth, sigma):
            axes.set_ylim(bottom=0.0)
        figure.legend(*depth.get_legend_handles_labels(), loc="outside lower left", ncols=2)
        _draw_scores(scores, reports)
        return save_figure(figure, folder, NAME, page_folder=page_folder)


def _draw_scores(axes: Axes, reports: Sequence[KeptReport]) -> None:
    paper = claims()["scores.ssim"].value
    bars = [("the paper's:\nGelSight Mini, real", paper, ORANGE)]
    for report in reports:
        kind = "emulated" if report.emulated else "real"
        who = f"{report.name}, {kind}"
        bars.append((f"no contact:\n{who}", report.no_contact["ssim"], GREY))
        if report.ours:
            bars.append((f"ours:\n{who}", report.ours["ssim"], BLUE))
    names, values, colours = zip(*reversed(bars), strict=True)
    axes.barh(range(len(bars)), values, color=colours, height=0.6)
    axes.set_yticks(range(len(bars)), names, fontsize=5.5)
    axes.axvline(paper, color=ORANGE, linewidth=0.6)
    axes.set(xlim=(_SSIM_FROM, 1.0), xlabel="SSIM of the full frame")
