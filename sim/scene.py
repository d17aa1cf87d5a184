"""A scene as plain data: what is pressed into what, how far, and how well it must be known."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from sim.indenter import Indenter
from sim.laws.catalogue import LawName
from sim.pad import Pad
from tacauchy_rig.errors import ConfigError


class ContactMode(StrEnum):
    """What touching points may do along the indenter."""

    FRICTIONLESS = "frictionless"
    BONDED = "bonded"


class Preset(StrEnum):
    """Mesh and element together: what accuracy to pay for."""

    FAST = "fast"
    BALANCED = "balanced"
    ACCURATE = "accurate"
    PAPER = "paper"
    REFERENCE = "reference"


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """Elastic constants of the gel.

    Attributes:
        young_pa: Young's modulus E [Pa].
        poisson: Poisson's ratio nu, below 0.5.
    """

    young_pa: float
    poisson: float
    law: LawName = LawName.STABLE_NEO_HOOKEAN

    def __post_init__(self) -> None:
        if not self.young_pa > 0.0:
            raise ConfigError(
                f"Young's modulus {self.young_pa:g} Pa is not positive", remedy="give E above 0"
            )
        if not 0.0 <= self.poisson < 0.5:
            raise ConfigError(
                f"Poisson's ratio {self.poisson:g} is not in [0, 0.5)",
                remedy="give nu below 0.5; 0.499 is the highest that is tested",
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """Where the press ends: at a depth or at a force, exactly one of them.

    Attributes:
        depth_m: Travel of the tip below first touch of the undeformed pad [m].
        force_n: Pressing force F_z [N].
    """

    depth_m: float | None = None
    force_n: float | None = None

    def __post_init__(self) -> None:
        if (self.depth_m is None) == (self.force_n is None):
            raise ConfigError(
                "a press needs either a depth or a force", remedy="give exactly one of the two"
            )
        value = self.depth_m if self.depth_m is not None else self.force_n
        if value is not None and not value >= 0.0:
            raise ConfigError(f"press target {value:g} is negative", remedy="give 0 or more")


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """One press.

    Attributes:
        centre_m: Where the indenter's tip comes down, x and y in the pad's frame [m].
        force_tolerance_n: How closely a force target is met [N].
        barrier_m: Contact distance d_hat [m], a numerical setting: the gel stays about this far
            from the indenter, which adds as much to the depth it feels.
        sensor: Name of the sensor, for reports; empty for a bare pad.
    """

    pad: Pad
    material: Material
    indenter: Indenter
    target: Target
    centre_m: tuple[float, float] = (0.0, 0.0)
    contact: ContactMode = ContactMode.FRICTIONLESS
    preset: Preset = Preset.BALANCED
    force_tolerance_n: float = 1e-3
    barrier_m: float = 1e-6
    sensor: str = ""
