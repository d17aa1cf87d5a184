"""The gel's material as data: elastic constants, law, relaxation; layers, and where they meet."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import accumulate, combinations

from tacauchy_rig.core.errors import ConfigError

_SUM_TOLERANCE = 1e-9
_CONTRAST_COARSE = 100.0


class LawName(StrEnum):
    """Our own laws, by the names that the command line takes; other packages may bring more."""

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
    """Elastic constants of the gel."""

    young_pa: float  # Young's modulus E [Pa], that of slow loading where there is relaxation
    poisson: float  # Poisson's ratio nu, below 0.5
    law: str = LawName.STABLE_NEO_HOOKEAN
    density_kg_m3: float = 1000.0  # density [kg/m^3]
    relaxation: tuple[RelaxationTerm, ...] = ()  # Prony terms; empty for an elastic gel

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
    """A layer of a layered gel, bonded to the one below."""

    share: float
    material: Material


def interface_shares(layers: Sequence[Layer]) -> tuple[float, ...]:
    """Return the shares of the height at which layers meet, rising; none for one layer or none.

    Raises:
        ConfigError: A share is not positive, or they do not sum to one.
    """
    for number, layer in enumerate(layers, start=1):
        if not layer.share > 0.0:
            raise ConfigError(
                f"layer {number} from the base has a share of {layer.share:g} of the thickness",
                remedy="give each layer a share above 0, or leave the layer out",
            )
    total = sum(layer.share for layer in layers)
    if layers and abs(total - 1.0) > _SUM_TOLERANCE:
        listed = " + ".join(f"{layer.share:g}" for layer in layers)
        raise ConfigError(
            f"the layers' shares of the thickness sum to {listed} = {total:.10g}, not 1",
            remedy="give every layer from the base upwards; their shares fill the thickness",
        )
    return tuple(accumulate(layer.share for layer in layers[:-1]))


def law_name(material: Material, layers: Sequence[Layer]) -> str:
    """Return the one law of a gel; raise ConfigError if its layers follow different laws."""
    names = {layer.material.law for layer in layers} or {material.law}
    if len(names) > 1:
        listed = ", ".join(sorted(names))
        raise ConfigError(
            f"the layers follow different laws: {listed}",
            remedy="give all layers the same law; E and nu may differ",
        )
    return names.pop()


def sector_factor(layers: Sequence[Layer]) -> float:
    """Return how many times more sectors a revolved mesh needs for a stiff layer above a soft one.

    The stiff layer feels that a sector's quadratic displacement is not quite axisymmetric: under
    0.3 mm of skin, 100 times as stiff as its base, 16 and 32 sectors leave 8.8 and 4.7 %.
    """
    moduli = [layer.material.young_pa for layer in layers]
    contrast = max((high / low for low, high in combinations(moduli, 2)), default=1.0)
    return float(max(1.0, contrast / _CONTRAST_COARSE) ** 0.25)
