"""The states that a press passes, on the mesh of its way: what a time series shows."""

from __future__ import annotations

import numpy as np

from sim.fields.contact_traction import surface_traction
from sim.fields.press_fields import indenter_surface
from sim.mesh.symmetry import WholeSurface
from sim.solve.loading_path import LoadingPath
from tacauchy_rig.core.arrays import AnyArray

STATES = 24
"""Of a press at most, the one without contact among them."""


def passed_states(path: LoadingPath) -> dict[str, AnyArray]:
    """Return the gel and the indenter in states from no contact to the end; units in the names.

    They balance as the path's steps do, to 0.1 % of the force. Fields of k states have the shape
    [k, ...]; those of the indenter's surface are in its own frame. ``elements`` lists the nodes of
    tetrahedra, ``faces`` the corners of the surface's.

    Args:
        path: That kept all its states.
    """
    model, points = path.model, path.points
    chosen = np.unique(np.linspace(0, len(points) - 1, STATES - 1).round().astype(int)).tolist()
    kept = [points[k] for k in chosen]
    whole = WholeSurface(model.mesh.symmetry, model.nodes)
    tractions = [surface_traction(model, each) for each in kept]
    start = path.untouched(0.0)
    nodes = [whole.at_nodes(each) for each in (start.positions, *(p.state.positions for p in kept))]
    still = np.zeros(len(nodes[0]))
    pressure = [still, *(whole.at_nodes(each.pressure_pa) for each in tractions)]
    shear = [np.zeros_like(nodes[0]), *(whole.at_nodes(each.tangential_pa) for each in tractions)]
    vertices, triangles = indenter_surface(path.indenter, float(np.abs(nodes[0]).max()))
    young, poisson = (whole.at_faces(each) for each in model.materials)
    states = [start, *(each.state for each in kept)]
    return {
        "elements": whole.faces(model.elements),
        "faces": whole.faces(model.faces)[:, :3],
        "node_rest_m": whole.at_nodes(model.nodes),
        "node_m": np.array(nodes),
        "contact_pressure_pa": np.array(pressure, dtype=np.float32),
        "contact_shear_pa": np.array(shear, dtype=np.float32),
        "depth_m": np.array([0.0, *(each.depth_m for each in kept)]),
        "force_n": np.array([np.zeros(3), *(each.force_n for each in kept)]),
        "indenter_tip_m": np.array([each.tip for each in states]),
        "indenter_rotation": np.array([each.rotation for each in states]),
        "indenter_vertex_m": vertices,
        "indenter_faces": triangles,
        "young_pa": young,
        "poisson": poisson,
    }
