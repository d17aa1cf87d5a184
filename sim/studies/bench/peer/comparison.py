"""Frames a second of libuipc on the batch's press, each beside its force and its balance."""

from __future__ import annotations

import importlib.util
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from tempfile import TemporaryDirectory

import numpy as np

from sim.batch.pilot import batch_model
from sim.scene.indenter import Cylinder
from sim.scene.scene import Scene
from sim.studies.bench.batches import BALANCE, BatchRow
from sim.studies.bench.frames import TimedFrames
from sim.studies.bench.peer.libuipc import press_in_libuipc
from sim.studies.bench.peer.pad import PeerBalance, PeerMesh, PeerPad, peer_balance, peer_pad
from sim.studies.bench.peer.task import AS_SHIPPED, LADDER, PeerFound, PeerTask, PeerTolerance
from sim.studies.processes import OwnProcess, ProcessFailedError
from tacauchy_rig.page import table_prose
from tacauchy_rig.tables import Cell, Table, table_of_rows

ENVIRONMENTS = (1, 8, 60)
# Of a row, the compilation of libuipc's kernels in the first of them included; and of all rows.
_LIMIT_S = 240.0
_TOTAL_S = 300.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerRow(TimedFrames):
    """What libuipc took for a press, and how good it was.

    Attributes:
        failure: Why there are no numbers; empty where there are.
        newton_iterations: Of a frame, the mean; not a number where libuipc does not say.
        linear_iterations: Of its conjugate gradients in a frame, likewise.
        our_error: F_z of our own solver on the same linear mesh over that of preset accurate, less
            one: what the mesh alone is off.
        is_matched: Its tolerance is the one at which it is compared with ours.
    """

    mesh: str
    tolerance: str
    environments: int
    version: str = ""
    set_up_s: float = float("nan")
    newton_iterations: float = float("nan")
    linear_iterations: float = float("nan")
    our_error: float = float("nan")
    balance: PeerBalance | None = None
    is_matched: bool = False
    failure: str = ""
    problems: tuple[str, ...] = ()

    @property
    def _travelling(self) -> int:
        return self.environments

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
    # Its kernels stay loaded from press to press; where it aborts, the next one starts anew.
    with OwnProcess() as process, TemporaryDirectory(prefix="libuipc-") as folder:
        run = partial(press_in_libuipc, folder=folder, backend=backend)
        for kind in meshes:
            pad = peer_pad(scene, whole, kind)
            press = partial(
                _row,
                pad,
                process=process,
                run=run,
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
    process: OwnProcess,
    run: Callable[[PeerTask], PeerFound],
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
        found = process.call(partial(run, task), limit_s=min(_LIMIT_S, left_s))
    except ProcessFailedError as error:
        return replace(blank, failure=error.message.splitlines()[0])
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


def peer_table(ours: Sequence[BatchRow], peers: Sequence[PeerRow]) -> Table:
    """Return our rows and the peer's; ``ours over it`` compares frames a second."""
    speeds = {row.environments: row.frames_per_s for row in ours}
    counts = {row.environments for row in peers}
    rows = [
        *(_our_cells(row) for row in ours if row.environments in counts),
        *(_peer_cells(row, speeds.get(row.environments)) for row in peers),
    ]
    return table_of_rows(
        rows,
        **table_prose(
            "sim.studies.bench",
            "tables.md.jinja",
            "libuipc",
            version=next((row.version for row in peers if row.version), ""),
            balance=f"{BALANCE:g}",
            failures=[row for row in peers if row.failure],
            problems=[f"{row.name}: {problem}" for row in peers for problem in row.problems],
        ),
    )


def _our_cells(row: BatchRow) -> dict[str, Cell]:
    return {
        "engine": "tacauchy_rig, a quarter, quadratic",
        "solved to": f"balance {BALANCE:g}",
        "environments": row.environments,
        "tetrahedra": row.tet_count,
        "unknowns": row.unknown_count,
        "frames [1/s]": round(row.frames_per_s),
        "frame of all [ms]": row.frame_ms,
        "ours over it": 1.0,
        "Newton": None,
        "linear": row.evaluations,
        "F_z off by [%]": 1e2 * row.force_error,
        "of it the mesh [%]": None,
        "imbalance": row.imbalance,
        "residual": row.residual,
        "of it inside": None,
        "gap [um]": 1e6 * row.gap_m,
        "depth off by [um]": 0.0,
    }


def _peer_cells(row: PeerRow, our_speed: float | None) -> defaultdict[str, Cell]:
    """Return the numbers by heading; what has none is empty."""
    cells: defaultdict[str, Cell] = defaultdict(lambda: None)
    cells |= {
        "engine": f"libuipc, {row.mesh}",
        "solved to": row.tolerance + (" *" if row.is_matched else ""),
        "environments": row.environments,
        "tetrahedra": row.tet_count,
        "unknowns": row.unknown_count,
    }
    if row.balance is None:
        return cells
    return cells | {
        "frames [1/s]": round(row.frames_per_s),
        "frame of all [ms]": row.frame_ms,
        "ours over it": None if our_speed is None else our_speed / row.frames_per_s,
        "Newton": row.newton_iterations,
        "linear": row.linear_iterations,
        "F_z off by [%]": 1e2 * row.force_error,
        "of it the mesh [%]": 1e2 * row.our_error,
        "imbalance": row.balance.imbalance,
        "residual": row.balance.residual,
        "of it inside": row.balance.inner_residual,
        "gap [um]": 1e6 * row.balance.gap_m,
        "depth off by [um]": 1e6 * row.balance.depth_error_m,
    }
