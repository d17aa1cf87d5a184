"""What a press must keep: balance, continuity, and F_z whatever the barrier or place."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from sim.effects.presets import build_model, finest_edge_m, regularised_indenter
from sim.fields import stress
from sim.press import press
from sim.press_arguments import scene_from
from sim.scene.indenter import Cylinder, Indenter, Sphere, describe
from sim.scene.scene import ContactMode, Preset, Scene
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.studies import from_file
from sim.studies.verification import Row, section
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.tables import Table

_ROUNDED = Cylinder(diameter_m=5e-3, fillet_m=0.1e-3)
_INDENTERS: tuple[Indenter, ...] = (Cylinder(diameter_m=5e-3), _ROUNDED, Sphere(diameter_m=8e-3))
_STATED = from_file("verification/presses.toml")
# Relative changes of F_z that are allowed.
# Preset fast's barrier is wide, and takes a part of its 5 %.
_BARRIER_ALLOWED = {Preset.BALANCED: 0.003, Preset.FAST: 0.02}
_SHIFT_ALLOWED = {Preset.BALANCED: 0.03, Preset.ACCURATE: 0.01}


def limit_without_distance(whole_n: float, half_n: float, quarter_n: float) -> float:
    """Return F_z at d_hat = 0 [N], along the parabola through it at d_hat, a half and a quarter."""
    return (whole_n - 6.0 * half_n + 8.0 * quarter_n) / 3.0


def barrier_row(scene: Scene) -> Row:
    """Press a scene at its own d_hat, at half and at a quarter of it."""
    distance = scene.contact_distance_m
    first, second, third = (
        press(replace(scene, barrier_m=share * distance)).force_n[2] for share in (1.0, 0.5, 0.25)
    )
    limit = limit_without_distance(first, second, third)
    return {
        "indenter": describe(scene.indenter),
        "contact": scene.contact.value,
        "d_hat [um]": distance * 1e6,
        "F_z [N]": first,
        "F_z, d_hat/2 [N]": second,
        "F_z, d_hat/4 [N]": third,
        "F_z, d_hat to 0 [N]": limit,
        "difference": abs(first / limit - 1.0),
    }


def measure_barrier() -> Table:
    """Extrapolate F_z to d_hat = 0 for a few presses."""
    scene = scene_from(_STATED["barrier"])
    scenes = [replace(scene, indenter=indenter) for indenter in _INDENTERS]
    scenes.append(replace(scene, contact=ContactMode.BONDED))
    rows = [
        {"preset": preset.value, **barrier_row(replace(each, preset=preset)), "allowed": allowed}
        for preset, allowed in _BARRIER_ALLOWED.items()
        for each in scenes
    ]
    return section("barrier", rows, passed=_is_below("difference", rows))


def _is_below(name: str, rows: Sequence[Row]) -> bool:
    return all(float(row[name] or 0.0) < float(row["allowed"] or 0.0) for row in rows)


def shift_row(scene: Scene) -> Row:
    """Press a centred indenter on a mesh made for one half an element to its side, and that one."""
    edge = finest_edge_m(scene)
    aside = (0.5 * edge, 0.0)
    model = build_model(replace(scene, centre_m=aside))
    depth = scene.target.depth_m or 0.0
    force, shifted = (
        float(LoadingPath(model, regularised_indenter(scene), centre).advance(depth).force_n[2])
        for centre in (aside, (0.0, 0.0))
    )
    return {
        "preset": scene.preset.value,
        "indenter": describe(scene.indenter),
        "edge [um]": edge * 1e6,
        "F_z [N]": force,
        "F_z moved [N]": shifted,
        "change": abs(shifted / force - 1.0),
    }


def measure_shift() -> Table:
    """Press each indenter in both places on each preset's mesh."""
    scene = scene_from(_STATED["shift"])
    rows = [
        shift_row(replace(scene, indenter=indenter, preset=preset)) | {"allowed": allowed}
        for preset, allowed in _SHIFT_ALLOWED.items()
        for indenter in _INDENTERS
    ]
    return section("shift", rows, passed=_is_below("change", rows))


_LIMIT = 1e-6
REFINEMENTS = (1.0, 1.5)
# Headings of what is judged.
BASE, LOAD, GAP = "indenter and base", "indenter and load", "smallest gap [um]"
TRACTION_GAPS = [f"surface_traction_gap_relative, edges 1/{factor:g}" for factor in REFINEMENTS]


