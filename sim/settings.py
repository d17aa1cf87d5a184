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
# Preset balanced takes about four times as long as fast; a mesh between them halves the step, so
# that a choice on the safe side costs about twice the time. Between balanced and accurate none
# helps: accurate with edges 1.12 times as long takes 1.6 times balanced's time and errs as much.
SETTINGS = (
    Setting(Preset.PAPER),
    FAST,
    Setting(Preset.BALANCED, 1.0 / 1.13),
    Setting(Preset.BALANCED),
    Setting(Preset.ACCURATE),
    Setting(Preset.REFERENCE),
)
