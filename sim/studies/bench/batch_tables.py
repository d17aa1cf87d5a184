"""What the benchmark measured of environments side by side, as tables."""

from __future__ import annotations

from sim.studies.bench.batches import BALANCE
from sim.studies.bench.frames import FORCE_ERROR_MAX
from sim.studies.bench.press_parts import exponent
from sim.studies.bench.suite import Bench
from tacauchy_rig.tables import Table

TIMES = "none: a time belongs to the machine and what else it does"
# To which times are to grow less than the environments.
_FEW = 60
_STRESS_MS = 0.1


def batches_section(found: Bench) -> Table:
    """Return frames a second beside what their forces are worth."""
    rows = found.batches
    few = [row for row in rows if row.environments <= _FEW]
    counts, times = [float(row.environments) for row in few], [row.wall_s for row in few]
    growth = ""
    if len(few) > 1:
        power = exponent(counts, times)
        growth = f" Up to {_FEW} environments time grows with their number to the {power:.2f}."
    return Table(
        title="Environments side by side",
        columns=(
            "device",
            "environments",
            "frames [1/s]",
            "frame of all [ms]",
            "evaluations",
            "F_z off by [%]",
            "imbalance",
            "residual",
            "gap [um]",
            "failed",
        ),
        rows=tuple(
            (
                row.device,
                row.environments,
                round(row.frames_per_s),
                row.frame_ms,
                row.evaluations,
                1e2 * row.force_error,
                row.imbalance,
                row.residual,
                1e6 * row.gap_m,
                row.failed_count,
            )
            for row in rows
        ),
        criterion="F_z within 3 % of preset accurate, base reaction and indenter force alike to "
        f"{BALANCE:g}, every gap positive, every environment at its last frame",
        passed=all(
            abs(row.force_error) <= FORCE_ERROR_MAX
            and row.imbalance <= BALANCE
            and row.gap_m > 0.0
            and row.failed_count == 0
            for row in rows
        ),
        note=f"The same travel over one rest mesh of {rows[0].tet_count} quadratic tetrahedra and "
        f"{rows[0].unknown_count} unknowns; moduli and depths differ by up to 10 %. An evaluation "
        "is one of the forces, or of the stiffness times a direction; their number is the mean for "
        f"a frame. Set-up, once for all: {rows[0].setup_s:.1f} s."
        + growth
        + "".join(f" Not measured: {text}." for text in found.absent if "images" not in text),
    )


def stress_section(found: Bench) -> Table:
    """Return what taking the stress off the surface takes."""
    rows = [row for row in found.batches if row.environments == 1 and row.device != "cpu"]
    return Table(
        title="Stress on the surface, in a batch",
        columns=(
            "device",
            "environments",
            "faces of each",
            "on the device [us]",
            "of it for one environment [us]",
            "with results on the host [us]",
        ),
        rows=tuple(
            (
                row.device,
                row.environments,
                row.stress.face_count,
                1e6 * row.stress.device_s,
                1e6 * row.stress.device_s / row.environments,
                1e6 * row.stress.host_s,
            )
            for row in found.batches
        ),
        criterion=TIMES
        if not rows
        else f"for one environment on a GPU less than {_STRESS_MS:g} ms",
        passed=all(1e3 * row.stress.device_s < _STRESS_MS for row in rows),
        note="Cauchy stress in the tetrahedron behind every face, traction, its normal and its "
        "tangential part (paper, Algorithm 1), in one launch over all environments, in float64, "
        "from the displacements at the end of the press; on a GPU the mean of many in one graph. "
        "On the host: launched from there, and all results copied to its memory.",
    )


def parts_section(found: Bench) -> Table:
    """Return what each launch of a tick takes."""
    rows = [row for batch in found.batches for row in batch.parts]
    names = list(rows[0].parts_s)
    return Table(
        title="Parts of an evaluation",
        columns=("environments", "doing", *(f"{name} [us]" for name in names), "together [us]"),
        rows=tuple(
            (
                row.environments,
                row.doing,
                *(round(1e6 * row.parts_s[name], 1) for name in names),
                round(1e6 * sum(row.parts_s.values()), 1),
            )
            for row in rows
        ),
        criterion=TIMES,
        passed=True,
        note="Each launch alone, repeated, on the untouched gel, all environments doing the same: "
        "evaluating forces, or the stiffness along a direction of the search. In a batch each "
        "environment does what it needs, all in the same launches.",
    )
