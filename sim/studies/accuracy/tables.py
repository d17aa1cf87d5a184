"""What a study of accuracy found, as tables with their criteria."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from sim.scene.scene import Preset
from sim.studies.accuracy.observation import Row
from sim.studies.accuracy.study import EDGE_SHIFT, QUANTITIES, Study
from sim.studies.accuracy.tolerance_check import COST_WANTED, ToleranceOutcome
from tacauchy_rig.core.page import table_prose
from tacauchy_rig.core.tables import Cell, Table, table_of

ROWS_WANTED, FRONT_WANTED = 12, 4
KEPT_WANTED = 0.9
# Two runs are compared, and either may be off by its bar.
_RUNS = 2.0
_prose = partial(table_prose, "sim.studies.accuracy", "tables.md.jinja")

Errors = Mapping[str, Mapping[str, float]]


def study_table(found: Study, *, scene: str, command: str) -> Table:
    """Return every configuration's errors and cost."""
    fast_s = next((row.time_s for row in found.rows if row.configuration.name == Preset.FAST), None)
    measured = [row for row in found.rows if not row.failure]
    front = sum(row.on_front for row in measured)

    def over_fast(row: Row) -> float | None:
        return row.time_s / fast_s if fast_s else None

    def percent(row: Row, quantity: str) -> float:
        return 1e2 * row.errors[quantity]

    columns: dict[str, Callable[[Row], Cell]] = {
        "tetrahedra": lambda row: row.tet_count,
        "iterations": lambda row: row.newton_iterations,
        "time [s]": lambda row: row.time_s,
        "time over fast's": over_fast,
        "F_z [%]": partial(percent, quantity="force"),
        **{
            f"{name} [%]": partial(percent, quantity=name)
            for name in ("depth", "pressure", "radius", "height")
        },
        "1 - SSIM": lambda row: row.errors["image"],
        "ZNCC": lambda row: row.zncc_contact,
        "front": lambda row: "yes" if row.on_front else "",
    }

    def unless_failed(row: Row, value: Callable[[Row], Cell]) -> Cell:
        return None if row.failure else value(row)

    return table_of(
        sorted(found.rows, key=lambda row: (bool(row.failure), row.time_s)),
        {
            "settings": lambda row: row.configuration.name,
            **{name: partial(unless_failed, value=value) for name, value in columns.items()},
        },
        passed=len(measured) >= ROWS_WANTED and front >= FRONT_WANTED,
        **_prose(
            "study",
            rows_wanted=ROWS_WANTED,
            front_wanted=FRONT_WANTED,
            scene=scene,
            reference=found.reference.configuration.name,
            bars=", ".join(f"{name} {bar:.2%}" for name, bar in found.bars.items()),
            count=len(measured),
            front=front,
        ),
        command=command,
    )


def seed_table(first: Errors, second: Errors, bars: Errors, *, seed: int, command: str) -> Table:
    """Return whether errors come out alike on other meshes.

    Args:
        first: Errors by the configuration's name and quantity.
        second: The same on meshes of another seed.
        bars: How far each of the first may be off, as the first run alone has it.
    """
    names = [name for name in first if name in second and first[name] and second[name]]
    outside = {
        name: [
            quantity
            for quantity in QUANTITIES
            if abs(second[name][quantity] - first[name][quantity]) > _RUNS * bars[name][quantity]
        ]
        for name in names
    }
    total = len(QUANTITIES) * len(names)
    missed = sum(len(each) for each in outside.values())
    return table_of(
        names,
        {
            "settings": str,
            "F_z [%]": lambda name: 1e2 * first[name]["force"],
            f"F_z, seed {seed} [%]": lambda name: 1e2 * second[name]["force"],
            "bar of F_z [%]": lambda name: 1e2 * _RUNS * bars[name]["force"],
            "outside": lambda name: ", ".join(outside[name]) or "none",
        },
        passed=missed == 0,
        **_prose("seeds", seed=seed, within=total - missed, total=total, shift=f"{EDGE_SHIFT:.0%}"),
        command=command,
    )


def tolerance_table(
    found: Sequence[ToleranceOutcome], *, command: str, title: str, note: str = ""
) -> Table:
    """Return what a tolerance chose for each scene, and what that was worth.

    Args:
        note: What else is to be said of the scenes.
    """
    kept = sum(each.is_kept for each in found)
    thrifty = sum(each.is_thrifty for each in found)
    columns: dict[str, Callable[[ToleranceOutcome], Cell]] = {
        "F_z [N]": lambda each: each.force_n,
        "allowed [%]": lambda each: 1e2 * each.allowed,
        "settings chosen": lambda each: str(each.setting),
        "error believed [%]": lambda each: 1e2 * each.believed,
        "true error [%]": lambda each: 1e2 * each.true_error,
        "doubt of it [%]": lambda each: 1e2 * each.doubt,
        "kept": lambda each: "yes" if each.is_kept else "no",
        "cheapest that would have kept it": lambda each: (
            None if each.cheapest is None else str(each.cheapest)
        ),
        "time over its time": lambda each: each.cost_ratio,
        "of it for choosing": lambda each: each.choice_ratio,
    }
    refused = {"settings chosen": "refused", "kept": "no"}

    def unless_refused(each: ToleranceOutcome, name: str) -> Cell:
        return refused.get(name) if each.setting is None else columns[name](each)

    return table_of(
        found,
        {
            "scene": lambda each: each.asked.name,
            "tolerance": lambda each: str(each.asked.tolerance),
            **{name: partial(unless_refused, name=name) for name in columns},
        },
        passed=kept >= KEPT_WANTED * len(found) and thrifty == len(found),
        **_prose(
            "tolerances",
            title=title,
            kept=kept,
            count=len(found),
            cost=f"{COST_WANTED:g}",
            thrifty=thrifty,
            plain=sum(each.is_thrifty_once_chosen for each in found),
            more=note,
        ),
        command=command,
    )
