"""libuipc beside the batches, as a table: no time without its force and its balance."""

from __future__ import annotations

from collections.abc import Sequence

from sim.studies.bench.batches import BALANCE, BatchRow
from sim.studies.bench.peer.rows import PeerRow
from tacauchy_rig.tables import Cell, Table

_COLUMNS = (
    "engine",
    "solved to",
    "environments",
    "tetrahedra",
    "unknowns",
    "frames [1/s]",
    "frame of all [ms]",
    "ours over it",
    "Newton",
    "linear",
    "F_z off by [%]",
    "of it the mesh [%]",
    "imbalance",
    "residual",
    "of it inside",
    "gap [um]",
    "depth off by [um]",
)
_Cells = tuple[Cell, ...]


def peer_section(ours: Sequence[BatchRow], peers: Sequence[PeerRow]) -> Table:
    """Return our rows and the peer's; ``ours over it`` compares frames a second."""
    speeds = {row.environments: row.frames_per_s for row in ours}
    counts = {row.environments for row in peers}
    version = next((row.version for row in peers if row.version), "")
    failures = [row.summary for row in peers if row.failure]
    problems = [f"{row.name}: {problem}" for row in peers for problem in row.problems]
    return Table(
        title="Beside libuipc",
        columns=_COLUMNS,
        rows=(
            *(_our_cells(row) for row in ours if row.environments in counts),
            *(_peer_cells(row, speeds.get(row.environments)) for row in peers),
        ),
        criterion="none: a comparison; a time is worth no more than the force beside it",
        passed=True,
        note=f"libuipc {version} (PyPI: pyuipc), after ours, on the same GPU: one press to warm "
        "up, then the least of three, as ours. The same gels, depths, d_hat and touch height; no "
        "friction, no gravity, next to no mass. It has linear tetrahedra only and no planes of "
        "symmetry, so it takes the whole pad of which ours models a quarter: on the same "
        "tetrahedra, then on the same nodes, each tetrahedron cut in eight. Its cylinder is 64 "
        "flat sectors. A frame ends as libuipc comes, or when the last Newton step is below the "
        f"length given; * marks the loosest of these at which its forces balance to {BALANCE:g} "
        "as ours do, or the strictest if none does. F_z is compared with preset accurate's; of "
        "it the mesh: what our own solver is off on those linear tetrahedra with the same d_hat. "
        "Imbalance: reaction of the base, from its positions, against its contact force. "
        "Residual: norm of all unbalanced nodal forces over the contact force; of it inside: at "
        "nodes that contact does not push. All at the last "
        "frame, the largest of all environments. Newton, linear: iterations of a frame; of ours, "
        "evaluations of forces or stiffness. Gap: height of the indenter's underside above a "
        "node."
        + "".join(f" No numbers: {text}." for text in failures)
        + "".join(f" Of libuipc: {text}." for text in problems),
    )


def _our_cells(row: BatchRow) -> _Cells:
    return (
        "tacauchy_rig, a quarter, quadratic",
        f"balance {BALANCE:g}",
        row.environments,
        row.tet_count,
        row.unknown_count,
        round(row.frames_per_s),
        row.frame_ms,
        1.0,
        None,
        row.evaluations,
        1e2 * row.force_error,
        None,
        row.imbalance,
        row.residual,
        None,
        1e6 * row.gap_m,
        0.0,
    )


def _peer_cells(row: PeerRow, our_speed: float | None) -> _Cells:
    head = (
        f"libuipc, {row.mesh}",
        row.tolerance + (" *" if row.is_matched else ""),
        row.environments,
        row.tet_count,
        row.unknown_count,
    )
    if row.balance is None:
        return (*head, *[None] * (len(_COLUMNS) - len(head)))
    return (
        *head,
        round(row.frames_per_s),
        row.frame_ms,
        None if our_speed is None else our_speed / row.frames_per_s,
        row.newton_iterations,
        row.linear_iterations,
        1e2 * row.force_error,
        1e2 * row.our_error,
        row.balance.imbalance,
        row.balance.residual,
        row.balance.inner_residual,
        1e6 * row.balance.gap_m,
        1e6 * row.balance.depth_error_m,
    )
