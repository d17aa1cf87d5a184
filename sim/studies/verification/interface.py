"""Does the interface of a layered gel carry traction continuously?"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from sim.effects.presets import build_model
from sim.fields.interface import InterfaceTraction, interface_traction
from sim.press import press
from sim.press_command import scene_from
from sim.scene.scene import Scene
from sim.studies.verification.prose import stated
from tacauchy_rig.errors import ConvergenceError
from tacauchy_rig.tables import Table, table_of

REFINEMENTS = (1.0, 2.0, 3.0)
NODAL_ALLOWED = 1e-6
SUM_ALLOWED = 0.02
PRESS = "--sensor 9dtact --indenter sphere:diameter=8mm --depth 0.4mm --preset fast"


@dataclass(frozen=True, slots=True, kw_only=True)
class InterfacePress:
    """One press of the 9DTact and what goes through the interface of its layers.

    Attributes:
        refinement: Edges are this many times shorter than the preset's.
        force_n: F_z on the indenter [N].
    """

    refinement: float
    node_count: int
    force_n: float
    interface: InterfaceTraction

    @property
    def sums_relative(self) -> tuple[float, float]:
        """Integrals of sigma n from below and from above over F_z, less one."""
        found = self.interface
        below, above = (force[2] for force in found.smooth.forces_n)
        return float(below / self.force_n) - 1.0, float(above / self.force_n) - 1.0


def interface_press(scene: Scene, *, refinement: float) -> InterfacePress:
    """Press on one mesh.

    Raises:
        ConvergenceError: There is no equilibrium.
    """
    result = press(scene, model=build_model(scene, refinement=refinement))
    if result.point is None:
        raise ConvergenceError("the press ended without a state", remedy="press to a depth")
    (interface,) = interface_traction(result.model, result.point.state.positions)
    return InterfacePress(
        refinement=refinement,
        node_count=result.node_count,
        force_n=result.force_n[2],
        interface=interface,
    )


def measure(*, refinements: tuple[float, ...] = REFINEMENTS) -> Table:
    """Press on ever finer meshes and compare the two sides."""
    scene = scene_from(PRESS)
    found = [interface_press(scene, refinement=factor) for factor in refinements]
    nodal = max(row.interface.recovered_jump_relative for row in found)
    jumps = [
        (row.interface.smooth.jump_relative, row.interface.element.jump_relative) for row in found
    ]
    shrinks = all(fine[k] < coarse[k] for coarse, fine in pairwise(jumps) for k in range(2))
    sums = max(abs(value) for value in found[-1].sums_relative)
    return table_of(
        found,
        {
            "edges of the preset over": lambda row: row.refinement,
            "nodes": lambda row: row.node_count,
            "F_z [N]": lambda row: row.force_n,
            "nodal tractions, above against below": lambda row: (
                row.interface.recovered_jump_relative
            ),
            "integral of sigma n below over F_z, less 1": lambda row: row.sums_relative[0],
            "above": lambda row: row.sums_relative[1],
            "jump of sigma n, continuous in each layer": lambda row: (
                row.interface.smooth.jump_relative
            ),
            "jump of sigma n, each element's own": lambda row: row.interface.element.jump_relative,
        },
        **stated("interface", nodal=NODAL_ALLOWED, sum=SUM_ALLOWED),
        passed=nodal < NODAL_ALLOWED and sums < SUM_ALLOWED and shrinks,
        command=f"tacauchy-rig press {PRESS}",
    )
