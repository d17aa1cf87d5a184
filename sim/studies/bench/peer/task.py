"""What libuipc's process is given and gives back: plain arrays, so that they pass between both."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray, IntArray

# Time of a frame [s], libuipc's default. It does not matter: mass is as good as none.
FRAME_S = 0.01
_NEWTON_MAX = 200
# Pads lie so far apart, in units of their largest extent.
_APART = 2.5


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerTolerance:
    """Where libuipc's Newton iterations end.

    Attributes:
        name: For the table.
        step_m: Largest coordinate of the last Newton step [m]; None leaves every setting as it
            comes, so that a frame may also end when a sixth step has been taken in full.
        residual_rate: By how much conjugate gradients lower the squared, preconditioned residual.
    """

    name: str
    step_m: float | None = None
    residual_rate: float | None = None

    def settings(self) -> dict[str, dict[str, object]]:
        """Return what differs from libuipc's default configuration."""
        if self.step_m is None:
            return {}
        return {
            "newton": {
                "max_iter": _NEWTON_MAX,
                "velocity_tol": self.step_m / FRAME_S,
                "semi_implicit": {"enable": 0},
            },
            "linear_system": {"tol_rate": self.residual_rate},
        }


AS_SHIPPED = PeerTolerance(name="as shipped")
# From loose to strict; the loosest that balances as well as ours is the one that times are
# compared at.
LADDER = (
    PeerTolerance(name="step 1 um", step_m=1e-6, residual_rate=1e-4),
    PeerTolerance(name="step 0.1 um", step_m=1e-7, residual_rate=1e-6),
    PeerTolerance(name="step 0.01 um", step_m=1e-8, residual_rate=1e-8),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerTask:
    """Presses of one pad by one rigid body, side by side in one libuipc scene.

    Attributes:
        nodes: Of a pad at rest [m], shape [node_count, 3].
        tets: Shape [tet_count, 4].
        clamped: Nodes on the base, shape [node_count].
        young_pa: Of every environment [Pa], shape [count].
        poisson: Of all.
        depths_m: Below first touch [m], shape [frame_count, count].
        body_vertices: Of the indenter, its tip at the origin [m], shape [n, 3].
        body_faces: Turned outwards, shape [m, 3].
        touch_m: Height of the tip at first touch [m].
        distance_m: d_hat [m].
        resistance: libuipc's kappa [Pa/m^2]: energy kappa (d^2 - d_hat^2)^2 ln (d_hat/d)^2 of every
            pair that touches.
        press_count: Timed presses; one more goes before.
    """

    nodes: FloatArray
    tets: IntArray
    clamped: NDArray[np.bool_]
    young_pa: FloatArray
    poisson: float
    depths_m: FloatArray
    body_vertices: FloatArray
    body_faces: IntArray
    touch_m: float
    distance_m: float
    resistance: float
    tolerance: PeerTolerance
    press_count: int = 3

    @property
    def count(self) -> int:
        """Environments."""
        return len(self.young_pa)

    @property
    def origins_m(self) -> FloatArray:
        """Where every environment's pad lies [m], shape [count, 3]: on a square grid."""
        columns = int(np.ceil(np.sqrt(self.count)))
        pitch = _APART * float(np.ptp(self.nodes, axis=0).max())
        number = np.arange(self.count)
        x, y = (
            pitch * (place - 0.5 * (columns - 1)) for place in (number % columns, number // columns)
        )
        return np.column_stack([x, y, np.zeros(self.count)])


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerFound:
    """What libuipc gave.

    Attributes:
        version: Of libuipc.
        set_up_s: Scene and the press before the timed ones, with loading of kernels [s].
        press_s: Every timed press [s].
        newton_iterations: Of every frame of the first press; empty where libuipc does not say.
        linear_iterations: Of its conjugate gradients, likewise.
        positions: Nodes at the last frame, in their pad's frame [m], [count, node_count, 3].
        tips_m: Height of the indenters' tips then [m], shape [count].
        contact_n: Force of contact on every node then [N], shape [count, node_count, 3]; None where
            libuipc does not say.
        problems: What did not work, in words.
    """

    version: str
    set_up_s: float
    press_s: tuple[float, ...]
    newton_iterations: tuple[int, ...]
    linear_iterations: tuple[int, ...]
    positions: FloatArray
    tips_m: FloatArray
    contact_n: FloatArray | None
    problems: tuple[str, ...] = field(default=())
