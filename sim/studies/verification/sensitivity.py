"""What F_z must hardly depend on: contact distance, a place between nodes, load or displacement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from sim.effects.presets import build_model, finest_edge_m
from sim.press import press
from sim.press_command import scene_from
from sim.replay import replay_forces, replay_scene
from sim.scene.indenter import Cylinder, Indenter, Sphere, describe
from sim.scene.scene import ContactMode, Drive, Preset, Scene
from sim.sensor.sensor import load_sensor
from sim.solve.load_steps.path import LoadingPath
from sim.studies.verification.prose import stated
from tacauchy_rig.tables import Table, table_of

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
_BARRIER_ALLOWED = 0.003
_SHIFT_ALLOWED = {Preset.BALANCED: 0.03, Preset.ACCURATE: 0.01}
_DRIVE_ALLOWED = 1e-3

_TOLERANCE_N = 0.01
# The paper's six forces (section IV-D) [N].
_FORCES_N = (1.2556, 1.9511, 2.6466, 3.3422, 4.0377, 4.7332)


@dataclass(frozen=True, slots=True, kw_only=True)
class BarrierLimit:
    """F_z of one scene at three contact distances.

    Attributes:
        forces_n: At the scene's own d_hat, half and a quarter of it [N].
    """

    scene: Scene
    forces_n: tuple[float, float, float]

    @property
    def limit_n(self) -> float:
        """F_z extrapolated to d_hat = 0 along the parabola through the three [N]."""
        whole, half, quarter = self.forces_n
        return (whole - 6.0 * half + 8.0 * quarter) / 3.0

    @property
    def difference(self) -> float:
        """How far the preset's F_z is from the limit, relative to it."""
        return abs(self.forces_n[0] / self.limit_n - 1.0)


def barrier_limit(scene: Scene) -> BarrierLimit:
    """Press a scene at its own d_hat, at half and at a quarter of it."""
    first, second, third = (
        press(replace(scene, barrier_m=share * scene.contact_distance_m)).force_n[2]
        for share in (1.0, 0.5, 0.25)
    )
    return BarrierLimit(scene=scene, forces_n=(first, second, third))


def measure_barrier() -> Table:
    """Extrapolate F_z to d_hat = 0 for a few presses."""
    scenes = [replace(_BARRIER_SCENE, indenter=indenter) for indenter in _INDENTERS]
    scenes.append(replace(_BARRIER_SCENE, contact=ContactMode.BONDED))
    found = [barrier_limit(scene) for scene in scenes]
    return table_of(
        found,
        {
            "indenter": lambda row: describe(row.scene.indenter),
            "contact": lambda row: row.scene.contact.value,
            "d_hat [um]": lambda row: row.scene.contact_distance_m * 1e6,
            "F_z [N]": lambda row: row.forces_n[0],
            "F_z, d_hat/2 [N]": lambda row: row.forces_n[1],
            "F_z, d_hat/4 [N]": lambda row: row.forces_n[2],
            "F_z, d_hat to 0 [N]": lambda row: row.limit_n,
            "difference": lambda row: row.difference,
        },
        **stated("barrier"),
        passed=all(row.difference < _BARRIER_ALLOWED for row in found),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ShiftedPress:
    """One mesh, the indenter in two places on it.

    Attributes:
        edge_m: Edge length at the indenter's rim or contact; the shift is half of it [m].
        force_n: F_z where the mesh was made for [N].
        shifted_n: F_z half an element to the side [N].
    """

    scene: Scene
    edge_m: float
    force_n: float
    shifted_n: float

    @property
    def change(self) -> float:
        """Relative change of F_z."""
        return abs(self.shifted_n / self.force_n - 1.0)


def shifted_press(scene: Scene) -> ShiftedPress:
    """Press a centred indenter on a mesh made for one half an element to its side, and that one."""
    edge = finest_edge_m(scene)
    aside = (0.5 * edge, 0.0)
    model = build_model(replace(scene, centre_m=aside))
    depth = scene.target.depth_m or 0.0
    force, shifted = (
        float(LoadingPath(model, scene.indenter, centre).advance(depth).force_n[2])
        for centre in (aside, (0.0, 0.0))
    )
    return ShiftedPress(scene=scene, edge_m=edge, force_n=force, shifted_n=shifted)


def measure_shift() -> Table:
    """Press each indenter in both places on each preset's mesh."""
    found = [
        shifted_press(replace(_SHIFT_SCENE, indenter=indenter, preset=preset))
        for preset in _SHIFT_ALLOWED
        for indenter in _INDENTERS
    ]
    return table_of(
        found,
        {
            "preset": lambda row: row.scene.preset.value,
            "indenter": lambda row: describe(row.scene.indenter),
            "edge [um]": lambda row: row.edge_m * 1e6,
            "F_z [N]": lambda row: row.force_n,
            "F_z moved [N]": lambda row: row.shifted_n,
            "change": lambda row: row.change,
            "allowed": lambda row: _SHIFT_ALLOWED[row.scene.preset],
        },
        **stated("shift"),
        passed=all(row.change < _SHIFT_ALLOWED[row.scene.preset] for row in found),
    )


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
    pairs = list(zip(load, search, strict=True))
    apart = [b.depth_simulated_m / a.depth_simulated_m - 1.0 for a, b in pairs]
    return table_of(
        zip(pairs, apart, strict=True),
        {
            "F_z [N]": lambda row: row[0][0].force_measured_n,
            "depth by load [mm]": lambda row: row[0][0].depth_simulated_m * 1e3,
            "depth by displacement [mm]": lambda row: row[0][1].depth_simulated_m * 1e3,
            "difference [%]": lambda row: 100.0 * row[1],
            "force left by displacement [N]": lambda row: (
                row[0][1].force_simulated_n - row[0][1].force_measured_n
            ),
            "iterations by load": lambda row: row[0][0].newton_iterations,
            "by displacement": lambda row: row[0][1].newton_iterations,
        },
        **stated("drives", preset=preset, sensor=sensor, body=body, tolerance=_TOLERANCE_N),
        passed=max(map(abs, apart)) <= _DRIVE_ALLOWED,
        command=f"tacauchy-rig press --sensor {sensor.name} --indenter {body} "
        f"--force {forces_n[0]:g}N --drive search --preset {preset.value}",
    )
