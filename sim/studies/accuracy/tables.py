"""What a study of accuracy found, as tables with their criteria."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

from sim.error.measured_errors import FAST, Setting, indenter_kind
from sim.error.prior_error import QUANTILE, force_error, time_ratio
from sim.error.tolerance import settings_by_cost
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.scene import Preset, Target
from sim.sensor.sensor import load_sensor
from sim.studies.accuracy.observation import Row
from sim.studies.accuracy.study import EDGE_SHIFT, QUANTITIES, Study
from sim.studies.accuracy.tolerance_check import COST_WANTED, ToleranceOutcome
from tacauchy_rig.page import table_prose
from tacauchy_rig.tables import Cell, Table, table_of

_EXAMPLES: dict[str, Indenter] = {
    "punch": Cylinder(diameter_m=5e-3, fillet_m=0.2e-3),
    "ball": Sphere(diameter_m=10e-3),
}
_EXAMPLE_POISSON = (0.40, 0.45, 0.48)
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


def presets_table(*, command: str) -> Table:
    """Return what is believed of every setting, as the choice by a tolerance sees it."""
    gel = load_sensor("gelsight-mini")

    def time(setting: Setting, indenter: Indenter) -> float:
        return time_ratio(setting, FAST, kind=indenter_kind(indenter))

    def error(setting: Setting, indenter: Indenter, poisson: float) -> float | None:
        material = replace(gel.material, poisson=poisson)
        scene = gel.scene(indenter, Target(depth_m=0.5e-3), material=material)
        believed = force_error(setting.applied(scene))[0]
        return None if believed is None else 1e2 * believed

    return table_of(
        settings_by_cost(),
        {
            "settings": str,
            **{
                f"time over fast's, {name}": partial(time, indenter=each)
                for name, each in _EXAMPLES.items()
            },
            **{
                f"{name}, nu {poisson:g} [%]": partial(error, indenter=each, poisson=poisson)
                for name, each in _EXAMPLES.items()
                for poisson in _EXAMPLE_POISSON
            },
        },
        **_prose("presets", share=f"{QUANTILE:.0%}"),
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
