"""The study of accuracy against time: one press with many settings, and what tolerances keep."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import cache, partial
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from sim.optics.render.renderer import nominal_renderer
from sim.press_command import scene_of
from sim.scene.scene import Preset, SceneTerms
from sim.sensor.sensor import load_sensor
from sim.studies.accuracy.figure import draw_rows
from sim.studies.accuracy.judging import (
    EDGE_SHIFT,
    QUANTITIES,
    Judge,
    Similarity,
    error_bar,
    finished,
)
from sim.studies.accuracy.press import FULL, REFERENCE, SHIFTED, SHORT, Configuration, Row, reseeded
from sim.studies.accuracy.tolerance import (
    HELD_OUT,
    SEEN_BEFORE,
    check_tolerance,
    tolerance_table,
)
from tacauchy_rig.core.page import table_prose
from tacauchy_rig.core.study import Case, Result, Study, failures_table
from tacauchy_rig.core.tables import Table, table_of

ROWS_WANTED, FRONT_WANTED = 12, 4
# Two runs are compared, and either may be off by its bar.
_RUNS = 2.0
_TOLERANCE = "tolerance: "
_prose = partial(table_prose, "sim.studies.accuracy", "tables.md.jinja")
_row: Callable[[Any], Row] = TypeAdapter(Row).validate_python


class Accuracy(Study):
    """A press with many settings against a reference, on meshes of one seed or more.

    Args:
        terms: A press of a sensor to a force.
        similarity: As for ``Judge``.
        full: Measure many more settings.
        seeds: Of the meshes; the first one is shown whole, others are compared with it.
        tolerances: Judge what a tolerance keeps, too.
    """

    name, title, kind = "accuracy", "What accuracy costs in time", "configuration"
    is_together = True

    def __init__(
        self,
        terms: SceneTerms,
        similarity: Similarity,
        *,
        full: bool = False,
        seeds: Sequence[int] = (0,),
        tolerances: bool = False,
    ) -> None:
        self._terms, self._similarity, self._seeds = terms, similarity, tuple(seeds)
        self._configurations = FULL if full else SHORT
        self._tolerances = tolerances

    def cases(self) -> Sequence[Case]:
        """Return every configuration on meshes of every seed, and the tolerances' scenes."""
        found = []
        for seed in self._seeds:
            judge = cache(partial(self._judge, seed))
            found += [
                Case(
                    name=_named(each, seed, self._seeds),
                    shows=self._text,
                    measure=partial(_measured, judge, each, seed),
                )
                for each in self._configurations
            ]
        return found + [
            Case(
                name=f"{_TOLERANCE}{each.name}",
                shows=f"within {each.tolerance}",
                measure=partial(check_tolerance, each),
                on_request=not self._tolerances,
            )
            for each in (*HELD_OUT, *SEEN_BEFORE)
        ]

    @property
    def _text(self) -> str:
        return f"{self._terms.indenter} into {self._terms.sensor} at {self._terms.force}"

    def _judge(self, seed: int) -> Judge:
        gel = load_sensor(self._terms.sensor or "")
        return Judge(
            scene_of(self._terms),
            gel.camera,
            reseeded(REFERENCE, seed),
            render=nominal_renderer(gel),
            similarity=self._similarity,
        )

    def line(self, result: Result) -> str:
        """Return the error of F_z, or whether a tolerance was kept."""
        if result.failure:
            return result.failure
        if result.name.startswith(_TOLERANCE):
            return f"kept: {result.found['kept']}"
        row = _row(result.found["row"])
        return f"F_z {row.errors['force']:+.2%} in {row.time_s:.2f} s"

    def rows(self, results: Sequence[Result], seed: int) -> tuple[list[Row], dict[str, float]]:
        """Return the rows of a seed, and how far its reference may be off, by quantity."""
        names = {_named(each, seed, self._seeds) for each in self._configurations}
        found = [each.found for each in results if each.name in names and not each.failure]
        bars = found[0]["bars"] if found else {}
        return finished([_row(each["row"]) for each in found]), bars

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return the first seed's study, the others beside it, and the tolerances."""
        rows, bars = self.rows(results, self._seeds[0])
        tables = []
        if rows:
            reference = next(r.found["reference"] for r in results if r.found and "row" in r.found)
            tables.append(study_table(rows, bars, scene=self._text, reference=reference["name"]))
        for seed in self._seeds[1:]:
            if others := self.rows(results, seed)[0]:
                tables.append(seed_table(rows, others, bars, seed=seed))
        known = {each.name: each.found for each in results if not each.failure}
        for scenes, title, note in (
            (HELD_OUT, "What a tolerance keeps", ""),
            (
                SEEN_BEFORE,
                "What a tolerance keeps, on scenes that were judged before",
                " They were looked at while the method was made: the other ten decide.",
            ),
        ):
            names = [f"{_TOLERANCE}{each.name}" for each in scenes]
            if outcomes := [known[name] for name in names if name in known]:
                tables.append(tolerance_table(outcomes, title=title, note=note))
        return [*tables, *failures_table(results, kind=self.kind)]

    def facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the reference and the configurations of the first seed, and the tolerances."""
        rows, bars = self.rows(results, self._seeds[0])
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

    def draw(self, results: Sequence[Result], folder: Path, page_folder: Path) -> list[Path]:
        """Draw error against time."""
        rows, bars = self.rows(results, self._seeds[0])
        return draw_rows(rows, bars, folder, page_folder=page_folder) if rows else []

    def note(self, results: Sequence[Result]) -> str:
        """Return what a tolerance is."""
        del results
        return (
            "`press`, `plan`, `replay` and `replay.tolerance` in a configuration take a tolerance "
            "such as 0.02N or 1% and choose the cheapest preset that is believed to keep it."
        )


def _named(configuration: Configuration, seed: int, seeds: Sequence[int]) -> str:
    return configuration.name if seed == seeds[0] else f"seed {seed}: {configuration.name}"


def _measured(judge: Callable[[], Judge], each: Configuration, seed: int) -> dict[str, Any]:
    row = judge().row(reseeded(each, seed), shifted=seed == 0 and each in SHIFTED)
    reference = judge().reference
    return {
        "row": asdict(row),
        "bars": judge().bars,
        "reference": {"name": reference.configuration.name, "wall_s": reference.wall_s},
    }


def study_table(
    rows: Sequence[Row], bars: Mapping[str, float], *, scene: str, reference: str
) -> Table:
    """Return every configuration's errors and cost."""
    fast_s = next((row.time_s for row in rows if row.configuration.name == Preset.FAST), None)
    front = sum(row.on_front for row in rows)

    def percent(row: Row, quantity: str) -> float:
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
                for name in ("depth", "pressure", "radius", "height")
            },
            "1 - SSIM": lambda row: row.errors["image"],
            "ZNCC": lambda row: row.zncc_contact,
            "front": lambda row: "yes" if row.on_front else "",
        },
        passed=len(rows) >= ROWS_WANTED and front >= FRONT_WANTED,
        **_prose(
            "study",
            rows_wanted=ROWS_WANTED,
            front_wanted=FRONT_WANTED,
            scene=scene,
            reference=reference,
            bars=", ".join(f"{name} {bar:.2%}" for name, bar in bars.items()),
            count=len(rows),
            front=front,
        ),
    )


