"""Coulomb friction of the emulated gel: springs along the tip that slip at their limit.

Each point in contact hangs on the tip by a stiff spring along the surface. Drawn beyond friction
times pressure it slips. Pressure and direction are those of the round before, so that the springs
have an energy (that of Huber) and Newton's method a line search.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacauchy_rig.core.arrays import FloatArray

STICK_PER_M = 5e5
"""Times Young's modulus: what sticks creeps by tenths of a micrometre."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Grip:
    """Where the surface was when the tip last stood still.

    Attributes:
        points: (r, z) of its points from the tip [m], shape [point_count, 2].
        pull: Along the tip, over Young's modulus, on the tip, likewise; zero out of contact.
        pressure: Likewise, shape [point_count].
    """

    points: FloatArray
    pull: FloatArray
    pressure: FloatArray


class Springs:
    """The springs of one round.

    Args:
        before: Where the surface was; None begins without any pull.
        points: (r, z) of the surface's points from the tip now [m], shape [point_count, 2].
        normal: Out of the tip, likewise.
        limit: Largest pull over Young's modulus, shape [point_count].
    """

    def __init__(
        self, before: Grip | None, points: FloatArray, normal: FloatArray, limit: FloatArray
    ) -> None:
        begun = before or Grip(points=points, pull=np.zeros_like(points), pressure=limit)
        self.along = np.stack([-normal[:, 1], normal[:, 0]], axis=-1)
        self._begin = begun.points
        self._pull = np.einsum("pi,pi->p", begun.pull, self.along)
        self.limit = limit

    def sticks(self, points: FloatArray) -> FloatArray:
        """Return one for each point that is in contact and does not slip, else zero."""
        return np.asarray(np.abs(self._trial(points)) < self.limit, dtype=np.float64)

    def energy(self, points: FloatArray) -> FloatArray:
        """Return the energy over Young's modulus [m], shape [point_count]."""
        size = np.abs(self._trial(points))
        kept = np.minimum(size, self.limit)
        return np.asarray(kept * (size - 0.5 * kept) / STICK_PER_M)

    def linearised(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the pull [point_count, 2] and its derivative [1/m], [point_count, 2, 2]."""
        pull = np.clip(self._trial(points), -self.limit, self.limit)
        stiffness = STICK_PER_M * self.sticks(points)
        square = self.along[:, :, None] * self.along[:, None, :]
        return pull[:, None] * self.along, stiffness[:, None, None] * square

    def drawn(self, points: FloatArray, pressure: FloatArray) -> Grip:
        """Return what the next press begins with."""
        return Grip(points=points, pull=self.linearised(points)[0], pressure=pressure)

    def _trial(self, points: FloatArray) -> FloatArray:
        moved = np.einsum("pi,pi->p", points - self._begin, self.along)
        return np.asarray(self._pull + STICK_PER_M * moved)
