"""Contact pressure and traction over the deformed surface, for maps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.fields.press_fields import top_faces
from sim.mesh.elements import linear_facets
from sim.solve.load_steps.equilibrium import PathPoint
from sim.solve.load_steps.path import LoadingPath
from sim.studies.modes.signatures import contact_traction


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceMaps:
    """Nodal averages on the whole contact surface; tractions act on the gel.

    Attributes:
        points_m: Deformed nodes [m], shape [node_count, 3].
        triangles: Linear facets, shape [facet_count, 3].
        corner_faces: The elements' faces by their corners, shape [face_count, 3].
        pressure_pa: -p_n of the paper: positive presses on the gel, shape [node_count].
        tangential_pa: t_tau, shape [node_count, 3].
    """

    points_m: FloatArray
    triangles: IntArray
    corner_faces: IntArray
    pressure_pa: FloatArray
    tangential_pa: FloatArray


def surface_maps(path: LoadingPath, point: PathPoint) -> SurfaceMaps:
    """Average the contact points' tractions at the nodes of a whole pad, not of a part."""
    model = path.model
    traction = contact_traction(point)
    areas = np.linalg.norm(model.deformed_area_vectors(point.state.positions), axis=2)
    share = np.abs(model.reference.face_values)
    loads = np.concatenate([traction.normal_n[..., None], traction.tangential_n], axis=2)
    weight, total = np.zeros(len(model.nodes)), np.zeros((len(model.nodes), 4))
    for k in range(model.faces.shape[1]):
        np.add.at(weight, model.faces[:, k], areas @ share[:, k])
        np.add.at(total, model.faces[:, k], np.einsum("fpi,p->fi", loads, share[:, k]))
    mean = total / np.maximum(weight, 1e-300)[:, None]
    faces = model.faces[top_faces(model)]
    return SurfaceMaps(
        points_m=point.state.positions,
        triangles=linear_facets(faces),
        corner_faces=faces[:, :3],
        pressure_pa=mean[:, 0],
        tangential_pa=mean[:, 1:],
    )


def traction_arrows(point: PathPoint, *, pitch_m: float) -> tuple[FloatArray, FloatArray]:
    """Gather the tangential force in squares about the indenter's axis, seen along z.

    Returns:
        Places [m] and force over the square's area [Pa], shape [square_count, 2] each.
    """
    traction = contact_traction(point)
    touched = traction.normal_n > 0.0
    arms = traction.arms_m[touched][:, :2]
    squares, index = np.unique(
        np.round(arms / pitch_m).astype(np.int64), axis=0, return_inverse=True
    )
    force = np.zeros((len(squares), 2))
    np.add.at(force, index.reshape(-1), traction.tangential_n[touched][:, :2])
    return squares * pitch_m + point.state.tip[:2], force / pitch_m**2
