"""The study of accuracy against time: one press with many settings, and what tolerances keep."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache, partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pydantic import TypeAdapter

from sim.mesh.elements import ElementOrder
from sim.optics.render.renderer import nominal_renderer
from sim.press_arguments import scene_of
from sim.scene.scene import Preset, SceneTerms
from sim.sensor.sensor import load_sensor
from sim.studies.accuracy import reference_errors
from sim.studies.accuracy.tolerance import HELD_OUT, SEEN_BEFORE, check_tolerance, tolerance_table
from tacauchy_rig.core.markdown_page import prose, table_prose
from tacauchy_rig.core.plot_style import BLUE, GREEN, GREY, INK, ORANGE, PAGE_IN
from tacauchy_rig.core.study import Case, Result, Study, failures_table
from tacauchy_rig.core.tables import Table, table_of

_FLOOR = 1e-5
# Room for labels at the left and right ends, as factors of the time.
_LEFT, _RIGHT = 6.0, 2.5
# A gain on the front by a tenth can be seen.
_SEEN = 0.9
_LARGE = "force"
_TITLES = {
    _LARGE: "$F_z$ at equal depth",
    "depth": "Depth at equal $F_z$",
    "pressure": "Largest pressure",
    "height": "Height map (RMS)",
    "image": "Image (1 \N{MINUS SIGN} SSIM)",
}


def accuracy_figure(rows: Sequence[reference_errors.Row], bars: Mapping[str, float]) -> Figure:
    """Draw error against time, that of F_z large; bars are how far the reference may be off."""
    figure = Figure(figsize=(PAGE_IN, 4.6), layout="constrained")
    grid = figure.add_gridspec(2, 3, width_ratios=(2.4, 1.0, 1.0))
    for number, quantity in enumerate(_TITLES):
        small = divmod(number - 1, 2)
        place = grid[:, 0] if quantity == _LARGE else grid[small[0], 1 + small[1]]
        _draw_panel(figure.add_subplot(place), rows, bars[quantity], quantity)
    return figure


def _draw_panel(
    axes: Axes, rows: Sequence[reference_errors.Row], bar: float, quantity: str
) -> None:
    """Draw a quantity's errors; below ``bar``, the reference's own error, nothing is known."""
    large = quantity == _LARGE
    # The reference has no error against itself, and no place on a log axis.
    known = [row for row in rows if abs(row.errors[quantity]) > 0.0]
    axes.set(xscale="log", yscale="log")
    axes.set_title(_TITLES[quantity], loc="left")
    axes.grid(visible=True, which="major")
    if not known:
        return
    sizes = {row.configuration.name: max(abs(row.errors[quantity]), _FLOOR) for row in known}
    for kind, marker, colour, text in (
        ((ElementOrder.P2, False), "o", BLUE, "quadratic (P2)"),
        ((ElementOrder.P1, False), "s", ORANGE, "linear (P1)"),
        ((ElementOrder.P2, True), "D", GREEN, "quadratic, corrected"),
    ):
        chosen = [
            row
            for row in known
            if (row.configuration.element, row.configuration.is_corrected) == kind
        ]
        if not chosen:
            continue
        tall = [sizes[row.configuration.name] for row in chosen]
        bars = [
            reference_errors.error_bar(bar, row.errors[quantity], row.chances[quantity])
            for row in chosen
        ]
        axes.errorbar(
            [row.time_s for row in chosen],
            tall,
            # On a log axis a bar cannot reach down to zero.
            yerr=np.array([np.minimum(bars, 0.9 * np.array(tall)), bars]),
            fmt=marker,
            markersize=4.5 if large else 3.0,
            color=colour,
            elinewidth=0.5,
            label=text,
        )
    lowest = min(sizes.values())
    if bar > 0.0:
        axes.axhspan(0.2 * min(bar, lowest), bar, color=GREY, alpha=0.15, linewidth=0.0)
        label = "below the reference's own error" if large else None
        axes.axhline(bar, color=GREY, linewidth=0.5, linestyle=":", label=label)
    axes.set_ylim(bottom=0.5 * min(bar or np.inf, lowest))
    if large:
        front = sorted((row.time_s, sizes[row.configuration.name]) for row in known if row.on_front)
        axes.plot(*zip(*front, strict=True), color=INK, lw=0.8, label="Pareto front", zorder=1)
        _write_labels(axes, rows, sizes)
        left, right = axes.get_xlim()
        axes.set(xlim=(left / _LEFT, right * _RIGHT), xlabel="Set-up and solve (s)")
        axes.set_ylabel("Relative error")
        axes.legend(loc="upper right")


def _write_labels(
    axes: Axes, rows: Sequence[reference_errors.Row], sizes: dict[str, float]
) -> None:
    """Name presets above their points, in bold, and below them what gains on the front."""
    least = np.inf
    for row in sorted(rows, key=lambda row: row.time_s):
        name, is_preset = row.configuration.name, row.configuration.is_preset
        error = abs(row.errors[_LARGE])
        gains = row.on_front and error < _SEEN * least
        least = min(least, error) if row.on_front else least
        if name not in sizes or not (gains or is_preset):
            continue
        above: Any = {"xytext": (4, 4), "ha": "left", "va": "bottom", "fontweight": "bold"}
        below: Any = {"xytext": (-5, -4), "ha": "right", "va": "top"}
        axes.annotate(
            name.replace("d_hat", r"$\hat{d}$"),
            (row.time_s, sizes[name]),
            textcoords="offset points",
            fontsize=6.5,
            color=INK if row.on_front else GREY,
            **(above if is_preset else below),
        )


ROWS_WANTED, FRONT_WANTED = 12, 4
# Two runs are compared, and either may be off by its bar.
_RUNS = 2.0
_TOLERANCE = "tolerance: "
_prose = partial(table_prose, "sim.studies.accuracy", "tables.md.jinja")
_row: Callable[[Any], reference_errors.Row] = TypeAdapter(reference_errors.Row).validate_python


@dataclass
class Accuracy(Study):
    """A press with many settings against a reference, on meshes of one seed or more."""

    terms: SceneTerms  # a press of a sensor to a force
    similarity: reference_errors.Similarity  # as for ``Judge``
    full: bool = False  # measure many more settings
    # Of the meshes; the first one is shown whole, others are compared with it
    seeds: Sequence[int] = (0,)
    tolerances: bool = False  # judge what a tolerance keeps, too

    name, title, kind = "accuracy", "What accuracy costs in time", "configuration"
    is_together = True

    def cases(self) -> Sequence[Case]:
        """Return every configuration on meshes of every seed, and the tolerances' scenes."""
        found = []
        for seed in self.seeds:
            judge = cache(partial(self._judge, seed))
            found += [
                Case(name=name, shows=self._text, measure=partial(_measured, judge, each, seed))
                for name, each in self._named(seed).items()
            ]
        return found + [
            Case(
                name=f"{_TOLERANCE}{each.name}",
                shows=f"within {each.tolerance}",
                measure=partial(check_tolerance, each),
                on_request=not self.tolerances,
            )
            for each in (*HELD_OUT, *SEEN_BEFORE)
        ]

    def _named(self, seed: int) -> dict[str, reference_errors.Configuration]:
        """Return the configurations by the names of a seed's cases."""
        before = "" if seed == self.seeds[0] else f"seed {seed}: "
        return {
            f"{before}{each.name}": each
            for each in (reference_errors.FULL if self.full else reference_errors.SHORT)
        }

    @property
    def _text(self) -> str:
        return f"{self.terms.indenter} into {self.terms.sensor} at {self.terms.force}"

    def _judge(self, seed: int) -> reference_errors.Judge:
        gel = load_sensor(self.terms.sensor or "")
        return reference_errors.Judge(
            scene_of(self.terms),
            gel.camera,
            reference_errors.reseeded(reference_errors.REFERENCE, seed),
            render=nominal_renderer(gel),
            similarity=self.similarity,
        )

    def line(self, result: Result) -> str:
        """Return the error of F_z, or whether a tolerance was kept."""
        if result.name.startswith(_TOLERANCE):
            return f"kept: {result.found['kept']}"
        row = _row(result.found["row"])
        return f"F_z {row.errors['force']:+.2%} in {row.time_s:.2f} s"

    def rows(
        self, results: Sequence[Result], seed: int
    ) -> tuple[list[reference_errors.Row], dict[str, float]]:
        """Return the rows of a seed, and how far its reference may be off, by quantity."""
        names = self._named(seed)
        found = [each.found for each in results if each.name in names and not each.failure]
        bars = found[0]["bars"] if found else {}
        return reference_errors.finished([_row(each["row"]) for each in found]), bars

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return the first seed's study, the others beside it, and the tolerances."""
        rows, bars = self.rows(results, self.seeds[0])
        tables = [study_table(rows, bars, scene=self._text)] if rows else []
        for seed in self.seeds[1:]:
            if others := self.rows(results, seed)[0]:
                tables.append(seed_table(rows, others, bars, seed=seed))
        known = {each.name: each.found for each in results if not each.failure}
        for scenes, is_earlier in ((HELD_OUT, False), (SEEN_BEFORE, True)):
            names = [f"{_TOLERANCE}{each.name}" for each in scenes]
            if outcomes := [known[name] for name in names if name in known]:
                tables.append(tolerance_table(outcomes, is_earlier=is_earlier))
        return [*tables, *failures_table(results, kind=self.kind)]

    def facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the reference and the configurations of the first seed, and the tolerances."""
        rows, bars = self.rows(results, self.seeds[0])
        return {
            "scene": self._text,
            "reference": {"error_bars": bars},
            "configurations": [
                {
                    **asdict(row),
                    "name": row.configuration.name,
                    "wall_s": row.wall_s,
                    "time_s": row.time_s,
                    "force_error_relative": row.errors["force"],
                }
                for row in rows
            ],
        }

    def figures(self, results: Sequence[Result]) -> Mapping[str, Figure]:
        """Draw error against time."""
        rows, bars = self.rows(results, self.seeds[0])
        return {"accuracy": accuracy_figure(rows, bars)} if rows else {}

    def note(self, results: Sequence[Result]) -> str:
        """Return what a tolerance is."""
        del results
        return prose("sim.studies.accuracy", "tables.md.jinja", "note")


def _measured(
    judge: Callable[[], reference_errors.Judge], each: reference_errors.Configuration, seed: int
) -> dict[str, Any]:
    row = judge().row(
        reference_errors.reseeded(each, seed),
        # The paper's mesh is but one, and the bias of other edges is not known.
        shifted=seed == 0 and each.preset is not Preset.PAPER and not each.is_corrected,
    )
    reference = judge().reference
    return {
        "row": asdict(row),
        "bars": judge().bars,
        "reference": {"name": reference.configuration.name, "wall_s": reference.wall_s},
    }


def study_table(
    rows: Sequence[reference_errors.Row], bars: Mapping[str, float], *, scene: str
) -> Table:
    """Return every configuration's errors and cost."""
    fast_s = next((row.time_s for row in rows if row.configuration.name == Preset.FAST), None)
    front = sum(row.on_front for row in rows)
    off = ", ".join(f"{name} {bar:.2%}" for name, bar in bars.items())
    facts = {"scene": scene, "reference": reference_errors.REFERENCE.name, "bars": off}
    wanted = {"rows_wanted": ROWS_WANTED, "front_wanted": FRONT_WANTED}

    def percent(row: reference_errors.Row, quantity: str) -> float:
        return 1e2 * row.errors[quantity]

    return table_of(
        sorted(rows, key=lambda row: row.time_s),
        {
            "settings": lambda row: row.configuration.name,
            "tetrahedra": lambda row: row.tet_count,
            "iterations": lambda row: row.newton_iterations,
            "time [s]": lambda row: row.time_s,
            "time over fast's": lambda row: row.time_s / fast_s if fast_s else None,
            "F_z [%]": partial(percent, quantity="force"),
            **{
                f"{name} [%]": partial(percent, quantity=name)
                for name in reference_errors.QUANTITIES[1:-1]
            },
            "1 - SSIM": lambda row: row.errors["image"],
            "ZNCC": lambda row: row.zncc_contact,
            "front": lambda row: "yes" if row.on_front else "",
        },
        passed=len(rows) >= ROWS_WANTED and front >= FRONT_WANTED,
        **_prose("study", count=len(rows), front=front, **facts, **wanted),
    )


