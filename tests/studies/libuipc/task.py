"""What libuipc's process is given and gives back: plain arrays, so that they pass between both."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tacauchy_rig.core.arrays import FloatArray, IntArray

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
# Of steps of 1, 0.1 and 0.01 um the one at which it balances best: 3.3 % where shipped settings
# leave 23 %, and 3.6 % at a sixth of the speed (docs/results/benchmarks/index.md).
STRICT = PeerTolerance(name="step 1 um", step_m=1e-6, residual_rate=1e-4)


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerTask:
    """Presses of one pad by one rigid body, side by side in one libuipc scene.

    Attributes:
        nodes: Of a pad at rest [m], shape [node_count, 3].
        tets: Shape [tet_count, 4].
        clamped: Nodes on the base, shape [node_count].
        shear_pa: Of the law's m, of every tetrahedron of every environment [Pa], shape [count,
            tet_count].
        bulk_pa: Of its l, likewise.
        start: Of the indenters at first touch, as 4 x 4 transforms [m], shape [count, 4, 4].
        poses: Likewise in every frame, shape [frame_count, count, 4, 4].
        body_vertices: Of the indenter, its tip at the origin [m], shape [n, 3].
        body_faces: Turned outwards, shape [m, 3].
        distance_m: d_hat [m].
        resistance: libuipc's kappa [Pa/m^2]: energy kappa (d^2 - d_hat^2)^2 ln (d_hat/d)^2 of every
            pair that touches.
        friction: Coulomb coefficient mu.
        slip_m: Way along the indenter in a frame at which sticking has become sliding [m].
        press_count: Timed presses at most; one more goes before.
    """

    nodes: FloatArray
    tets: IntArray
    clamped: NDArray[np.bool_]
    shear_pa: FloatArray
    bulk_pa: FloatArray
    start: FloatArray
    poses: FloatArray
    body_vertices: FloatArray
    body_faces: IntArray
    distance_m: float
    resistance: float
    friction: float
    slip_m: float
    tolerance: PeerTolerance
    press_count: int = 3

    @property
    def count(self) -> int:
        """Environments."""
        return len(self.start)

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
        set_up_s: Scene and the press before the timed ones, with loading of kernels [s].
        press_s: Every timed press: time of the wall and of the processor [s].
        newton_iterations: Of every frame of the first press; empty where libuipc does not say.
        positions: Nodes at the last frame, in their pad's frame [m], [count, node_count, 3].
        tips_m: Of the indenters then, in the same frame [m], shape [count, 3].
        contact_n: Force of contact on every node then [N], shape [count, node_count, 3]; None where
            libuipc does not say.
        problems: What did not work, in words.
    """

    set_up_s: float
    press_s: tuple[tuple[float, float], ...]
    newton_iterations: tuple[int, ...]
    positions: FloatArray
    tips_m: FloatArray
    contact_n: FloatArray | None
    problems: tuple[str, ...] = field(default=())
