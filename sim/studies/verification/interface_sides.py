"""What goes through an interface by nodal forces and by continuous stress, from either side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse.linalg
from numpy.typing import NDArray

from sim.fields.interface import InterfaceTraction, StressOnSides, nodal_forces, on_sides
from sim.fields.stress_field import recovered_stress
from sim.mesh.sparsity import assembled
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class InterfaceSides:
    """One interface of a deformed gel, from below and from above.

    The recovered traction has the nodal forces of either side as its virtual work, so it is one and
    balances the press.

    Attributes:
        nodes: Nodes of the interface, shape [node_count].
        recovered_pa: Recovered traction on the upper side of the lower layer, shape [node_count,
            3].
        recovered_above_pa: The same from the nodal forces of the layers above; equilibrium of the
            nodes makes the two equal, but for weight.
        smooth: By each layer's stress made continuous within it.
    """

    nodes: IntArray
    recovered_pa: FloatArray
    recovered_above_pa: FloatArray
    smooth: StressOnSides

    @property
    def recovered_jump_relative(self) -> float:
        """Norm over the nodes of the recovered tractions' difference over that of the lower one."""
        size = float(np.linalg.norm(self.recovered_pa))
        jump = float(np.linalg.norm(self.recovered_above_pa - self.recovered_pa))
        return jump / size if size > 0.0 else 0.0


def interface_sides(
    model: Model, positions: FloatArray, interface: InterfaceTraction, *, layer: int = 0
) -> InterfaceSides:
    """Recover the traction on an interface.

    Args:
        positions: Deformed nodes [m], shape [node_count, 3].
        layer: The one below the interface, counted from the base.
    """
    faces, below = interface.faces, interface.below
    nodes, labels = np.unique(faces), np.asarray(model.mesh.layers)

    def smooth(side: NDArray[np.bool_]) -> FloatArray:
        stress = recovered_stress(model, positions, side)[faces[:, :3]]
        return np.asarray(np.einsum("pc,fcij->fpij", model.reference.face_points, stress))

    under, over = (nodal_forces(model, positions, side)[nodes] for side in (below, ~below))
    areas = interface.element.areas_m2
    return InterfaceSides(
        nodes=nodes,
        recovered_pa=_recovered(model, faces, areas, nodes, under),
        recovered_above_pa=_recovered(model, faces, areas, nodes, -over),
        smooth=on_sides(
            model, positions, faces, smooth(labels == layer), smooth(labels == layer + 1)
        ),
    )


def forces_n(model: Model, sides: StressOnSides) -> tuple[FloatArray, FloatArray]:
    """Return the integrals of both tractions over the whole interface [N], shape [3] each."""
    below, above = (
        -model.mesh.symmetry.whole_force(np.einsum("fpi,fp->i", side, sides.areas_m2))
        for side in (sides.below_pa, sides.above_pa)
    )
    return below, above


def _recovered(
    model: Model, faces: IntArray, areas: FloatArray, nodes: IntArray, forces: FloatArray
) -> FloatArray:
    """Return the traction whose virtual work on the faces is that of nodal forces [Pa].

    On a mirror plane its components across the plane are zero.
    """
    values = model.reference.face_values
    local = np.searchsorted(nodes, faces)
    blocks = np.einsum("fp,pi,pj->fij", areas, values, values)
    mass = assembled(blocks, local, len(nodes)).tocsc()
    size = float(np.abs(model.mesh.vertices).max())
    held = model.mesh.symmetry.on_plane(model.nodes[nodes], size)
    traction = np.zeros_like(forces)
    for axis in range(3):
        free = np.flatnonzero(~held[:, axis])
        part = mass[free][:, free]
        traction[free, axis] = scipy.sparse.linalg.spsolve(part, forces[free, axis])
    return traction