def seed_table(
    rows: Sequence[reference_errors.Row],
    others: Sequence[reference_errors.Row],
    bars: Mapping[str, float],
    *,
    seed: int,
) -> Table:
    """Return whether errors come out alike on other meshes, within the first run's bars."""
    second = {row.configuration.name: row.errors for row in others}
    first = {r.configuration.name: r for r in rows if r.configuration.name in second}

    def bar(name: str, of: str) -> float:
        row = first[name]
        return _RUNS * reference_errors.error_bar(bars[of], row.errors[of], row.chances[of])

    def missing(name: str) -> list[str]:
        errors, found = first[name].errors, second[name]
        return [
            of for of in reference_errors.QUANTITIES if abs(found[of] - errors[of]) > bar(name, of)
        ]

    total, missed = (
        len(reference_errors.QUANTITIES) * len(first),
        sum(len(missing(name)) for name in first),
    )
    return table_of(
        first,
        {
            "settings": str,
            "F_z [%]": lambda name: 1e2 * first[name].errors["force"],
            f"F_z, seed {seed} [%]": lambda name: 1e2 * second[name]["force"],
            "bar of F_z [%]": lambda name: 1e2 * bar(name, "force"),
            "outside": lambda name: ", ".join(missing(name)) or "none",
        },
        passed=missed == 0,
        **_prose(
            "seeds",
            seed=seed,
            within=total - missed,
            total=total,
            shift=f"{reference_errors.EDGE_SHIFT:.0%}",
        ),
    )
