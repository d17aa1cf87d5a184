"""How exactly libuipc is asked to solve a frame: as it comes, or more and more strictly."""

from __future__ import annotations

from dataclasses import dataclass

# Time of a frame [s], libuipc's default. It does not matter: mass is as good as none.
FRAME_S = 0.01
_NEWTON_MAX = 200


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
