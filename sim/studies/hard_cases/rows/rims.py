"""Row 5: the rim of a sharp punch moved across elements that are not made for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.mesh.elements import ElementOrder
from sim.mesh.symmetry import MirrorSymmetry
from sim.mesh.tet_mesh import TetMesh
from sim.scene.indenter import Cylinder
from sim.solve.load_steps.path import LoadingPath
from sim.studies.hard_cases.box_mesh import box_mesh
from sim.studies.hard_cases.case import HardCase, Measured, Outcome
from sim.studies.hard_cases.pads import HEIGHT_M, pad_model, round_mesh

PUNCH = Cylinder(diameter_m=5e-3)
SPREAD_TOLERANCE = 0.05
SHIFTS = (0.0, 0.25, 0.5)


def moved_rim(*, depth_m: float = 0.4e-3) -> Outcome:
    """Press where the rim meets nodes and up to half an element beside, on two kinds of mesh.

    One is uniform and knows nothing of the punch; the other is fine at the rim's first place.
    """
    uniform_m, rim_m = 1e-3, 0.2e-3
    fitted = round_mesh(start_m=PUNCH.radius_m, end_m=PUNCH.radius_m, size_m=rim_m, symmetric=False)
    meshes = {"uniform": (uniform_mesh(uniform_m), uniform_m), "fitted": (fitted, rim_m)}
    measured: Measured = {}
    spreads = []
    for name, (mesh, size) in meshes.items():
        forces = forces_beside(mesh, size, depth_m=depth_m)
        spreads.append((max(forces) - min(forces)) / forces[0])
        measured[f"element_at_rim_{name}_m"] = size
        measured[f"force_spread_relative_{name}"] = spreads[-1]
        measured[f"force_{name}_n"] = forces[0]
    return Outcome(passed=max(spreads) < SPREAD_TOLERANCE, measured=measured)


def forces_beside(
    mesh: TetMesh, size_m: float, *, depth_m: float, shifts: tuple[float, ...] = SHIFTS
) -> list[float]:
    """Return F_z with the punch moved along x by shares of an element [N]."""
    model = pad_model(mesh, order=ElementOrder.P2)
    paths = [LoadingPath(model, PUNCH, (share * size_m, 0.0)) for share in shifts]
    return [float(path.advance(depth_m).force_n[2]) for path in paths]


def uniform_mesh(size_m: float, *, extent_m: float = 10e-3) -> TetMesh:
    """Return one half, y >= 0, of a square pad of equal cells about as large as asked."""
    count = round(0.5 * extent_m / size_m)
    mesh = box_mesh(
        (extent_m, 0.5 * extent_m, HEIGHT_M), (2 * count, count, round(HEIGHT_M / size_m))
    )
    raised = mesh.vertices + np.array([0.0, 0.25 * extent_m, 0.0])
    return replace(mesh, vertices=raised, symmetry=MirrorSymmetry(mirror_y=True))


CASES: tuple[HardCase, ...] = (
    HardCase(
        number=5,
        name="sharp rim moved by half an element",
        criterion="F varies by less than 5 %",
        measure=moved_rim,
        limit_s=300.0,
    ),
)
