"""Moment about the indenter's tip and area of contact, summed over the contact points."""

from dataclasses import dataclass

import numpy as np

from sim.solve.loading_path import LoadingPath
from sim.solve.path_point import PathPoint
from tacauchy_rig.core.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactMeasures:
    """Sums over the contact points of an equilibrium; units in the names."""

    moment_nm: FloatArray
    area_m2: float
    area_seen_m2: float
    gap_min_m: float


def contact_measures(path: LoadingPath, point: PathPoint) -> ContactMeasures:
    """Sum moment and area over the contact points."""
    model, contact = path.model, point.equilibrium.contact
    symmetry = model.mesh.symmetry
    normals = model.surface.area_vectors(point.state.positions)
    areas = np.linalg.norm(normals, axis=2)
    strength = np.linalg.norm(contact.forces, axis=2)
    touching = strength > 0.0
    arms = contact.points - point.state.tip
    return ContactMeasures(
        moment_nm=symmetry.whole_moment(np.cross(arms, contact.forces).reshape(-1, 3).sum(axis=0)),
        area_m2=symmetry.copies * float(areas[touching].sum()),
        area_seen_m2=symmetry.copies * float(np.abs(normals[..., 2])[touching].sum()),
        gap_min_m=float(contact.gaps.min()),
    )
