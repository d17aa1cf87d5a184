"""Forces of one press, counted in four ways."""

from __future__ import annotations

from dataclasses import replace

from sim.scene.indenter import Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Preset, Scene, Target
from sim.studies.verification.balance import TRACTION_GAPS, balanced_press, is_balanced

SCENE = Scene(
    pad=DiscPad(radius_m=5e-3, height_m=3e-3),
    material=Material(young_pa=3e5, poisson=0.46),
    indenter=Sphere(diameter_m=5e-3),
    target=Target(depth_m=0.05e-3),
    preset=Preset.FAST,
)


def test_forces_agree_and_stress_follows() -> None:
    """Base, load and indenter agree to 1e-6; the surface's stress carries the force roughly."""
    scene = replace(SCENE, target=Target(force_n=0.01))
    found = balanced_press(scene)
    assert is_balanced(found)
    assert 0.0 < max(found[name] or 0.0 for name in TRACTION_GAPS) < 0.1
