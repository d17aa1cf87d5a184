"""The gel's material as data: elastic constants, law, relaxation, layers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from tacauchy_rig.errors import ConfigError


class LawName(StrEnum):
    """Names as the command line takes them."""

    STABLE_NEO_HOOKEAN = "stable-neo-hookean"
    NEO_HOOKEAN = "neo-hookean"
    LINEAR = "linear"
    PAPER_EQ4 = "paper-eq4"


@dataclass(frozen=True, slots=True, kw_only=True)
class RelaxationTerm:
    """One term of a Prony series: this share of the stiffness is lost with this time constant."""

    share: float
    time_s: float

    def __post_init__(self) -> None:
        if not (0.0 < self.share < 1.0 and self.time_s > 0.0):
            raise ConfigError(
                f"relaxation term of share {self.share:g} and time {self.time_s:g} s",
                remedy="give a share between 0 and 1 and a time above 0 s",
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """Elastic constants of the gel.

    Attributes:
        young_pa: Young's modulus E [Pa], that of slow loading where there is relaxation.
        poisson: Poisson's ratio nu, below 0.5.
        density_kg_m3: Density [kg/m^3].
        relaxation: Prony terms; none for an elastic gel.
    """

    young_pa: float
    poisson: float
    law: LawName = LawName.STABLE_NEO_HOOKEAN
    density_kg_m3: float = 1000.0
    relaxation: tuple[RelaxationTerm, ...] = ()

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
class Layer:
    """A layer of a layered gel, bonded to the one below.

    Attributes:
        share: Its share of the pad's thickness.
    """

    share: float
    material: Material
