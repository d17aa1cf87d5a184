"""What each tetrahedron of a layered gel is made of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.material.relaxation import PronySeries, prony_series
from sim.mesh.tet_mesh import TetMesh
from sim.scene.material import Material
from tacauchy_rig.errors import ConfigError


def element_constants(
    mesh: TetMesh, materials: Sequence[Material]
) -> tuple[FloatArray, FloatArray]:
    """Return E [Pa] and nu of every tetrahedron, each of shape [tet_count].

    Raises:
        ConfigError: The mesh was not made for as many layers.
    """
    labels = _labels(mesh)
    found = int(labels.max()) + 1
    if found != len(materials):
        raise ConfigError(
            f"mesh {mesh.name!r} has {found} layers, the gel {len(materials)}",
            remedy="mesh the pad again for this gel",
        )
    constants = np.array([(each.young_pa, each.poisson) for each in materials])[labels]
    return constants[:, 0], constants[:, 1]


def prony_of(mesh: TetMesh, materials: Sequence[Material]) -> PronySeries | None:
    """Return how a gel relaxes; None for an elastic one."""
    return prony_series([material.relaxation for material in materials], _labels(mesh))


def densities_of(mesh: TetMesh, materials: Sequence[Material]) -> FloatArray:
    """Return the density of every tetrahedron [kg/m^3], shape [tet_count]."""
    return np.array([material.density_kg_m3 for material in materials])[_labels(mesh)]


def _labels(mesh: TetMesh) -> IntArray:
    """Return the number of every tetrahedron's layer, shape [tet_count]."""
    return np.zeros(len(mesh.tets), dtype=np.int32) if mesh.layers is None else mesh.layers
