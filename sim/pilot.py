"""How much F_z is off on a scene's own meshes, found at small strains before it is pressed.

What a mesh makes of F_z at small strains is off by nearly what it makes of the real one, whatever
the press: Poisson's ratio, the pad's height, the rim and what the edges happen to cut act on both
alike. ``sim.force_error_fit`` has by how much. An error needs something to be held against: for
little time another mesh whose own error is guessed, the anchor; for more, the limit of finer ones.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from sim.effect_estimates import expected_depth
from sim.scene import Preset, Scene
from sim.settings import Setting
from sim.small_strain import SmallStrainForce, small_strain_force

ANCHOR = Setting(Preset.BALANCED, 1.0 / 1.13)
FINEST = Setting(Preset.ACCURATE)
_COARSENING = 1.5
_COARSER = Setting(FINEST.preset, FINEST.refinement / _COARSENING)
# Richardson 1911, at order 2.
_BEYOND = 1.0 / (_COARSENING**2 - 1.0)
_SOUNDING = Setting(Preset.FAST, 0.85)
_SOUNDINGS = 2
# F_z grows with the depth to a power of 1 under a flat end, 1.5 and more under a round one.
_POWER = 1.4


def is_piloted(setting: Setting) -> bool:
    """Return whether a setting can be judged: it is no finer than preset accurate."""
    if setting.preset in (Preset.PAPER, Preset.REFERENCE):
        return False
    return setting.preset is not FINEST.preset or setting.refinement <= FINEST.refinement


@dataclass(slots=True)
class Pilot:
    """F_z of one scene at small strains, on several meshes.

    Args:
        depth_m: Where [m].

    Attributes:
        forces_n: By setting, as far as they were asked for [N].
    """

    scene: Scene
    depth_m: float
    forces_n: dict[Setting, float] = field(default_factory=dict)
    _limit_n: float = 0.0
    _reach_m: float | None = None

    def over_anchor(self, setting: Setting) -> float:
        """Return a setting's F_z over the anchor's, less one.

        Raises:
            ConfigError: The scene cannot be meshed so.
        """
        return self._force(setting) / self._force(ANCHOR) - 1.0

    def error(self, setting: Setting) -> float:
        """Return the relative error of a setting that is no finer than preset accurate.

        Raises:
            ConfigError: The scene cannot be meshed so.
        """
        if self._limit_n == 0.0:
            coarser, finest = self._force(_COARSER), self._force(FINEST)
            self._limit_n = finest + _BEYOND * (finest - coarser)
        return self._force(setting) / self._limit_n - 1.0

    def _force(self, setting: Setting) -> float:
        if setting not in self.forces_n:
            tried = setting.applied(self.scene)
            found = small_strain_force(tried, depth_m=self.depth_m, reach_m=self._reach_m)
            self._reach_m = found.reach_m
            self.forces_n[setting] = found.force_n
        return self.forces_n[setting]


def pilot_depth(scene: Scene) -> float:
    """Return the depth of a scene's target, for a force from small strains on a coarse mesh [m].

    Raises:
        ConfigError: The scene cannot be meshed.
    """
    depth, force = expected_depth(scene), scene.target.force_n
    if force is None:
        return depth
    for _ in range(_SOUNDINGS):
        found: SmallStrainForce = small_strain_force(_SOUNDING.applied(scene), depth_m=depth)
        depth *= (force / found.force_n) ** (1.0 / _POWER)
    return depth
