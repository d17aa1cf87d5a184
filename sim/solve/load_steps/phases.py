"""The phases of a loading path: each moves the indenter along one growing or falling parameter."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from tacauchy_rig.core.arrays import FloatArray

DOWN = np.array([0.0, 0.0, -1.0])
STILL = np.zeros(3)
# What is as good as no stiffness [N/m], or no travel [m]: it keeps quotients finite.
_NOTHING = 1e-30
# A push's steps are at least this share of its force, also where the gel hardly resists.
_FORCE_STEP_MIN_SHARE = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Phase(ABC):
    """One parameter from ``start`` to ``end``.

    Attributes:
        goal: What is to be reached, for messages.
        exact: Difference from the end that counts as none.
        step_max_m: Longest way of a point of the indenter in one step [m].
        load_n: F_z to keep, while the depth answers [N]; None keeps or changes the depth.
        twist_rad: Turn about z through the tip for one of the parameter [rad].
    """

    start: float
    end: float
    goal: str
    exact: float
    step_max_m: float
    load_n: float | None = None
    twist_rad: float = 0.0

    @property
    def direction(self) -> tuple[object, ...]:
        """Where it leads: phases alike in it go on from one another."""
        return type(self), self.end > self.start

    def is_short_of(self, at: float) -> bool:
        """Return whether ``at`` is not the end yet."""
        return abs(self.end - at) > self.exact

    @abstractmethod
    def longest(self, stiffness_n_m: float) -> float:
        """Return the longest step of the parameter; dF_z / d(depth) is given [N/m]."""

    @abstractmethod
    def rate(self, stiffness_n_m: float) -> tuple[FloatArray, FloatArray]:
        """Return velocity [m/unit] and spin [rad/unit] of the indenter, shape [3] each."""

    def turned(self, rotation: FloatArray, advance: float) -> FloatArray:
        """Return the rotation after a step about the pad's z."""
        angle = self.twist_rad * advance
        c, s = np.cos(angle), np.sin(angle)
        return np.asarray(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ rotation)

    def load_at(self, at: float) -> float | None:  # noqa: ARG002
        """Return the force that is to be carried there [N]; None where the depth is given."""
        return self.load_n


class DepthPhase(Phase):
    """Straight down to a depth [m]."""

    def longest(self, stiffness_n_m: float) -> float:  # noqa: ARG002 - a depth is a depth
        """Return the longest step [m]."""
        return self.step_max_m

    def rate(self, stiffness_n_m: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """Return velocity and spin a metre of depth."""
        return DOWN, STILL


class ForcePhase(Phase):
    """Straight down until a force F_z [N] is carried."""

    def longest(self, stiffness_n_m: float) -> float:
        """Return the longest step [N]: the force of the longest advance."""
        return max(stiffness_n_m * self.step_max_m, _FORCE_STEP_MIN_SHARE * self.end)

    def rate(self, stiffness_n_m: float) -> tuple[FloatArray, FloatArray]:
        """Return velocity and spin a newton."""
        return DOWN / max(stiffness_n_m, _NOTHING), STILL

    def load_at(self, at: float) -> float | None:
        """Return the force itself."""
        return at


@dataclass(frozen=True, slots=True, kw_only=True)
class CarryPhase(Phase):
    """Along the pad and about z, from 0 to 1.

    Attributes:
        shift_m: Whole translation [m], shape [3].
        radius_m: Radius of the contact [m], which turns an angle into a travel.
    """

    shift_m: FloatArray
    radius_m: float
    start: float = 0.0
    end: float = 1.0
    exact: float = 1e-9

    @property
    def direction(self) -> tuple[object, ...]:
        """Where it leads: phases alike in it go on from one another."""
        return type(self), *self.shift_m.tolist(), self.twist_rad, self.load_n is None

    def longest(self, stiffness_n_m: float) -> float:  # noqa: ARG002
        """Return the longest step: the one in which a point of the rim goes ``step_max_m``."""
        travel = float(np.linalg.norm(self.shift_m)) + abs(self.twist_rad) * self.radius_m
        return min(1.0, self.step_max_m / max(travel, _NOTHING))

    def rate(self, stiffness_n_m: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """Return velocity and spin over the whole phase."""
        return self.shift_m, np.array([0.0, 0.0, self.twist_rad])
