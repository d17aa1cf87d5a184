"""Does a press balance, and does the interface of a layered gel carry traction continuously?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse.linalg
from numpy.typing import NDArray

from sim.effects.presets import build_model
from sim.fields.interface import (
    InterfaceTraction,
    StressOnSides,
    interface_traction,
    nodal_forces,
    on_sides,
)
from sim.fields.stress import recovered_stress
from sim.mesh.discretisation import assembled
from sim.press import press
from sim.press_command import scene_from
from sim.scene.scene import Scene
from sim.solve.model import Model
from sim.studies.verification import section
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.tables import Table

_LIMIT = 1e-6
REFINEMENTS = (1.0, 1.5)
# Headings of what is judged.
BASE, LOAD, GAP = "indenter and base", "indenter and load", "smallest gap [um]"
TRACTION_GAPS = [f"surface_traction_gap_relative, edges 1/{factor:g}" for factor in REFINEMENTS]
_GEL = "--pad box:20x24x4mm --young 0.4MPa --poisson 0.48 --preset fast"
_PRESSES = {
    "sharp punch to a depth": "--indenter cylinder:diameter=5mm --depth 0.2mm",
    "sharp punch to a load": "--indenter cylinder:diameter=5mm --force 1N",
    "filleted punch to a load": "--indenter cylinder:diameter=5mm,fillet=0.1mm --force 1N",
    "ball to a load": "--indenter sphere:diameter=8mm --force 0.4N",
    "bonded ball": "--indenter sphere:diameter=8mm --depth 0.2mm --contact bonded",
    "ball with friction 0.5": "--indenter sphere:diameter=8mm --depth 0.2mm "
    "--contact friction:0.5 --effect friction=on",
}
_SCENES = {name: scene_from(f"{_GEL} {words}") for name, words in _PRESSES.items()}
_SCENES["ball on two layers"] = scene_from(
    "--pad box:20x24x4mm --layer share=0.75,young=0.1MPa,poisson=0.46 "
    "--layer share=0.25,young=0.4MPa,poisson=0.46 --indenter sphere:diameter=8mm --depth 0.2mm "
    "--preset fast"
)


def balanced_press(scene: Scene) -> dict[str, float | None]:
    """Press a scene on its own mesh and on a finer one; count its force in four ways.

    Returns:
        By the table's headings: F_z [N]; force + base reaction and force - load, over the force,
        the latter None where a depth was asked for; surface_traction_gap_relative on both meshes;
        the smallest gap [um].
    """
    results = [press(scene, model=build_model(scene, refinement=factor)) for factor in REFINEMENTS]
    load = scene.target.force_n
    off_load = [abs(result.force_n[2] / load - 1.0) for result in results] if load else [None]
    gaps = [result.surface_traction_gap_relative for result in results]
    return {
        "F_z [N]": results[0].force_n[2],
        BASE: max(result.force_balance_relative for result in results),
        LOAD: max(off_load, key=lambda off: off or 0.0),
        **dict(zip(TRACTION_GAPS, gaps, strict=True)),
        GAP: 1e6 * min(result.gap_min_m for result in results),
    }


def is_balanced(row: Mapping[str, float | None]) -> bool:
    """Indenter, base and load agree to 1e-6, and nothing overlaps."""
    return max(row[BASE] or 0.0, row[LOAD] or 0.0) < _LIMIT and (row[GAP] or 0.0) > 0.0


def measure() -> Table:
    """Press the scenes and compare."""
    found = {name: balanced_press(scene) for name, scene in _SCENES.items()}
    worst = [max(row[name] or 0.0 for row in found.values()) for name in TRACTION_GAPS]
    rows = [{"press": name, **row} for name, row in found.items()]
    passed = all(map(is_balanced, found.values())) and worst[-1] < worst[0]
    words = f"{_GEL} {_PRESSES['sharp punch to a load']}"
    return section("balance", rows, passed=passed, press=words, worst=worst)


INTERFACE_REFINEMENTS = (1.0, 2.0, 3.0)
NODAL_ALLOWED = 1e-6
SUM_ALLOWED = 0.02
PRESS = "--sensor 9dtact --indenter sphere:diameter=8mm --depth 0.4mm --preset fast"
# Headings of what is judged; BELOW and ABOVE: integrals of sigma n.
NODAL = "nodal tractions, above against below"
BELOW, ABOVE = "integral of sigma n below over F_z, less 1", "above"
JUMPS = ("jump of sigma n, continuous in each layer", "jump of sigma n, each element's own")


def interface_row(scene: Scene, *, refinement: float) -> dict[str, float]:
    """Press on one mesh, and return the numbers of its interface by the table's headings.

    Raises:
        ConvergenceError: There is no equilibrium.
    """
    result = press(scene, model=build_model(scene, refinement=refinement))
    model, positions = result.model, result.point.state.positions
    (interface,) = interface_traction(model, positions)
    found = interface_sides(model, positions, interface)
    integrals = forces_n(model, found.smooth)
    jumps = found.smooth.jump_relative, interface.element.jump_relative
    below, above = (float(force[2] / result.force_n[2]) - 1.0 for force in integrals)
    return {
        "edges of the preset over": refinement,
        "nodes": result.node_count,
        "F_z [N]": result.force_n[2],
        NODAL: found.recovered_jump_relative,
        BELOW: below,
        ABOVE: above,
        **dict(zip(JUMPS, jumps, strict=True)),
    }


def measure_interface(*, refinements: tuple[float, ...] = INTERFACE_REFINEMENTS) -> Table:
    """Press on ever finer meshes and compare the two sides."""
    scene = scene_from(PRESS)
    rows = [interface_row(scene, refinement=factor) for factor in refinements]
    shrinks = all(fine[name] < coarse[name] for coarse, fine in pairwise(rows) for name in JUMPS)
    sums = max(abs(rows[-1][name]) for name in (BELOW, ABOVE))
    passed = max(row[NODAL] for row in rows) < NODAL_ALLOWED and sums < SUM_ALLOWED and shrinks
    allowed = {"nodal": NODAL_ALLOWED, "sum": SUM_ALLOWED}
    return section("interface", rows, passed=passed, press=PRESS, **allowed)


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
