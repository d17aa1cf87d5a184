"""How much F_z is off on a scene's mesh, found at small strains on its section through the axis.

What the edges in that section make of F_z at small strains is off by nearly what the mesh makes of
the real press: Poisson's ratio, the pad's height, the rim, the barrier and what the edges happen to
cut act on both alike. A section has some hundred unknowns where the mesh has thousands, so that it
takes milliseconds. ``sim.error.prior_error`` has by how much the two differ.

The section has quadratic triangles with the strains (u_r', u_z', u_r / r, shear) of a body of
revolution, Hooke's law about the shape at rest, and the barrier as a bed of springs on the indenter
grown by d_hat.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from sim.arrays import FloatArray, IntArray
from sim.contact.state import ContactOptions
from sim.effects.estimates import expected_depth
from sim.effects.mesh_choice import contact_reach
from sim.effects.presets import section_for
from sim.mesh.elements import FACE_EDGES, quadratic_nodes
from sim.mesh.graded_plane import Triangulation
from sim.mesh.sparsity import assembled
from sim.scene.indenter import Cylinder, Indenter, Sphere, grown
from sim.scene.material import Material
from sim.scene.scene import BARRIER_M, Preset, Scene
from sim.solve.linear_solver import symmetric_factor

# What is left of its error is the same for all settings of a press. Finer ones, or the limit that
# two tend to, foretell the errors of the training presses no better, and take longer.
_FINE = 3.0
_REACH_SHARE = 1.2
_KEPT = 256
_ROUNDS = 4
# F_z grows with the depth to a power of 1 under a flat end, 1.5 and more under a round one.
_POWER = 1.4
# Strang and Fix 1973: three points of degree 2, barycentric, each a third of the area.
_POINTS = np.full((3, 3), 1.0 / 6.0) + 0.5 * np.eye(3)
_EDGE_POINTS = 5
_ALONG, _EDGE_WEIGHTS = (np.asarray(each) for each in np.polynomial.legendre.leggauss(_EDGE_POINTS))
_ROUNDS_MAX = 30


@dataclass(frozen=True, slots=True)
class _Pressed:
    """A section's gel and what presses on it."""

    gel: AxisymmetricGel
    bed: Bed


def section_error(scene: Scene, *, depth_m: float) -> float:
    """Return the relative error of F_z at a depth that the edges in a scene's section make.

    Args:
        depth_m: Travel of the tip below first touch [m], above zero.

    Raises:
        ConfigError: The scene cannot be meshed.
    """
    bare = _bare(scene)
    pressed = _pressed(replace(bare, preset=scene.preset, refinement=scene.refinement))
    return pressed.gel.force(pressed.bed, depth_m=depth_m) / _limit_n(bare, depth_m) - 1.0


def section_depth(scene: Scene) -> float:
    """Return the depth of a scene's target, for a force that at small strains on its section [m].

    Raises:
        ConfigError: The scene cannot be meshed.
    """
    depth, force = expected_depth(scene), scene.target.force_n
    if force is None:
        return depth
    pressed = _pressed(_bare(scene))
    for _ in range(_ROUNDS):
        found = scene.material.young_pa * pressed.gel.force(pressed.bed, depth_m=depth)
        depth *= (force / found) ** (1.0 / _POWER)
    return depth


def section_force(scene: Scene, *, depth_m: float) -> float:
    """Return F_z at a depth at small strains, on a section that is fine enough [N].

    Raises:
        ConfigError: The scene cannot be meshed.
    """
    return scene.material.young_pa * _limit_n(_bare(scene), depth_m)


def _bare(scene: Scene) -> Scene:
    """Return what of a scene its section's force depends on, with E = 1 Pa, on preset fast."""
    return Scene(
        pad=scene.pad,
        material=Material(young_pa=1.0, poisson=scene.material.poisson),
        indenter=scene.indenter,
        target=replace(scene.target, force_n=None if scene.target.force_n is None else 1.0),
        centre_m=scene.centre_m,
        preset=Preset.FAST,
    )


