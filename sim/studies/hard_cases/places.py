"""Cases 5 and 16: a sharp rim between the nodes, and the indenter half off the pad or beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.effects.presets import build_model
from sim.mesh.elements import ElementOrder
from sim.mesh.symmetry import MirrorSymmetry
from sim.mesh.tet_mesh import TetMesh
from sim.press import contact_measures, press
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.material import Material
from sim.scene.pad import BoxPad
from sim.scene.scene import Effect, Preset, Scene, Target
from sim.solve.loading_path import LoadingPath
from sim.studies.hard_cases.case import Measured, Outcome
from sim.studies.hard_cases.pads import HEIGHT_M, balance_relative, box_mesh, pad_model, round_mesh
from tacauchy_rig.core.errors import ConfigError

PUNCH = Cylinder(diameter_m=5e-3)
_SPREAD_ALLOWED = 0.05
SHIFTS = (0.0, 0.25, 0.5)
PAD = BoxPad(size_x_m=12e-3, size_y_m=12e-3, height_m=4e-3)
INDENTERS: dict[str, Indenter] = {
    "sharp_cylinder": Cylinder(diameter_m=5e-3),
    "sphere": Sphere(diameter_m=8e-3),
}
PLACES = {"middle": (0.0, 0.0), "edge": (6e-3, 0.0), "corner": (6e-3, 6e-3)}
DEPTHS_M = (0.1e-3, 0.2e-3, 0.3e-3, 0.4e-3)
_BALANCE_MAX = 1e-6
# Farther than the larger radius: a ball whose tip is beside the pad may still touch its edge.
_BESIDE_M = (10.5e-3, 0.0)


def moved_rim() -> Outcome:
    """Press where the rim meets nodes and up to half an element beside, on two kinds of mesh.

    One is uniform and knows nothing of the punch; the other is fine at the rim's first place.
    """
    uniform_m, rim_m = 1e-3, 0.2e-3
    fitted = round_mesh(start_m=PUNCH.radius_m, end_m=PUNCH.radius_m, size_m=rim_m, symmetric=False)
    meshes = {"uniform": (uniform_mesh(uniform_m), uniform_m), "fitted": (fitted, rim_m)}
    measured: Measured = {}
    spreads = []
    for name, (mesh, size) in meshes.items():
        forces = forces_beside(mesh, size, depth_m=0.4e-3)
        spreads.append((max(forces) - min(forces)) / forces[0])
        measured[f"element_at_rim_{name}_m"] = size
        measured[f"force_spread_relative_{name}"] = spreads[-1]
        measured[f"force_{name}_n"] = forces[0]
    return Outcome(passed=max(spreads) < _SPREAD_ALLOWED, measured=measured)


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


def off_the_pad() -> Outcome:
    """Press a cylinder and a ball at every place with the preset's quadratic elements."""
    return pressed_off(INDENTERS, effects=())


def pressed_off(
    indenters: dict[str, Indenter], *, effects: tuple[tuple[Effect, bool], ...]
) -> Outcome:
    """Press at the middle, the edge and the corner of a box, then beside it.

    Args:
        indenters: By name.
        effects: Switched on or off, such as the locking-free element.
    """
    measured: Measured = {}
    passed = True
    for name, indenter in indenters.items():
        scene = Scene(
            pad=PAD,
            material=Material(young_pa=4e5, poisson=0.48),
            indenter=indenter,
            target=Target(depth_m=DEPTHS_M[-1]),
            preset=Preset.FAST,
            effects=effects,
        )
        forces = []
        for place, centre in PLACES.items():
            found = _pressed(replace(scene, centre_m=centre))
            measured |= {f"{name}_{place}_{key}": value for key, value in found.items()}
            passed &= bool(found["rises"]) and float(found["gap_min_m"]) > 0.0
            passed &= float(found["balance_max_relative"]) <= _BALANCE_MAX
            forces.append(float(found["force_n"]))
        passed &= forces[0] > forces[1] > forces[2] > 0.0
        refused = _refused(replace(scene, centre_m=_BESIDE_M))
        measured[f"{name}_beside"] = refused or "pressed nothing without a word"
        passed &= bool(refused)
    return Outcome(passed=passed, measured=measured)


def _pressed(scene: Scene) -> Measured:
    """Press step by step; every step that is reached has converged, or an error is raised."""
    model = build_model(scene)
    path = LoadingPath(model, scene.indenter, scene.centre_m)
    forces, balance, gap = [0.0], 0.0, np.inf
    for depth in DEPTHS_M:
        point = path.advance(depth)
        balance = max(balance, balance_relative(model, point))
        gap = min(gap, contact_measures(path, point).gap_min_m)
        forces.append(float(point.force_n[2]))
    return {
        "force_n": forces[-1],
        "rises": bool(np.all(np.diff(forces) > 0.0)),
        "balance_max_relative": balance,
        "gap_min_m": gap,
        "min_jacobian": point.equilibrium.min_jacobian,
    }


def _refused(scene: Scene) -> str:
    """Return what a press beside the pad is told, or nothing."""
    try:
        press(scene)
    except ConfigError as error:
        return error.message
    return ""
