"""The legs of a loading path: each moves the indenter along one growing or falling parameter."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from sim.arrays import FloatArray

_DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """The indenter's tip [m], shape [3], and rotation to the pad's frame, shape [3, 3]."""

    tip: FloatArray
    rotation: FloatArray


class Leg(Protocol):
    """One parameter from ``start`` to ``end``; ``exact`` is how closely the end is met."""

    @property
    def start(self) -> float:
        """First value."""
        ...

    @property
    def end(self) -> float:
        """Last value."""
        ...

    @property
    def exact(self) -> float:
        """Difference from the end that counts as none."""
        ...

    @property
    def goal(self) -> str:
        """What is to be reached, for messages."""
        ...

    @property
    def holds_force(self) -> bool:
        """F_z stays the same, and the depth answers."""
        ...

    def is_short_of(self, at: float) -> bool:
        """Return whether ``at`` is not the end yet."""
        ...

    def longest(self, stiffness_n_m: float) -> float:
        """Return the longest step of the parameter; dF_z / d(depth) is given [N/m]."""
        ...

    def rate(self, stiffness_n_m: float) -> tuple[FloatArray, FloatArray]:
        """Return velocity [m/unit] and spin [rad/unit] of the indenter, shape [3] each."""
        ...

    def turned(self, rotation: FloatArray, advance: float) -> FloatArray:
        """Return the rotation after a step."""
        ...

    def load_at(self, at: float) -> float | None:
        """Return the force that is to be carried there [N]; None where the depth is given."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthLeg:
    """Straight down to a depth [m]."""

    start: float
    end: float
    touch_m: float
    step_max_m: float
    exact: float = 1e-14
    holds_force: bool = False

    @property
    def goal(self) -> str:
        """What is to be reached, for messages."""
        return f"{self.end * 1e3:.4f} mm"

    def is_short_of(self, at: float) -> bool:
        """Return whether ``at`` is not the end yet."""
        return abs(self.end - at) > self.exact

    def longest(self, stiffness_n_m: float) -> float:  # noqa: ARG002 - a depth is a depth
        """Return the longest step [m]."""
        return self.step_max_m

    def rate(self, stiffness_n_m: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """Return velocity and spin a metre of depth."""
        return _DOWN, np.zeros(3)

    def turned(self, rotation: FloatArray, advance: float) -> FloatArray:  # noqa: ARG002
        """Return the rotation unchanged."""
        return rotation

    def load_at(self, at: float) -> float | None:  # noqa: ARG002
        """Return None: the depth is given."""
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceLeg:
    """Straight down until a force F_z [N] is carried."""

    start: float
    end: float
    step_max_m: float
    holds_force: bool = False

    @property
    def exact(self) -> float:
        """Difference from the end that counts as none [N]."""
        return 1e-12 * abs(self.end)

    @property
    def goal(self) -> str:
        """What is to be reached, for messages."""
        return f"{self.end:.4f} N"

    def is_short_of(self, at: float) -> bool:
        """Return whether ``at`` is not the end yet."""
        return abs(self.end - at) > self.exact

    def longest(self, stiffness_n_m: float) -> float:
        """Return the longest step [N]: the force of the longest advance."""
        return max(stiffness_n_m * self.step_max_m, 1e-3 * self.end)

    def rate(self, stiffness_n_m: float) -> tuple[FloatArray, FloatArray]:
        """Return velocity and spin a newton."""
        return _DOWN / max(stiffness_n_m, 1e-30), np.zeros(3)

    def turned(self, rotation: FloatArray, advance: float) -> FloatArray:  # noqa: ARG002
        """Return the rotation unchanged."""
        return rotation

    def load_at(self, at: float) -> float | None:
        """Return the force itself."""
        return at


@dataclass(frozen=True, slots=True, kw_only=True)
class CarryLeg:
    """Along the pad and about z, from 0 to 1.

    Attributes:
        origin: Pose at its start.
        shift_m: Whole translation [m], shape [3].
        twist_rad: Whole turn about z through the tip [rad].
        load_n: F_z to keep [N]; None keeps the depth.
        radius_m: Radius of the contact [m], which turns an angle into a travel.
    """

    origin: Pose
    shift_m: FloatArray
    twist_rad: float
    load_n: float | None
    step_max_m: float
    radius_m: float
    start: float = 0.0
    end: float = 1.0
    exact: float = field(default=1e-9)

    @property
    def holds_force(self) -> bool:
        """F_z stays the same, and the depth answers."""
        return self.load_n is not None

    @property
    def goal(self) -> str:
        """What is to be reached, for messages."""
        x, y, _ = self.shift_m * 1e3
        return f"a shift of ({x:.4f}, {y:.4f}) mm and {np.degrees(self.twist_rad):.3f} deg"

    def is_short_of(self, at: float) -> bool:
        """Return whether ``at`` is not the end yet."""
        return abs(self.end - at) > self.exact

    def longest(self, stiffness_n_m: float) -> float:  # noqa: ARG002
        """Return the longest step: the one in which a point of the rim goes ``step_max_m``."""
        travel = float(np.linalg.norm(self.shift_m)) + abs(self.twist_rad) * self.radius_m
        return min(1.0, self.step_max_m / max(travel, 1e-30))

    def rate(self, stiffness_n_m: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """Return velocity and spin over the whole leg."""
        return self.shift_m, np.array([0.0, 0.0, self.twist_rad])

    def turned(self, rotation: FloatArray, advance: float) -> FloatArray:
        """Return the rotation after a step about the pad's z."""
        angle = self.twist_rad * advance
        c, s = np.cos(angle), np.sin(angle)
        return np.asarray(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ rotation)

    def load_at(self, at: float) -> float | None:  # noqa: ARG002
        """Return the force that is kept."""
        return self.load_n
