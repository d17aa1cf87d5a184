"""What changes during a press, the settings of contact, and what contact gives."""

from __future__ import annotations

from dataclasses import dataclass

from sim.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactOptions:
    """Numerical settings of contact.

    Attributes:
        distance_m: d_hat [m]: the gel feels the indenter from here on.
        stiffness_factor: kappa in units of E d_hat.
        bonded: Points that touch stick to the indenter.
    """

    distance_m: float = 1.0e-5
    stiffness_factor: float = 8.0
    bonded: bool = False


@dataclass(slots=True, kw_only=True)
class State:
    """What changes during a press.

    Attributes:
        positions: Deformed nodes [m], shape [node_count, 3].
        tip: The indenter's tip [m], shape [3].
        rotation: Indenter frame to pad frame, shape [3, 3].
        anchored: Which contact points are bonded, shape [face_count, point_count].
        anchors: Where on the indenter, in its frame [m], shape [face_count, point_count, 3].
        extension: Share of d_hat below which the barrier is a parabola.
    """

    positions: FloatArray
    tip: FloatArray
    rotation: FloatArray
    anchored: IntArray
    anchors: FloatArray
    extension: float = 0.3

    def copy(self) -> State:
        """Return an independent copy."""
        return State(
            positions=self.positions.copy(),
            tip=self.tip.copy(),
            rotation=self.rotation.copy(),
            anchored=self.anchored.copy(),
            anchors=self.anchors.copy(),
            extension=self.extension,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactForces:
    """Contact at every quadrature point of the surface, shape [face_count, point_count, ...].

    Attributes:
        points: Positions [m].
        forces: Force on the indenter [N].
        stiffness: Derivative of that force by the point's motion [N/m].
    """

    points: FloatArray
    forces: FloatArray
    stiffness: FloatArray
