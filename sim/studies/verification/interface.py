"""Does the interface of a layered gel carry traction continuously?"""

from __future__ import annotations

from itertools import pairwise

from sim.effects.presets import build_model
from sim.fields.interface import interface_traction
from sim.press import press
from sim.press_command import scene_from
from sim.scene.scene import Scene
from sim.studies.verification.interface_sides import forces_n, interface_sides
from sim.studies.verification.prose import stated
from tacauchy_rig.core.tables import Table, table_of_rows

REFINEMENTS = (1.0, 2.0, 3.0)
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


def measure(*, refinements: tuple[float, ...] = REFINEMENTS) -> Table:
    """Press on ever finer meshes and compare the two sides."""
    scene = scene_from(PRESS)
    rows = [interface_row(scene, refinement=factor) for factor in refinements]
    shrinks = all(fine[name] < coarse[name] for coarse, fine in pairwise(rows) for name in JUMPS)
    sums = max(abs(rows[-1][name]) for name in (BELOW, ABOVE))
    return table_of_rows(
        rows,
        passed=max(row[NODAL] for row in rows) < NODAL_ALLOWED and sums < SUM_ALLOWED and shrinks,
        command=f"tacauchy-rig press {PRESS}",
        **stated("interface", nodal=NODAL_ALLOWED, sum=SUM_ALLOWED),
    )
