"""The gel's own weight, as an energy of the nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.arrays import FloatArray
from sim.solve.dynamics.nodal_mass import weighing_masses
from sim.solve.model import Model
from tacauchy_rig.errors import ConfigError

STANDARD_M_S2 = 9.80665


@dataclass(frozen=True, slots=True, kw_only=True)
class Weight:
    """A constant force on every node.

    Attributes:
        forces_n: Shape [node_count, 3].
        rest_m: Where the energy is zero, shape [node_count, 3].
    """

    forces_n: FloatArray
    rest_m: FloatArray

    def energy(self, positions: FloatArray) -> float:
        """Return minus the work of the weight since rest [J]."""
        return -float(np.sum(self.forces_n * (positions - self.rest_m)))

    def gradient(self, positions: FloatArray) -> FloatArray:
        """Return minus the weight [N], shape [node_count, 3], wherever the nodes are."""
        return np.broadcast_to(-self.forces_n, positions.shape)

    def diagonal(self) -> FloatArray:
        """Return zero [N/m], shape [node_count, 3]."""
        return np.zeros_like(self.forces_n)


def weight(
    model: Model,
    density_kg_m3: float | FloatArray,
    *,
    acceleration_m_s2: tuple[float, float, float] = (0.0, 0.0, -STANDARD_M_S2),
) -> Weight:
    """Return the weight of a pad.

    Args:
        model: The pad.
        density_kg_m3: One number, or one for each tetrahedron.
        acceleration_m_s2: Free fall in the pad's frame: -z for a sensor that looks up.

    Raises:
        ConfigError: The weight pulls across a plane of symmetry of a mesh of a part.
    """
    symmetry = model.mesh.symmetry
    if (symmetry.mirror_x and acceleration_m_s2[0]) or (symmetry.mirror_y and acceleration_m_s2[1]):
        raise ConfigError(
            f"weight along {acceleration_m_s2} m/s2 breaks the symmetry by which the pad is "
            "modelled in part",
            remedy="let the weight act along z, or mesh the whole pad",
        )
    masses = weighing_masses(model, density_kg_m3)
    return Weight(forces_n=np.outer(masses, acceleration_m_s2), rest_m=model.nodes)
