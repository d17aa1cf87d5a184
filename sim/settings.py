"""Settings that a tolerance may choose: the presets, and meshes between two of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sim.scene import Preset, Scene


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
COARSEST_BALANCED = Setting(Preset.BALANCED, 0.78)
# Neighbouring costs are about 1.2 to 1.8 times apart. The larger steps are where a turn gets four
# sectors more, 16 to 20 from the fourth to the fifth setting of fast and balanced. Left out, for
# they cost as much as another and err more: fast with edges 0.77 times as long, balanced 1.67,
# 1.43 and 1.11 times, accurate 1.39 and 1.5 times.
SETTINGS = (
    Setting(Preset.PAPER),
    Setting(Preset.FAST, 0.7),
    Setting(Preset.FAST, 0.85),
    FAST,
    Setting(Preset.FAST, 1.08),
    Setting(Preset.FAST, 1.15),
    COARSEST_BALANCED,
    Setting(Preset.BALANCED, 1.0 / 1.13),
    Setting(Preset.BALANCED, 0.94),
    Setting(Preset.BALANCED),
    Setting(Preset.BALANCED, 1.08),
    Setting(Preset.BALANCED, 1.12),
    Setting(Preset.ACCURATE),
    Setting(Preset.ACCURATE, 1.2),
    Setting(Preset.REFERENCE, 0.85),
    Setting(Preset.REFERENCE),
)
