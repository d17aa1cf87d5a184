"""What a press answers: each output as one size, and how far two presses of one mesh differ in it.

All of it is found from the contact's points and the surface's corners, so that a coarse press that
is only tried costs no stress recovery. Pressure and shear are the contact's forces along and across
the indenter's normal, as in the fields that are written: a flat face's normal is another under a
fillet, and pressure would pass for shear. Differences are held against the second press:

| output | size | difference |
|---|---|---|
| force | F_z | of the force as a vector |
| depth | depth | of the depth |
| pressure | p95 over the touched area | the larger of p95's and the resultant's |
| shear | L2 norm of the tangential traction, over the pressure's | its L2 norm, likewise |
| image | L2 norm of the surface's slopes | its L2 norm, which an image is a function of |
| markers | L2 norm of the surface's motion along x and y | its L2 norm |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.fields.pressure_and_shear import contact_forces
from sim.mesh.elements import doubled_areas
from sim.scene.scene import Output
from sim.scene.triangle_surface import unit
from sim.solve.loading_path import LoadingPath
from sim.solve.path_point import PathPoint
from tacauchy_rig.core.arrays import FloatArray

_PERCENTILE = 0.95
# Faces of another mesh that a face takes its traction from, and a distance that is none.
_NEAREST = 3
_SAME_PLACE_M = 1e-9
# Cosine to z above which a face of the pad at rest is of its top.
_TOP_COSINE = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class PressOutputs:
    """The outputs of one press on one mesh."""

    force_n: FloatArray  # on the indenter [N], shape [3]
    stiffness_n_m: float  # dF_z / d(depth) [N/m]
    depth_m: float
    fell_relative: float  # largest fall of F_z in a step that went deeper, over F_z after it
    copies: int  # mirror images that its planes of symmetry make of the gel, itself among them
    centres_m: FloatArray  # of the surface's faces at rest, shape [n, 3]
    areas_m2: FloatArray  # their areas at rest, each with its mirror images, shape [n]
    pressure_pa: FloatArray  # on each, the mean over its points, shape [n]
    shear_pa: FloatArray  # tangential traction on each, likewise, shape [n, 3]
    top_m2: FloatArray  # the same of the top's faces, shape [m]
    slopes: FloatArray  # unit normals of those, less those before the touch, shape [m, 3]
    motion_m: FloatArray  # their motion along x and y since then, shape [m, 2]

    @property
    def sizes(self) -> dict[Output, float]:
        """One number of each output, which a finer mesh changes: N, m, Pa, shares and L2 norms."""
        return {
            Output.FORCE: float(self.force_n[2]),
            Output.DEPTH: self.depth_m,
            Output.PRESSURE: self._pressure_p95(),
            Output.SHEAR: _share(
                _norm(self.shear_pa, self.areas_m2), _norm(self.pressure_pa[:, None], self.areas_m2)
            ),
            Output.IMAGE: _norm(self.slopes, self.top_m2),
            Output.MARKERS: _norm(self.motion_m, self.top_m2),
        }

    @property
    def touched_count(self) -> int:
        """Touched faces of the whole gel, mirror images among them; one where nothing touches."""
        return max(1, self.copies * int(np.count_nonzero(self.pressure_pa)))

    def differences(self, other: PressOutputs) -> dict[Output, float]:
        """Return how far each output is from that of another press on the same mesh."""
        carried, others = (float(each.pressure_pa @ each.areas_m2) for each in (self, other))
        p95 = _relative(self._pressure_p95(), other._pressure_p95())
        pressure = _norm(other.pressure_pa[:, None], other.areas_m2)

        def on_top(mine: FloatArray, its: FloatArray) -> float:
            return _share(_norm(mine - its, other.top_m2), _norm(its, other.top_m2))

        return {
            Output.FORCE: _share(
                float(np.linalg.norm(self.force_n - other.force_n)),
                float(np.linalg.norm(other.force_n)),
            ),
            Output.DEPTH: _relative(self.depth_m, other.depth_m),
            Output.PRESSURE: max(p95, _relative(carried, others)),
            Output.SHEAR: _share(_norm(self.shear_pa - other.shear_pa, self.areas_m2), pressure),
            Output.IMAGE: on_top(self.slopes, other.slopes),
            Output.MARKERS: on_top(self.motion_m, other.motion_m),
        }

    def changes(self, other: PressOutputs) -> dict[Output, float]:
        """Return how far each size is from that of another press, which may have another mesh."""
        sizes, others = self.sizes, other.sizes
        return {
            output: abs(sizes[output] - others[output])
            if output is Output.SHEAR
            else _relative(sizes[output], others[output])
            for output in Output
        }

    def shear_change(self, other: PressOutputs) -> float:
        """Return how far the shear is from that of a press on another mesh.

        The L2 norm of the difference of the tangential tractions over that of the other's pressure,
        on the faces of the one that models the smaller part of the gel, else on the other's: each
        of them takes the first mesh's traction from the nearest faces, by the inverse square of the
        distance.

        Returns:
            The share; 0 where the other is not touched.
        """
        from scipy.spatial import KDTree  # noqa: PLC0415 - a press without estimate does not need it

        there, here = (self, other) if other.copies >= self.copies else (other, self)
        apart_m, nearest = KDTree(there.centres_m).query(here.centres_m, k=_NEAREST)
        weights = 1.0 / np.maximum(apart_m, _SAME_PLACE_M) ** 2
        weights /= weights.sum(axis=1, keepdims=True)
        shear = (there.shear_pa[nearest] * weights[..., None]).sum(axis=1)
        pressure = _norm(other.pressure_pa[:, None], other.areas_m2)
        return _share(_norm(shear - here.shear_pa, here.areas_m2), pressure)

    def _pressure_p95(self) -> float:
        touched = self.pressure_pa > 0.0
        if not touched.any():
            return 0.0
        order = np.argsort(self.pressure_pa[touched])
        areas = np.cumsum(self.areas_m2[touched][order])
        return float(np.interp(_PERCENTILE * areas[-1], areas, self.pressure_pa[touched][order]))


def outputs_of(path: LoadingPath, point: PathPoint) -> PressOutputs:
    """Return what an equilibrium answers; images and markers are held against the untouched gel."""
    model, before, now = path.model, path.unloaded, point.state.positions
    copies = model.mesh.symmetry.copies
    areas = np.linalg.norm(model.surface.area_vectors(now).sum(axis=1), axis=1)
    contact = contact_forces(point)
    corners = model.faces[:, :3]
    rest, bent = (doubled_areas(nodes, corners) for nodes in (before, now))
    sizes = np.linalg.norm(rest, axis=1)
    top = rest[:, 2] > _TOP_COSINE * sizes
    return PressOutputs(
        force_n=point.force_n,
        stiffness_n_m=point.stiffness_n_m,
        depth_m=point.depth_m,
        fell_relative=_fall(path),
        copies=copies,
        centres_m=before[corners].mean(axis=1),
        areas_m2=copies * 0.5 * sizes,
        pressure_pa=contact.normal_n.sum(axis=1) / areas,
        shear_pa=contact.tangential_n.sum(axis=1) / areas[:, None],
        top_m2=copies * 0.5 * sizes[top],
        slopes=unit(bent[top]) - unit(rest[top]),
        motion_m=(now - before)[corners].mean(axis=1)[top, :2],
    )


def _fall(path: LoadingPath) -> float:
    """Return the largest fall of F_z in a step that went deeper, over F_z after it."""
    if path.memories:  # gel with mass rings, and came to no other equilibrium
        return 0.0
    depths, forces = np.array(path.history).T
    deeper = (np.diff(depths) > _SAME_PLACE_M) & (forces[1:] > 0.0)
    return float(np.max(-np.diff(forces)[deeper] / forces[1:][deeper], initial=0.0))


def _norm(values: FloatArray, areas: FloatArray) -> float:
    return float(np.sqrt((values**2).sum(axis=1) @ areas))


def _relative(one: float, other: float) -> float:
    return _share(abs(one - other), abs(other))


def _share(part: float, whole: float) -> float:
    """Return a share; nothing of nothing is none of it."""
    return part / whole if whole > 0.0 else float(part > 0.0)
