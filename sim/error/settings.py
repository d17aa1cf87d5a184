"""Settings that a tolerance may choose: the presets, and meshes between two of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sim.scene.scene import Preset, Scene


@dataclass(frozen=True, slots=True)
class Setting:
    """A preset, and how many times shorter than its own every edge is."""

    preset: Preset
    refinement: float = 1.0

    def __str__(self) -> str:
        if self.refinement == 1.0:
            return self.preset.value
        return f"{self.preset.value}, edges {1.0 / self.refinement:.3g} times as long"

    def applied(self, scene: Scene) -> Scene:
        """Return a scene with these settings."""
        return replace(scene, preset=self.preset, refinement=self.refinement)


def setting_of(scene: Scene) -> Setting:
    """Return a scene's settings."""
    return Setting(scene.preset, scene.refinement)


FAST = Setting(Preset.FAST)
# Neighbouring costs are 1.3 to 1.8 times apart.
LADDER = tuple(
    Setting(Preset.FAST, refinement)
    for refinement in (0.62, 0.75, 0.9, 1.0, 1.18, 1.4, 1.6, 1.8, 2.0, 2.2, 2.5, 2.85, 3.3)
)
SETTINGS = (
    Setting(Preset.PAPER),
    *LADDER,
    Setting(Preset.BALANCED),
    Setting(Preset.ACCURATE),
    Setting(Preset.REFERENCE),
)
