"""What changes during a press, the settings of contact, and what contact gives."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass

from tacauchy_rig.core.arrays import FloatArray

# A height map takes what is no farther from the indenter for touching.
_OVERLOOKED_M = 5e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactOptions:
    """Settings of contact."""

    distance_m: float = 1.0e-5  # d_hat [m]: the barrier acts from here on
    bonded: bool = False
    friction: float = 0.0  # Coulomb coefficient mu; zero without friction
    slip_m: float = 1.0e-6  # tangential offset at which sticking has become sliding [m]
    # Share of d_hat below which the barrier is a parabola, at most. At 1 it is one altogether,
    # which Newton likes best, and gaps stay positive while the pressure is below kappa / d_hat.
    extension: float = 0.5
    stiffness: float = 8.0  # kappa over E d_hat
    # By how many times d_hat a point may overlap where the barrier is a parabola altogether
    overlap: float = 0.0

    @property
    def is_tangential(self) -> bool:
        """Points that touch resist motion along the indenter."""
        return self.bonded or self.friction > 0.0

    @property
    def is_wide(self) -> bool:
        """The gel stays about d_hat off the indenter, and that is too far to be overlooked."""
        return self.extension >= 1.0 and self.distance_m > _OVERLOOKED_M

    def gap_least_m(self, extension: float) -> float:
        """Return the gap below which a point needs a barrier that is extended less [m]."""
        return (extension if extension < 1.0 else -self.overlap) * self.distance_m


@dataclass(slots=True, kw_only=True)
class Grip:
    """What tangential contact remembers of every contact point, shape [face_count, point_count]."""

    # 1 where a point touches, or, while a step is under way in which it came to, the share of its
    # path that it has touched for; 0 where it is free
    held: FloatArray
    # Where on the indenter it holds on, in the indenter's frame [m], shape [..., 3]; where it was
    # last, for one that is free
    anchors: FloatArray
    # Lagged contact pressure along the indenter's normal, in its frame [Pa], shape [..., 3]
    loads: FloatArray


@dataclass(slots=True, kw_only=True)
class State:
    """What changes during a press."""

    positions: FloatArray  # deformed nodes [m], shape [node_count, 3]
    tip: FloatArray  # the indenter's tip [m], shape [3]
    rotation: FloatArray  # indenter frame to pad frame, shape [3, 3]
    grip: Grip | None = None
    extension: float = 0.3  # share of d_hat below which the barrier is a parabola

    def copy(self) -> State:
        """Return an independent copy."""
        return deepcopy(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactForces:
    """Contact at every quadrature point of the surface, shape [face_count, point_count, ...]."""

    points: FloatArray  # positions [m]
    gaps: FloatArray  # from there to the indenter [m]
    forces: FloatArray  # force on the indenter [N]
    stiffness: FloatArray  # derivative of that force by the point's motion [N/m]
