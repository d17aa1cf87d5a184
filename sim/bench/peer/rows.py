"""Frames a second of libuipc on the batch's press, each beside its force and its balance."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sim.batch.pad import batch_model
from sim.bench.batches import environments
from sim.bench.frames import FRAME_COUNT
from sim.bench.peer.balance import PeerBalance, peer_balance
from sim.bench.peer.pad_mesh import PeerMesh, linear_mesh
from sim.bench.peer.process import PeerFailedError, PeerProcess
from sim.bench.peer.task import PeerTask
from sim.bench.peer.tolerance import AS_SHIPPED, LADDER, PeerTolerance
from sim.indenter import Cylinder
from sim.mesh import TetMesh
from sim.model import Model
from sim.scene import Scene
from sim.touch import touch_height
from sim.triangle_surface import closed_surface
from sim.turned_indenter import cylinder_triangles
from tacauchy_rig.errors import ConfigError

ENVIRONMENTS = (1, 8, 60)
_BODY_SECTORS = 64
# Every node beneath the indenter carries its share of the force at a gap of 0.6 d_hat, where the
# barrier's force is this times kappa d_hat^3.
_BARRIER_FORCE = 2.93
_LIMIT_S = 240.0
_BASE_SHARE = 1e-6
_TOP_SHARE = 0.9


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerRow:
    """What libuipc took for a press, and how good it was.

    Attributes:
        failure: Why there are no numbers; empty where there are.
        newton_iterations: Of a frame, the mean; not a number where libuipc does not say.
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
    def summary(self) -> str:
        """The row in a line."""
        found = self.failure or (
            f"{self.frames_per_s:.0f} frames/s, F_z off by {1e2 * self.force_error:.1f} %"
        )
        return f"{self.mesh}, {self.tolerance}, {self.environments} environments: {found}"

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
    with PeerProcess(backend=backend) as process:
        for kind in meshes:
            pad = PeerPad(scene, whole, linear_mesh(whole.mesh, kind), kind)
            press = partial(_row, pad, process=process, exact_n=exact_n)
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


@dataclass(frozen=True, slots=True)
class PeerPad:
    """A scene as libuipc is given it.

    Attributes:
        whole: Our model of the pad without symmetry.
        mesh: The peer's tetrahedra.
    """

    scene: Scene
    whole: Model
    mesh: TetMesh
    kind: PeerMesh

    @property
    def clamped(self) -> NDArray[np.bool_]:
        """Nodes on the base."""
        return self.mesh.vertices[:, 2] <= _BASE_SHARE * self.whole.height_m

    def task(
        self, cylinder: Cylinder, count: int, tolerance: PeerTolerance, load_n: float
    ) -> PeerTask:
        """Return the presses of the batch's first environments."""
        triangles = cylinder_triangles(cylinder, sectors=_BODY_SECTORS)
        surface = closed_surface(*triangles, name="cylinder")
        chosen = environments(self.scene, count)
        distance_m = self.whole.contact_options.distance_m
        touch_m = touch_height(
            self.whole, cylinder, self.whole.nodes, centre_m=(0.0, 0.0), rotation=np.eye(3)
        )
        beneath = np.hypot(*self.mesh.vertices[:, :2].T) < cylinder.radius_m
        beneath &= self.mesh.vertices[:, 2] > _TOP_SHARE * self.whole.height_m
        return PeerTask(
            nodes=self.mesh.vertices,
            tets=self.mesh.tets,
            clamped=self.clamped,
            young_pa=np.array([environment.young_pa for environment in chosen]),
            poisson=self.scene.material.poisson,
            depths_m=np.stack([environment.course for environment in chosen], axis=1),
            body_vertices=surface.vertices,
            body_faces=surface.faces,
            touch_m=touch_m,
            distance_m=distance_m,
            resistance=load_n / int(beneath.sum()) / (_BARRIER_FORCE * distance_m**3),
            tolerance=tolerance,
        )


def _row(
    pad: PeerPad, *, count: int, tolerance: PeerTolerance, process: PeerProcess, exact_n: float
) -> PeerRow:
    cylinder = pad.scene.indenter
    if not isinstance(cylinder, Cylinder):
        raise ConfigError("libuipc is given cylinders only here", remedy="press a cylinder")
    blank = PeerRow(
        mesh=pad.kind.value,
        tolerance=tolerance.name,
        environments=count,
        tet_count=len(pad.mesh.tets),
        unknown_count=3 * int((~pad.clamped).sum()),
    )
    task = pad.task(cylinder, count, tolerance, exact_n)
    try:
        found = process.press(task, limit_s=_LIMIT_S)
    except PeerFailedError as error:
        return replace(blank, failure=error.message)
    balance = peer_balance(pad.mesh, task, found, cylinder)
    return replace(
        blank,
        version=found.version,
        set_up_s=found.set_up_s,
        wall_s=min(found.press_s),
        newton_iterations=float(np.mean(found.newton_iterations or [np.nan])),
        force_error=balance.force_n / exact_n - 1.0,
        balance=balance,
        problems=found.problems,
    )
