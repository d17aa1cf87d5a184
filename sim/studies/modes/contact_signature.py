"""Signatures of pressing, sliding and torsion as numbers (paper, section IV-E).

Directions are judged at the mesh's vertices, as the paper's force fields are (Algorithm 2): what
scatters from point to point (see ``pressure_and_shear``) cancels there, while sums stay.
"""

from dataclasses import dataclass

import numpy as np

from sim.fields.pressure_and_shear import ContactTraction, contact_forces, surface_traction
from sim.fields.saved_press import top_surface
from sim.mesh.elements import linear_facets
from sim.scene.triangle_surface import unit
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from tacauchy_rig.core.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactSignature:
    """What the contact of one equilibrium looks like, seen along z; forces act on the gel."""

    normal_n: tuple[float, float, float]  # resultant of the normal forces, a vector [N]
    normal_sum_n: float  # sum of the normal forces' sizes [N]
    tangential_n: tuple[float, float, float]  # resultant of the tangential forces [N]
    tangential_sum_n: float  # sum of the tangential forces' sizes [N]
    centre_m: tuple[float, float]  # centre of pressure relative to the indenter's axis, x and y [m]
    # Mean of |cos| of the angle between the tangential force and the way around the axis, weighted
    # by the force's size, over the vertices
    circumferential_share: float
    radial_share: float  # the same with the way straight from the axis, along the surface
    inward_share: float  # weighted mean of the cosine with the way towards the axis
    radial_share_points: float  # ``radial_share`` over the contact points

    @property
    def normal_size_n(self) -> float:
        """F_n, the size of the normal forces' resultant [N]."""
        return float(np.linalg.norm(self.normal_n))

    @property
    def mobilised_friction(self) -> float:
        """Tangential resultant over F_n: mu in a slide that has let go."""
        return float(np.linalg.norm(self.tangential_n)) / max(self.normal_size_n, 1e-300)

    @property
    def sliding_friction(self) -> float:
        """Sum of tangential forces' sizes over that of normal ones'; mu if every point slides."""
        return self.tangential_sum_n / max(self.normal_sum_n, 1e-300)


def vertex_traction(model: Model, point: PathPoint) -> ContactTraction:
    """Gather the contact forces at the vertices that carry any, shape [vertex_count].

    A point gives to its face's corners in proportion to its barycentric coordinates: unlike the
    nodal forces of a quadratic face these have the sign of what acts there.
    """
    traction = contact_forces(point)
    pressing = traction.normal_n[..., None] * traction.normals
    loads = np.concatenate([pressing, traction.tangential_n], axis=2)
    total = np.zeros((len(model.nodes), 6))
    shares = np.einsum("fpi,pk->fki", loads, model.reference.face_points)
    np.add.at(total, model.faces[:, :3], shares)
    touched = np.any(total[:, :3] != 0.0, axis=1)
    pressed, dragged = np.split(total[touched], 2, axis=1)
    normals, forces = unit(pressed), pressed + dragged
    along = np.einsum("vi,vi->v", forces, normals)
    return ContactTraction(
        arms_m=point.state.positions[touched] - point.state.tip,
        normals=normals,
        normal_n=along,
        tangential_n=forces - along[:, None] * normals,
    )


def contact_signature(model: Model, point: PathPoint) -> ContactSignature:
    """Measure the contact of an equilibrium of a whole pad, not of a part."""
    traction = contact_forces(point)
    pressed, tangential = traction.normal_n.reshape(-1), traction.tangential_n.reshape(-1, 3)
    centre = pressed @ traction.arms_m.reshape(-1, 3) / max(float(pressed.sum()), 1e-300)
    around, outward = _directed(vertex_traction(model, point))
    return ContactSignature(
        normal_n=tuple((pressed @ traction.normals.reshape(-1, 3)).tolist()),
        normal_sum_n=float(pressed.sum()),
        tangential_n=tuple(tangential.sum(axis=0).tolist()),
        tangential_sum_n=float(np.linalg.norm(tangential, axis=1).sum()),
        centre_m=tuple(centre[:2].tolist()),
        circumferential_share=float(np.abs(around).sum()),
        radial_share=float(np.abs(outward).sum()),
        inward_share=-float(outward.sum()),
        radial_share_points=float(np.abs(_directed(traction)[1]).sum()),
    )


def _directed(traction: ContactTraction) -> tuple[FloatArray, FloatArray]:
    """Return the tangential forces' parts around and away from the axis, over their sizes' sum."""
    arms, normals = traction.arms_m.reshape(-1, 3), traction.normals.reshape(-1, 3)
    tangential = traction.tangential_n.reshape(-1, 3)
    around = unit(np.cross((0.0, 0.0, 1.0), arms * (1.0, 1.0, 0.0)))
    outward = unit(np.cross(around, normals))
    outward *= np.sign(np.einsum("pi,pi->p", outward, arms))[:, None]
    size = max(float(np.linalg.norm(tangential, axis=1).sum()), 1e-300)
    around, outward = (np.einsum("pi,pi->p", tangential, way) / size for way in (around, outward))
    return around, outward


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceMaps:
    """Recovered contact traction on the whole contact surface; it acts on the gel."""

    points_m: FloatArray  # deformed nodes [m], shape [node_count, 3]
    triangles: IntArray  # linear facets, shape [facet_count, 3]
    corner_faces: IntArray  # the elements' faces by their corners, shape [face_count, 3]
    pressure_pa: FloatArray  # -p_n of the paper: positive presses on the gel, shape [node_count]
    tangential_pa: FloatArray  # t_tau, shape [node_count, 3]


def surface_maps(path: LoadingPath, point: PathPoint) -> SurfaceMaps:
    """Recover pressure and shear at the nodes of a whole pad."""
    found, top = surface_traction(path.model, point), top_surface(path.model)
    return SurfaceMaps(
        points_m=top.of(point.state.positions),
        triangles=linear_facets(top.faces),
        corner_faces=top.faces[:, :3],
        pressure_pa=found.pressure_pa[top.sources],
        tangential_pa=top.of(found.tangential_pa),
    )


def traction_arrows(point: PathPoint, *, pitch_m: float) -> tuple[FloatArray, FloatArray]:
    """Gather the tangential force in squares about the indenter's axis, seen along z.

    Returns:
        Places [m] and force over the square's area [Pa], shape [square_count, 2] each.
    """
    traction = contact_forces(point)
    touched = traction.normal_n > 0.0
    arms = traction.arms_m[touched][:, :2]
    square = np.round(arms / pitch_m).astype(np.int64)
    squares, index = np.unique(square, axis=0, return_inverse=True)
    force = np.zeros((len(squares), 2))
    np.add.at(force, index.reshape(-1), traction.tangential_n[touched][:, :2])
    return squares * pitch_m + point.state.tip[:2], force / pitch_m**2
