"""Further energies of the nodes: weight, inertia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.device import Device
from sim.solve.descent_state import Pull
from tacauchy_rig.core.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Potential:
    """k |x - x0|^2 / 2 - F . (x - x0), summed over the nodes.

    Attributes:
        stiffness_n_m: k, shape [node_count].
        force_n: F, shape [node_count, 3].
        towards_m: x0, shape [node_count, 3].
    """

    stiffness_n_m: FloatArray
    force_n: FloatArray
    towards_m: FloatArray

    def energy(self, positions: FloatArray) -> float:
        """Return the energy at nodal positions [m], shape [node_count, 3]; [J]."""
        away = positions - self.towards_m
        drawn = 0.5 * self.stiffness_n_m[:, None] * away - self.force_n
        return float(np.sum(drawn * away))

    def gradient(self, positions: FloatArray) -> FloatArray:
        """Return its gradient [N], shape [node_count, 3]."""
        away = positions - self.towards_m
        return np.asarray(self.stiffness_n_m[:, None] * away - self.force_n)

    def diagonal(self) -> FloatArray:
        """Return its stiffness [N/m], shape [node_count, 3]."""
        return np.tile(self.stiffness_n_m[:, None], (1, 3))


def pull_of(potentials: Sequence[Potential], device: Device) -> Any:
    """Return the sum of energies for the kernels; one of them at most is stiff."""
    if not potentials:
        return device.zeroed(Pull, (1,))
    (stiff,) = [each for each in potentials if each.stiffness_n_m.any()] or potentials[:1]
    forced = [each for each in potentials if each.force_n.any()] or [stiff]
    (rest,) = {id(each.towards_m): each.towards_m for each in forced}.values()
    force = np.sum([each.force_n for each in forced], axis=0)
    parts = {
        "stiffness": stiff.diagonal(),
        "towards": stiff.towards_m,
        "force": force,
        "rest": rest,
    }
    return device.tables(Pull, {name: each.reshape(-1) for name, each in parts.items()})
