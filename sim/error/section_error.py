"""How much F_z is off on a scene's mesh, found at small strains on its section through the axis.

What the edges in that section make of F_z at small strains is off by nearly what the mesh makes of
the real press: Poisson's ratio, the pad's height, the rim, the barrier and what the edges happen to
cut act on both alike. A section has some hundred unknowns where the mesh has thousands, so that it
takes milliseconds. ``sim.error.fit`` has by how much the two differ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

from sim.contact.state import ContactOptions
from sim.effects.estimates import expected_depth
from sim.effects.mesh_choice import contact_reach
from sim.effects.presets import section_for
from sim.error.axisymmetric import AxisymmetricGel, Bed
from sim.scene.indenter import Cylinder, Sphere, grown
from sim.scene.material import Material
from sim.scene.scene import BARRIER_M, Preset, Scene

# What is left of its error is the same for all settings of a press. Finer ones, or the limit that
# two tend to, foretell the errors of the training presses no better, and take longer.
_FINE = 3.0
_REACH_SHARE = 1.2
_KEPT = 256
_ROUNDS = 4
# F_z grows with the depth to a power of 1 under a flat end, 1.5 and more under a round one.
_POWER = 1.4


@dataclass(frozen=True, slots=True)
class _Pressed:
    """A section's gel and what presses on it."""

    gel: AxisymmetricGel
    bed: Bed


def section_error(scene: Scene, *, depth_m: float) -> float:
    """Return the relative error of F_z at a depth that the edges in a scene's section make.

    Args:
        depth_m: Travel of the tip below first touch [m], above zero.

    Raises:
        ConfigError: The scene cannot be meshed.
    """
    bare = _bare(scene)
    pressed = _pressed(replace(bare, preset=scene.preset, refinement=scene.refinement))
    return pressed.gel.force(pressed.bed, depth_m=depth_m) / _limit_n(bare, depth_m) - 1.0


def section_depth(scene: Scene) -> float:
    """Return the depth of a scene's target, for a force that at small strains on its section [m].

    Raises:
        ConfigError: The scene cannot be meshed.
    """
    depth, force = expected_depth(scene), scene.target.force_n
    if force is None:
        return depth
    pressed = _pressed(_bare(scene))
    for _ in range(_ROUNDS):
        found = scene.material.young_pa * pressed.gel.force(pressed.bed, depth_m=depth)
        depth *= (force / found) ** (1.0 / _POWER)
    return depth


def section_force(scene: Scene, *, depth_m: float) -> float:
    """Return F_z at a depth at small strains, on a section that is fine enough [N].

    Raises:
        ConfigError: The scene cannot be meshed.
    """
    return scene.material.young_pa * _limit_n(_bare(scene), depth_m)


def _bare(scene: Scene) -> Scene:
    """Return what of a scene its section's force depends on, with E = 1 Pa, on preset fast."""
    return Scene(
        pad=scene.pad,
        material=Material(young_pa=1.0, poisson=scene.material.poisson),
        indenter=scene.indenter,
        target=replace(scene.target, force_n=None if scene.target.force_n is None else 1.0),
        centre_m=scene.centre_m,
        preset=Preset.FAST,
    )


@lru_cache(maxsize=_KEPT)
def _limit_n(bare: Scene, depth_m: float) -> float:
    """Return the force on a section that is fine enough, with a narrow barrier."""
    pressed = _pressed(replace(bare, refinement=_FINE, barrier_m=BARRIER_M))
    return pressed.gel.force(pressed.bed, depth_m=depth_m)


@lru_cache(maxsize=_KEPT)
def _pressed(bare: Scene) -> _Pressed:
    indenter = bare.indenter
    distance, height = bare.contact_distance_m, bare.pad.height_m
    if isinstance(indenter, Cylinder | Sphere):
        indenter = grown(indenter, distance)
    reach = _REACH_SHARE * contact_reach(bare)
    stiffness = ContactOptions().stiffness_factor * bare.material.young_pa / distance
    return _Pressed(
        AxisymmetricGel(
            section_for(bare),
            height_m=height,
            young_pa=bare.material.young_pa,
            poisson=bare.material.poisson,
            reach_m=reach,
        ),
        Bed(indenter=indenter, stiffness_pa_m=stiffness),
    )