def balanced_press(scene: Scene) -> dict[str, float | None]:
    """Press a scene on its own mesh and on a finer one; count its force in four ways.

    Force less load is None where a depth was asked for.
    """
    results = [press(scene, model=build_model(scene, refinement=factor)) for factor in REFINEMENTS]
    load = scene.target.force_n
    off_load = [abs(result.force_n[2] / load - 1.0) for result in results] if load else [None]
    gaps = [result.surface_traction_gap_relative for result in results]
    return {
        "F_z [N]": results[0].force_n[2],
        BASE: max(result.force_balance_relative for result in results),
        LOAD: max(off_load, key=lambda off: off or 0.0),
        **dict(zip(TRACTION_GAPS, gaps, strict=True)),
        GAP: 1e6 * min(result.gap_min_m for result in results),
    }


def is_balanced(row: Mapping[str, float | None]) -> bool:
    """Indenter, base and load agree to 1e-6, and nothing overlaps."""
    return max(row[BASE] or 0.0, row[LOAD] or 0.0) < _LIMIT and (row[GAP] or 0.0) > 0.0


def measure_balance() -> Table:
    """Press the scenes and compare."""
    scenes = _STATED["balance"]
    found = {name: balanced_press(scene_from(words)) for name, words in scenes.items()}
    worst = [max(row[name] or 0.0 for row in found.values()) for name in TRACTION_GAPS]
    rows = [{"press": name, **row} for name, row in found.items()]
    passed = all(map(is_balanced, found.values())) and worst[-1] < worst[0]
    press = scenes["sharp punch to a load"]
    return section("balance", rows, passed=passed, press=press, worst=worst)


INTERFACE_REFINEMENTS = (1.0, 2.0, 3.0)
NODAL_ALLOWED = 1e-6
SUM_ALLOWED = 0.02
# Headings of what is judged; BELOW and ABOVE: integrals of sigma n.
NODAL = "force of the nodes below over F_z, less 1"
BELOW, ABOVE = "integral of sigma n below over F_z, less 1", "above"
JUMPS = ("jump of sigma n, continuous in each layer", "jump of sigma n, each element's own")


def interface_row(scene: Scene, *, refinement: float) -> dict[str, float]:
    """Press on one mesh, and return the numbers of its one interface by the table's headings."""
    result = press(scene, model=build_model(scene, refinement=refinement))
    model, positions = result.model, result.point.state.positions
    (interface,) = stress.interface_traction(model, positions)
    smooth = smooth_sides(model, positions, interface)
    below, above = (float(n[2] / result.force_n[2]) - 1.0 for n in forces_n(model, smooth))
    return {
        "edges of the preset over": refinement,
        "nodes": result.node_count,
        "F_z [N]": result.force_n[2],
        NODAL: abs(float(interface.force_n[2] / result.force_n[2]) - 1.0),
        BELOW: below,
        ABOVE: above,
        JUMPS[0]: smooth.jump_relative,
        JUMPS[1]: interface.element.jump_relative,
    }


def measure_interface(*, refinements: tuple[float, ...] = INTERFACE_REFINEMENTS) -> Table:
    """Press on ever finer meshes and compare the two sides."""
    press = _STATED["interface"]
    rows = [interface_row(scene_from(press), refinement=factor) for factor in refinements]
    shrinks = all(fine[name] < coarse[name] for coarse, fine in pairwise(rows) for name in JUMPS)
    sums = max(abs(rows[-1][name]) for name in (BELOW, ABOVE))
    passed = max(row[NODAL] for row in rows) < NODAL_ALLOWED and sums < SUM_ALLOWED and shrinks
    allowed = {"nodal": NODAL_ALLOWED, "sum": SUM_ALLOWED}
    return section("interface", rows, passed=passed, press=press, **allowed)


def smooth_sides(
    model: Model, positions: FloatArray, interface: stress.InterfaceTraction
) -> stress.StressOnSides:
    """Return the tractions of each layer's stress made continuous within it; there are two."""
    corners, points = interface.faces[:, :3], model.reference.face_points
    recovered = (
        stress.recovered_stress(model, positions, side)[corners]
        for side in (interface.below, ~interface.below)
    )
    below, above = (np.einsum("pc,fcij->fpij", points, each) for each in recovered)
    return stress.on_sides(model, positions, interface.faces, below, above)


def forces_n(model: Model, sides: stress.StressOnSides) -> tuple[FloatArray, FloatArray]:
    """Return the integrals of both tractions over the whole interface [N], shape [3] each."""
    below, above = (
        -model.mesh.symmetry.whole_force(np.einsum("fpi,fp->i", side, sides.areas_m2))
        for side in (sides.below_pa, sides.above_pa)
    )
    return below, above