@lru_cache(maxsize=_KEPT)
def _limit_n(bare: Scene, depth_m: float) -> float:
    """Return the force on a section that is fine enough, with a narrow barrier."""
    pressed = _pressed(replace(bare, refinement=_FINE, barrier_m=BARRIER_M))
    return pressed.gel.force(pressed.bed, depth_m=depth_m)


@lru_cache(maxsize=_KEPT)
def _pressed(bare: Scene) -> _Pressed:
    indenter = bare.indenter
    distance, height = bare.contact_distance_m, bare.pad.height_m
    if isinstance(indenter, Cylinder | Sphere):
        indenter = grown(indenter, distance)
    reach = _REACH_SHARE * contact_reach(bare)
    stiffness = ContactOptions().stiffness_factor * bare.material.young_pa / distance
    return _Pressed(
        AxisymmetricGel(
            section_for(bare),
            height_m=height,
            young_pa=bare.material.young_pa,
            poisson=bare.material.poisson,
            reach_m=reach,
        ),
        Bed(indenter=indenter, stiffness_pa_m=stiffness),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Bed:
    """What presses on the top: a rigid body and the springs on it.

    Attributes:
        indenter: Grown by d_hat.
        stiffness_pa_m: Pressure per overlap [Pa/m].
    """

    indenter: Indenter
    stiffness_pa_m: float


class AxisymmetricGel:
    """A clamped, elastic body of revolution whose flat top is pressed on.

    Args:
        section: Its half section.
        height_m: Of the top [m].
        reach_m: No point further from the axis will be touched [m].
    """

    def __init__(
        self,
        section: Triangulation,
        *,
        height_m: float,
        young_pa: float,
        poisson: float,
        reach_m: float,
    ) -> None:
        points, triangles = quadratic_nodes(section.points, section.triangles, edges=FACE_EDGES)
        stiffness = _stiffness(points, triangles, young_pa, poisson)
        self._edges = _top_edges(points, triangles, height_m, reach_m)
        free = np.ones((len(points), 2), dtype=bool)
        free[points[:, 1] <= 1e-9 * height_m] = False
        free[points[:, 0] <= 1e-9 * height_m, 0] = False
        kept = np.flatnonzero(free)
        solve = symmetric_factor(stiffness[kept][:, kept]).solve
        self._touched = np.unique(self._edges)
        places = np.searchsorted(kept, 2 * self._touched + 1)
        push = np.zeros((len(kept), len(places)))
        push[places, np.arange(len(places))] = 1.0
        self._compliance = solve(push)[places]
        self._radii, self._areas, self._values = self._edge_points(points)

    def force(self, bed: Bed, *, depth_m: float) -> float:
        """Return F_z of a press to a depth below first touch [N]."""
        radii, values = self._radii, self._values
        overlaps = depth_m - bed.indenter.lower_surface(radii, np.zeros_like(radii))
        springs = np.where(overlaps > -np.inf, bed.stiffness_pa_m * self._areas, 0.0)
        overlaps = np.maximum(overlaps, -1.0)
        lifted = np.zeros(len(radii))
        touching: NDArray[np.bool_] = overlaps > 0.0
        for _ in range(_ROUNDS_MAX):
            held = np.where(touching, springs, 0.0)
            pressed = values.T @ np.where(touching, held * overlaps, 0.0)
            coupled = np.eye(len(self._touched)) + self._compliance @ (values.T * held) @ values
            lifted = values @ np.linalg.solve(coupled, -self._compliance @ pressed)
            before, touching = touching, overlaps + lifted > 0.0
            if np.array_equal(before, touching):
                break
        return float((springs * np.maximum(overlaps + lifted, 0.0)).sum())

    def _edge_points(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return radius [m], area [m^2] and the nodes' shares of points on the top's edges."""
        at, weight = 0.5 * (1.0 + _ALONG), 0.5 * _EDGE_WEIGHTS
        ends = points[self._edges[:, :2], 0]
        lengths = np.abs(ends[:, 1] - ends[:, 0])
        radii = (ends[:, :1] + at * (ends[:, 1:] - ends[:, :1])).reshape(-1)
        areas = 2.0 * np.pi * radii * (lengths[:, None] * weight).reshape(-1)
        shares = np.column_stack([(1 - at) * (1 - 2 * at), at * (2 * at - 1), 4 * at * (1 - at)])
        columns = np.searchsorted(self._touched, self._edges)
        values = np.zeros((len(radii), len(self._touched)))
        rows = np.arange(len(radii)).reshape(len(self._edges), _EDGE_POINTS)
        values[rows[:, :, None], columns[:, None, :]] = shares
        return radii, areas, values


def _top_edges(
    points: FloatArray, triangles: IntArray, height_m: float, reach_m: float
) -> IntArray:
    """Return the ends and the middle of every edge of the top that may be touched."""
    sides = np.concatenate([triangles[:, [*pair, 3 + k]] for k, pair in enumerate(FACE_EDGES)])
    on_top = np.all(points[sides, 1] >= height_m * (1.0 - 1e-9), axis=1)
    near = points[sides[:, :2], 0].min(axis=1) <= reach_m
    return np.asarray(sides[on_top & near])


def _stiffness(
    points: FloatArray, triangles: IntArray, young_pa: float, poisson: float
) -> scipy.sparse.csr_matrix:
    """Return the stiffness by (u_r, u_z) of every point [N/m]."""
    corners = points[triangles[:, :3]]
    across = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=1)
    areas = 0.5 * np.abs(np.linalg.det(across))
    # Gradients of the barycentric coordinates, [triangle, corner, direction].
    slopes = np.linalg.inv(across).transpose(0, 2, 1)
    slopes = np.concatenate([-slopes.sum(axis=1, keepdims=True), slopes], axis=1)
    values, by_corner = _quadratic()
    gradients = by_corner @ slopes[:, None]
    radii = corners[..., 0] @ _POINTS.T
    strains = np.zeros((*radii.shape, 4, 6, 2))
    strains[..., 0, :, 0] = gradients[..., 0]
    strains[..., 1, :, 1] = gradients[..., 1]
    strains[..., 2, :, 0] = values / radii[..., None]
    strains[..., 3, :, 0] = gradients[..., 1]
    strains[..., 3, :, 1] = gradients[..., 0]
    strains = strains.reshape(*radii.shape, 4, 12)
    weights = 2.0 * np.pi / len(_POINTS) * radii * areas[:, None]
    stress = weights[..., None, None] * (_hooke(young_pa, poisson) @ strains)
    flat = (len(triangles), 4 * len(_POINTS), 12)
    blocks = strains.reshape(flat).transpose(0, 2, 1) @ stress.reshape(flat)
    dofs = (2 * triangles[:, :, None] + np.arange(2)).reshape(len(triangles), 12)
    return assembled(blocks, dofs, 2 * len(points))


def _quadratic() -> tuple[FloatArray, FloatArray]:
    """Return the shape functions at the points and their slopes by the barycentric coordinates."""
    values = [_POINTS * (2.0 * _POINTS - 1.0)]
    slopes = np.zeros((len(_POINTS), 6, 3))
    for k in range(3):
        slopes[:, k, k] = 4.0 * _POINTS[:, k] - 1.0
    for k, (a, b) in enumerate(FACE_EDGES):
        values.append(4.0 * _POINTS[:, [a]] * _POINTS[:, [b]])
        slopes[:, 3 + k, a] = 4.0 * _POINTS[:, b]
        slopes[:, 3 + k, b] = 4.0 * _POINTS[:, a]
    return np.concatenate(values, axis=1), slopes


def _hooke(young_pa: float, poisson: float) -> FloatArray:
    shear = young_pa / (2.0 * (1.0 + poisson))
    lame = young_pa * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    found = np.diag([2.0 * shear, 2.0 * shear, 2.0 * shear, shear])
    found[:3, :3] += lame
    return found