def seed_table(
    rows: Sequence[Row], others: Sequence[Row], bars: Mapping[str, float], *, seed: int
) -> Table:
    """Return whether errors come out alike on other meshes.

    Args:
        rows: Of the first run, whose bars decide.
        others: Of meshes of another seed.
        bars: How far the first run's reference may be off, by quantity.
    """
    second = {row.configuration.name: row.errors for row in others}
    first = {r.configuration.name: r for r in rows if r.configuration.name in second}

    def bar(name: str, quantity: str) -> float:
        row = first[name]
        own = error_bar(bars[quantity], row.errors[quantity], row.chances[quantity])
        return _RUNS * own

    outside = {
        name: [
            quantity
            for quantity in QUANTITIES
            if abs(second[name][quantity] - row.errors[quantity]) > bar(name, quantity)
        ]
        for name, row in first.items()
    }
    total, missed = len(QUANTITIES) * len(first), sum(len(each) for each in outside.values())
    return table_of(
        first,
        {
            "settings": str,
            "F_z [%]": lambda name: 1e2 * first[name].errors["force"],
            f"F_z, seed {seed} [%]": lambda name: 1e2 * second[name]["force"],
            "bar of F_z [%]": lambda name: 1e2 * bar(name, "force"),
            "outside": lambda name: ", ".join(outside[name]) or "none",
        },
        passed=missed == 0,
        **_prose("seeds", seed=seed, within=total - missed, total=total, shift=f"{EDGE_SHIFT:.0%}"),
    )
