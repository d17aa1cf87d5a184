"""Settings of fTetWild that a user may give."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tacauchy_rig.core.errors import ConfigError, naming
from tacauchy_rig.core.quantities import Dimension, parse_quantity

_REGULAR_DIHEDRAL_RAD = math.acos(1.0 / 3.0)
_REGULAR_ENERGY = 3.0
# Of each setting as it is written: its field, dimension and range, and what is usual.
_SETTINGS = {
    "l_r": ("l_r", Dimension.RATIO, 0.0, 0.5, "the preset takes 0.05 to 0.1"),
    "epsilon_r": ("epsilon_r", Dimension.RATIO, 0.0, 0.01, "1e-3 is usual"),
    "stop_energy": ("stop_energy", Dimension.RATIO, _REGULAR_ENERGY, 1e3, "10 is usual"),
    "dihedral_min": (
        "dihedral_min_rad",
        Dimension.ANGLE,
        0.0,
        0.5 * _REGULAR_DIHEDRAL_RAD,
        "2 deg is the preset's",
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class TetWildOptions:
    """How fTetWild fills a pad; None leaves a setting to the preset.

    Attributes:
        l_r: Largest edge length over the bounding box's diagonal.
        epsilon_r: How far the surface may move over the bounding box's diagonal.
        stop_energy: AMIPS energy at which optimisation stops; 3 is a regular tetrahedron's.
        dihedral_min_rad: Least angle between faces of a tetrahedron that is accepted [rad].
    """

    l_r: float | None = None
    epsilon_r: float | None = None
    stop_energy: float | None = None
    dihedral_min_rad: float | None = None

    def __post_init__(self) -> None:
        for name, _, low, high, usual in _SETTINGS.values():
            value = getattr(self, name)
            if value is not None and not low < value <= high:
                raise ConfigError(
                    f"mesh setting {name} = {value:g} is not above {low:.4g} and at most "
                    f"{high:.4g}",
                    remedy=f"give one within; {usual}",
                )


def tetwild_options_of(table: Mapping[str, Any], *, origin: str) -> TetWildOptions:
    """Read fTetWild's settings: ``l_r``, ``epsilon_r``, ``stop_energy``, ``dihedral_min``.

    Raises:
        ConfigError: A setting is unknown, no number, or out of its range.
    """
    unknown = [key for key in table if key not in _SETTINGS]
    if unknown:
        raise ConfigError(
            f"{origin}: unknown mesh setting {', '.join(unknown)}",
            remedy=f"settings are {', '.join(_SETTINGS)}",
        )
    given = {
        name: parse_quantity(str(table[key]), dimension=dimension, field=f"{origin}: {key}")
        for key, (name, dimension, *_) in _SETTINGS.items()
        if key in table
    }
    with naming(origin):
        return TetWildOptions(**given)


def parse_tetwild_options(text: str) -> TetWildOptions:
    """Read ``l_r=0.08,epsilon_r=1e-3,stop_energy=10,dihedral_min=5deg``, each if wanted.

    Raises:
        ConfigError: A setting is unknown, no number, or out of its range.
    """
    given = dict(part.partition("=")[::2] for part in text.split(","))
    return tetwild_options_of(given, origin="--mesh")
