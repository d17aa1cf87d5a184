"""What a study found, as tables with their criteria."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from sim.error.measured_errors import FAST, indenter_kind
from sim.error.prior_error import QUANTILE, force_error, time_ratio
from sim.error.tolerance import settings_by_cost
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.scene import Preset, Scene, Target
from sim.sensor.sensor import load_sensor
from sim.studies.accuracy.mesh_chance import EDGE_SHIFT
from sim.studies.accuracy.study import QUANTITIES, Row, Study
from tacauchy_rig.tables import Cell, Table

_EXAMPLES: dict[str, Indenter] = {
    "punch": Cylinder(diameter_m=5e-3, fillet_m=0.2e-3),
    "ball": Sphere(diameter_m=10e-3),
}
_EXAMPLE_POISSON = (0.40, 0.45, 0.48)
ROWS_WANTED, FRONT_WANTED = 12, 4
# Two runs are compared, and either may be off by its bar.
_RUNS = 2.0

Errors = Mapping[str, Mapping[str, float]]


def study_section(found: Study, *, scene: str, command: str) -> Table:
    """Return every configuration's errors and cost."""
    fast = next((row.time_s for row in found.rows if row.configuration.name == Preset.FAST), None)
    measured = [row for row in found.rows if not row.failure]
    front = sum(row.on_front for row in measured)
    bars = ", ".join(f"{name} {bar:.2%}" for name, bar in found.bars.items())
    return Table(
        title="Error against time",
        columns=(
            "settings",
            "tetrahedra",
            "iterations",
            "time [s]",
            "time over fast's",
            "F_z [%]",
            "depth [%]",
            "pressure [%]",
            "radius [%]",
            "height [%]",
            "1 - SSIM",
            "ZNCC",
            "front",
        ),
        rows=tuple(
            _cells(row, fast)
            for row in sorted(found.rows, key=lambda row: (bool(row.failure), row.time_s))
        ),
        criterion=f"at least {ROWS_WANTED} configurations and a front of at least {FRONT_WANTED}",
        passed=len(measured) >= ROWS_WANTED and front >= FRONT_WANTED,
        note=f"{scene}. F_z is compared at the reference's depth, everything else at the force: "
        "F_z and depth with the limit that the reference and a coarser one tend to, the rest with "
        f"the reference, {found.reference.configuration.name}. That may itself be off by: {bars}. "
        f"{len(measured)} configurations, {front} of them on the front of F_z. Time is set-up and "
        "solve by the clock, less what was waited for a processor that others used.",
        command=command,
    )


def _cells(row: Row, fast_s: float | None) -> tuple[Cell, ...]:
    name = row.configuration.name
    if row.failure:
        return (name, *(None,) * 12)
    errors = row.errors
    percent = [1e2 * errors[name] for name in ("force", "depth", "pressure", "radius", "height")]
    return (
        name,
        row.tet_count,
        row.newton_iterations,
        row.time_s,
        row.time_s / fast_s if fast_s else None,
        *percent,
        errors["image"],
        row.zncc_contact,
        "yes" if row.on_front else "",
    )


def seed_section(first: Errors, second: Errors, bars: Errors, *, seed: int, command: str) -> Table:
    """Return whether errors come out alike on other meshes.

    Args:
        first: Errors by the configuration's name and quantity.
        second: The same on meshes of another seed.
        bars: How far each of the first may be off, as the first run alone has it.
    """
    names = [name for name in first if name in second and first[name] and second[name]]
    outside = {name: _outside(first[name], second[name], bars[name]) for name in names}
    rows = tuple(
        (
            name,
            1e2 * first[name]["force"],
            1e2 * second[name]["force"],
            1e2 * _RUNS * bars[name]["force"],
            ", ".join(outside[name]) or "none",
        )
        for name in names
    )
    total = len(QUANTITIES) * len(names)
    missed = sum(len(each) for each in outside.values())
    return Table(
        title=f"The same on other meshes, seed {seed}",
        columns=("settings", "F_z [%]", f"F_z, seed {seed} [%]", "bar of F_z [%]", "outside"),
        rows=rows,
        criterion="every error is reproduced within its bar on meshes of another seed",
        passed=missed == 0,
        note=f"{total - missed} of {total} errors (six quantities each) come out within their bar. "
        "The bars are the first run's, which knows nothing of this one. A bar is the doubt of its "
        "reference, plus the largest difference that meshes with edges "
        f"{EDGE_SHIFT:.0%} shorter and longer made to that error; the sum counts twice, since "
        "either run may be the odd one. For meshes finer than fast's that difference was not "
        "measured: it is taken as the same share of their error as fast's is of its own, between "
        "a quarter and all of it. A seed makes every edge up to "
        f"{EDGE_SHIFT:.0%} shorter or longer, the reference's too; preset paper has but one mesh.",
        command=command,
    )


def _outside(
    first: Mapping[str, float], second: Mapping[str, float], bars: Mapping[str, float]
) -> Sequence[str]:
    return [name for name in QUANTITIES if abs(second[name] - first[name]) > _RUNS * bars[name]]


def presets_section(*, command: str) -> Table:
    """Return what is believed of every setting, as the choice by a tolerance sees it."""
    scenes = {
        f"{name}, nu {poisson:g} [%]": _example(indenter, poisson)
        for name, indenter in _EXAMPLES.items()
        for poisson in _EXAMPLE_POISSON
    }
    times = {f"time over fast's, {name}": indenter_kind(each) for name, each in _EXAMPLES.items()}
    return Table(
        title="What the presets are worth",
        columns=("settings", *times, *scenes),
        rows=tuple(
            (
                str(setting),
                *(time_ratio(setting, FAST, kind=kind) for kind in times.values()),
                *(_percent(force_error(setting.applied(scene))[0]) for scene in scenes.values()),
            )
            for setting in settings_by_cost()
        ),
        criterion="none: this is what a tolerance chooses by",
        passed=True,
        note="Believed relative error of F_z, examples: 0.5 mm deep in a GelSight Mini with "
        "another Poisson's ratio, the punch 5 mm wide with a fillet of 0.2 mm, the ball 10 mm. It "
        "is what the edges of the mesh's section do at small strains, and what a fit through "
        f"training presses makes of that (sim/error/prior_error.py): {QUANTILE:.0%} of the errors "
        "of presses that were left out of the fit, each in its turn, lie below; for preset paper "
        "the largest that was measured. Times are medians of ratios of processor times on one "
        "thread. "
        "Kept in sim/error/force_errors.json.",
        command=command,
    )


def _example(indenter: Indenter, poisson: float) -> Scene:
    gel = load_sensor("gelsight-mini")
    return Scene(
        pad=gel.pad,
        material=replace(gel.material, poisson=poisson),
        indenter=indenter,
        target=Target(depth_m=0.5e-3),
    )


def _percent(share: float | None) -> float | None:
    return None if share is None else 1e2 * share
