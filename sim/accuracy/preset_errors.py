"""Measure what each preset's F_z is off by, for the file that ``sim.force_error`` reads."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from sim.accuracy.force_limit import force_limits, pressed_path
from sim.force_error import ForceErrorRow, indenter_kind
from sim.indenter import Cylinder, Indenter, Sphere, describe
from sim.scene import Preset, Scene, Target
from sim.sensor import load_sensor
from sim.settings import SETTINGS, Setting

DEPTH_SHARES = (0.3, 0.65, 1.0)
_TOLERANCE = 2e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class Training:
    """A press of the table, and the preset that its limit is found from."""

    scene: Scene
    finest: Preset


def training() -> tuple[Training, ...]:
    """Return the presses that the table is made of; each kind's first on preset reference too.

    Under a sharp rim stress is singular, its meshes are the largest, and no limit was found in an
    acceptable time: such a punch is not in the table.
    """
    punch, blunt = (
        Cylinder(diameter_m=5e-3, fillet_m=0.1e-3),
        Cylinder(diameter_m=4e-3, fillet_m=0.3e-3),
    )
    large, small = Sphere(diameter_m=15e-3), Sphere(diameter_m=8e-3)
    return (
        _training(punch, depth_m=0.7e-3, poisson=0.48, finest=Preset.REFERENCE),
        _training(blunt, depth_m=0.3e-3, poisson=0.45, finest=Preset.ACCURATE),
        _training(large, depth_m=0.7e-3, poisson=0.48, finest=Preset.REFERENCE),
        _training(small, depth_m=0.3e-3, poisson=0.45, finest=Preset.ACCURATE),
    )


def _training(indenter: Indenter, *, depth_m: float, poisson: float, finest: Preset) -> Training:
    """Return a press into a GelSight Mini with another Poisson's ratio; no effect is left out."""
    sensor = load_sensor("gelsight-mini")
    scene = Scene(
        pad=sensor.pad,
        material=replace(sensor.material, poisson=poisson),
        indenter=indenter,
        target=Target(depth_m=depth_m),
        tolerance=_TOLERANCE,
        sensor=sensor.name,
    )
    return Training(scene=scene, finest=finest)


def measure_preset_errors(
    presses: Sequence[Training],
    path: Path,
    *,
    on_progress: Callable[[str], None] = lambda _text: None,
) -> list[ForceErrorRow]:
    """Press every scene with every setting and write the rows to a JSON file; a quarter of an hour.

    Raises:
        RigError: A scene cannot be pressed.
    """
    rows: list[ForceErrorRow] = []
    for press in presses:
        on_progress(f"{describe(press.scene.indenter)}, nu {press.scene.material.poisson:g}")
        rows += _rows(press)
        path.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n", "utf-8")
    return rows


def _rows(press: Training) -> list[ForceErrorRow]:
    scene = press.scene
    deepest = scene.target.depth_m or 0.0
    depths = [share * deepest for share in DEPTH_SHARES]
    limits, finest = force_limits(scene, depths, finest=press.finest)
    rows = []
    for setting in SETTINGS:
        if setting.preset is Preset.REFERENCE and press.finest is not Preset.REFERENCE:
            continue
        is_finest = setting == Setting(press.finest)
        found = finest if is_finest else pressed_path(setting.applied(scene), depths)
        rows += [
            ForceErrorRow(
                kind=indenter_kind(scene.indenter),
                indenter=describe(scene.indenter),
                poisson=scene.material.poisson,
                preset=setting.preset,
                refinement=setting.refinement,
                depth_m=depth,
                depth_share=share,
                pad_share=depth / scene.pad.height_m,
                force_n=force,
                limit_n=limit.force_n,
                doubt=limit.doubt,
                cpu_s=found.cpu_s,
            )
            for depth, share, force, limit in zip(
                depths, DEPTH_SHARES, found.forces_n, limits, strict=True
            )
        ]
    return rows
