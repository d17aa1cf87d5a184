"""What F_z must hardly depend on: contact distance, a place between nodes, load or displacement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sim.effects.presets import build_model, finest_edge_m, regularised_indenter
from sim.press import press
from sim.press_command import scene_from
from sim.replay import replay_forces, replay_scene
from sim.scene.indenter import Cylinder, Indenter, Sphere, describe
from sim.scene.scene import ContactMode, Drive, Preset, Scene
from sim.sensor.sensor import load_sensor
from sim.solve.loading_path import LoadingPath
from sim.studies.verification import Row, section
from tacauchy_rig.core.tables import Table

_SHARP, _ROUNDED = Cylinder(diameter_m=5e-3), Cylinder(diameter_m=5e-3, fillet_m=0.1e-3)
_INDENTERS: tuple[Indenter, ...] = (_SHARP, _ROUNDED, Sphere(diameter_m=8e-3))
_BARRIER_SCENE, _SHIFT_SCENE = (
    scene_from(
        f"--pad {pad} --young 0.4MPa --poisson 0.48 --indenter cylinder:diameter=5mm "
        f"--depth {depth} --preset fast"
    )
    for pad, depth in (("box:20x24x4mm", "0.2mm"), ("box:16x16x4mm", "0.1mm"))
)
# Relative changes of F_z that are allowed, and of the depth between both drives.
# Preset fast's barrier is wide, and takes a part of its 5 %.
_BARRIER_ALLOWED = {Preset.BALANCED: 0.003, Preset.FAST: 0.02}
_SHIFT_ALLOWED = {Preset.BALANCED: 0.03, Preset.ACCURATE: 0.01}
_DRIVE_ALLOWED = 1e-3

_TOLERANCE_N = 0.01
# The paper's six forces (section IV-D) [N].
_FORCES_N = (1.2556, 1.9511, 2.6466, 3.3422, 4.0377, 4.7332)


def limit_without_distance(whole_n: float, half_n: float, quarter_n: float) -> float:
    """Return F_z at d_hat = 0 [N], along the parabola through it at d_hat, a half and a quarter."""
    return (whole_n - 6.0 * half_n + 8.0 * quarter_n) / 3.0


def barrier_row(scene: Scene) -> Row:
    """Press a scene at its own d_hat, at half and at a quarter of it."""
    first, second, third = (
        press(replace(scene, barrier_m=share * scene.contact_distance_m)).force_n[2]
        for share in (1.0, 0.5, 0.25)
    )
    limit = limit_without_distance(first, second, third)
    return {
        "indenter": describe(scene.indenter),
        "contact": scene.contact.value,
        "d_hat [um]": scene.contact_distance_m * 1e6,
        "F_z [N]": first,
        "F_z, d_hat/2 [N]": second,
        "F_z, d_hat/4 [N]": third,
        "F_z, d_hat to 0 [N]": limit,
        "difference": abs(first / limit - 1.0),
    }


def measure_barrier() -> Table:
    """Extrapolate F_z to d_hat = 0 for a few presses."""
    rows = []
    for preset, allowed in _BARRIER_ALLOWED.items():
        press_of = replace(_BARRIER_SCENE, preset=preset)
        scenes = [replace(press_of, indenter=indenter) for indenter in _INDENTERS]
        scenes.append(replace(press_of, contact=ContactMode.BONDED))
        rows += [
            {"preset": preset.value, **barrier_row(scene), "allowed": allowed} for scene in scenes
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
    rows = [
        shift_row(replace(_SHIFT_SCENE, indenter=indenter, preset=preset)) | {"allowed": allowed}
        for preset, allowed in _SHIFT_ALLOWED.items()
        for indenter in _INDENTERS
    ]
    return section("shift", rows, passed=_is_below("change", rows))


def measure_drives(
    *, preset: Preset = Preset.BALANCED, forces_n: Sequence[float] = _FORCES_N
) -> Table:
    """Reach every force by load and by displacement."""
    sensor, body = load_sensor("gelsight-mini"), describe(_ROUNDED)
    scene = replay_scene(sensor, _ROUNDED, forces_n, preset=preset, tolerance_n=_TOLERANCE_N)
    load, search = (
        replay_forces(replace(scene, drive=drive), forces_n)[0].trials
        for drive in (Drive.LOAD, Drive.SEARCH)
    )
    rows, worst = list[Row](), 0.0
    for by_load, by_search in zip(load, search, strict=True):
        apart = by_search.depth_simulated_m / by_load.depth_simulated_m - 1.0
        rows.append(
            {
                "F_z [N]": by_load.force_measured_n,
                "depth by load [mm]": by_load.depth_simulated_m * 1e3,
                "depth by displacement [mm]": by_search.depth_simulated_m * 1e3,
                "difference [%]": 100.0 * apart,
                "force left by displacement [N]": (
                    by_search.force_simulated_n - by_search.force_measured_n
                ),
                "iterations by load": by_load.newton_iterations,
                "by displacement": by_search.newton_iterations,
            }
        )
        worst = max(worst, abs(apart))
    words = f"--sensor {sensor.name} --indenter {body} --force {forces_n[0]:g}N --drive search"
    facts = {"preset": preset, "sensor": sensor, "body": body, "tolerance": _TOLERANCE_N}
    passed, words = worst <= _DRIVE_ALLOWED, f"{words} --preset {preset.value}"
    return section("drives", rows, passed=passed, press=words, **facts)
