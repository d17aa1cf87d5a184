"""Presses that are kept so that a long measurement can go on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from sim.scene.indenter import Sphere
from sim.scene.material import Material
from sim.scene.pad import BoxPad
from sim.scene.scene import Preset, Scene, Target
from sim.studies.accuracy import press_store
from sim.studies.accuracy.force_limit import PressedPath
from sim.studies.accuracy.press_store import PressStore

_SCENE = Scene(
    pad=BoxPad(size_x_m=20e-3, size_y_m=20e-3, height_m=4e-3),
    material=Material(young_pa=0.4e6, poisson=0.45),
    indenter=Sphere(diameter_m=8e-3),
    target=Target(depth_m=0.1e-3),
    preset=Preset.FAST,
    refinement=0.5,
)


def test_a_press_is_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second time it comes from the folder; another mesh or depth is another press."""
    made = []

    def counted(scene: Scene, depths_m: list[float]) -> PressedPath:
        made.append((scene, depths_m))
        return PressedPath(forces_n=(1.0,), cpu_s=0.5)

    monkeypatch.setattr(press_store, "pressed_path", counted)
    first = PressStore(folder=tmp_path).pressed_path(_SCENE, [1e-4])
    assert PressStore(folder=tmp_path).pressed_path(_SCENE, [1e-4]) == first
    assert len(made) == 1
    for scene, depth in ((replace(_SCENE, refinement=0.6), 1e-4), (_SCENE, 2e-4)):
        PressStore(folder=tmp_path).pressed_path(scene, [depth])
    assert len(made) == 3
