"""Frames a second of libuipc on the batch's press, each beside its force and its balance."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sim.batch.pad import batch_model
from sim.scene.indenter import Cylinder
from sim.scene.scene import Scene
from sim.studies.bench.batches import BALANCE, BatchRow
from sim.studies.bench.frames import FRAME_COUNT
from sim.studies.bench.peer.pad import PeerBalance, PeerMesh, PeerPad, peer_balance, peer_pad
from sim.studies.bench.peer.process import PeerFailedError, PeerProcess
from sim.studies.bench.peer.task import AS_SHIPPED, LADDER, PeerTolerance
from tacauchy_rig.tables import Cell, Table

ENVIRONMENTS = (1, 8, 60)
# Of a row, the compilation of libuipc's kernels in the first of them included; and of all rows.
_LIMIT_S = 240.0
_TOTAL_S = 300.0
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


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerRow:
    """What libuipc took for a press, and how good it was.

    Attributes:
        failure: Why there are no numbers; empty where there are.
        newton_iterations: Of a frame, the mean; not a number where libuipc does not say.
        linear_iterations: Of its conjugate gradients in a frame, likewise.
        our_error: F_z of our own solver on the same linear mesh over that of preset accurate, less
            one: what the mesh alone is off.
        force_error: F_z of the first environment over that of preset accurate, less one.
        is_matched: Its tolerance is the one at which it is compared with ours.
    """

    mesh: str
    tolerance: str
    environments: int
    tet_count: int
    unknown_count: int
    version: str = ""
    set_up_s: float = float("nan")
    wall_s: float = float("nan")
    newton_iterations: float = float("nan")
    linear_iterations: float = float("nan")
    our_error: float = float("nan")
    force_error: float = float("nan")
    balance: PeerBalance | None = None
    is_matched: bool = False
    failure: str = ""
    problems: tuple[str, ...] = ()

    @property
    def frame_ms(self) -> float:
        """Time of a frame of all environments [ms]."""
        return 1e3 * self.wall_s / FRAME_COUNT

    @property
    def frames_per_s(self) -> float:
        """Frames of all environments together [1/s]."""
        return FRAME_COUNT * self.environments / self.wall_s

    @property
    def name(self) -> str:
        """What was pressed, and how strictly."""
        return f"{self.mesh}, {self.tolerance}, {self.environments} environments"

    @property
    def summary(self) -> str:
        """The row in a line."""
        found = self.failure or (
            f"{self.frames_per_s:.0f} frames/s, F_z off by {1e2 * self.force_error:.1f} %"
        )
        return f"{self.name}: {found}"

    def balances_to(self, limit: float) -> bool:
        """Every force is balanced to this share of the contact force."""
        found = self.balance
        return found is not None and found.imbalance <= limit and found.residual <= limit


def why_no_libuipc(scene: Scene, *, device: str) -> str:
    """Return why libuipc cannot run this scene here; empty where it can."""
    if device == "cpu":
        return "libuipc, which runs on a GPU only: there is none here"
    if importlib.util.find_spec("uipc") is None:
        return "libuipc, which is not installed: pip install pyuipc"
    if not isinstance(scene.indenter, Cylinder):
        return "libuipc, which is given cylinders only here"
    return ""


def measure_libuipc(
    scene: Scene,
    *,
    exact_n: float,
    balance: float,
    counts: Sequence[int] = ENVIRONMENTS,
    meshes: Sequence[PeerMesh] = tuple(PeerMesh),
    backend: str = "cuda",
) -> Iterator[PeerRow]:
    """Press in libuipc as it comes, then as strictly as its forces need to balance like ours.

    Args:
        scene: Pad, gel and cylinder.
        exact_n: F_z of preset accurate [N].
        balance: How well ours balance, relative to the contact force.
    """
    whole = batch_model(scene, symmetric=False)
    deadline = time.monotonic() + _TOTAL_S
    with PeerProcess(backend=backend) as process:
        for kind in meshes:
            pad = peer_pad(scene, whole, kind)
            press = partial(
                _row,
                pad,
                process=process,
                deadline=deadline,
                exact_n=exact_n,
                our_n=pad.our_force(),
            )
            yield press(count=counts[0], tolerance=AS_SHIPPED)
            for tolerance in LADDER:
                row = press(count=counts[0], tolerance=tolerance)
                is_matched = row.balances_to(balance) or tolerance is LADDER[-1]
                yield replace(row, is_matched=is_matched)
                if is_matched:
                    break
            for count in counts[1:]:
                yield press(count=count, tolerance=AS_SHIPPED)
                yield replace(press(count=count, tolerance=tolerance), is_matched=True)


def _row(
    pad: PeerPad,
    *,
    count: int,
    tolerance: PeerTolerance,
    process: PeerProcess,
    deadline: float,
    exact_n: float,
    our_n: float,
) -> PeerRow:
    blank = PeerRow(
        mesh=pad.kind.value,
        tolerance=tolerance.name,
        environments=count,
        tet_count=len(pad.model.elements),
        unknown_count=pad.model.pattern.dof_count,
        our_error=our_n / exact_n - 1.0,
    )
    left_s = deadline - time.monotonic()
    if left_s <= 0.0:
        return replace(blank, failure=f"not begun: libuipc has had its {_TOTAL_S:.0f} s")
    task = pad.task(count=count, tolerance=tolerance, load_n=our_n)
    try:
        found = process.press(task, limit_s=min(_LIMIT_S, left_s))
    except PeerFailedError as error:
        return replace(blank, failure=error.message)
    balance = peer_balance(pad, task, found)
    return replace(
        blank,
        version=found.version,
        set_up_s=found.set_up_s,
        wall_s=min(found.press_s),
        newton_iterations=float(np.mean(found.newton_iterations or [np.nan])),
        linear_iterations=float(np.mean(found.linear_iterations or [np.nan])),
        force_error=balance.force_n / exact_n - 1.0,
        balance=balance,
        problems=found.problems,
    )


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
