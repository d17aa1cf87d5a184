"""What a sensor file may say about its pad's surface and its mesh."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sim.scene.pad import SurfacePad, read_surface_pad
from sim.scene.tetwild_options import TetWildOptions
from sim.scene.triangle_file import MeshUnit
from tacauchy_rig.errors import ConfigError
from tacauchy_rig.quantities import Dimension, parse_quantity

SURFACE_KEYS = ("surface", "unit", "source")
_TETWILD = {
    "l_r": Dimension.RATIO,
    "epsilon_r": Dimension.RATIO,
    "stop_energy": Dimension.RATIO,
    "dihedral_min": Dimension.ANGLE,
}


def surface_of(section: Mapping[str, Any], *, origin: str, folder: Path) -> SurfacePad:
    """Read ``surface = "gel.stl"``, ``unit = "mm"`` and ``source`` of a section ``[pad]``.

    Args:
        origin: The sensor file, for messages.
        folder: Where a relative path starts.

    Raises:
        ConfigError: A key is missing or wrong, or the file bounds no pad.
    """
    missing = [key for key in SURFACE_KEYS if not str(section.get(key, "")).strip()]
    if missing:
        raise ConfigError(
            f"{origin}: pad has a surface but no {', '.join(missing)}",
            remedy='write surface = "gel.stl", unit = "mm", source = "where it is from"',
        )
    unit = str(section["unit"])
    if unit not in set(MeshUnit):
        raise ConfigError(
            f"{origin}: pad.unit = {unit!r} is no unit", remedy=f"one of: {', '.join(MeshUnit)}"
        )
    try:
        return read_surface_pad(folder / str(section["surface"]), unit=MeshUnit(unit))
    except ConfigError as error:
        raise ConfigError(f"{origin}: {error.message}", remedy=error.remedy) from error


def tetwild_options_of(section: Mapping[str, Any], *, origin: str) -> TetWildOptions:
    """Read fTetWild's settings: ``l_r``, ``epsilon_r``, ``stop_energy``, ``dihedral_min``.

    Raises:
        ConfigError: A setting is unknown, no number, or out of its range.
    """
    unknown = [key for key in section if key not in _TETWILD]
    if unknown:
        raise ConfigError(
            f"{origin}: unknown mesh setting {', '.join(unknown)}",
            remedy=f"settings are {', '.join(_TETWILD)}",
        )
    given = {
        key: parse_quantity(str(value), dimension=_TETWILD[key], field=f"{origin}: {key}").value
        for key, value in section.items()
    }
    try:
        return TetWildOptions(
            l_r=given.get("l_r"),
            epsilon_r=given.get("epsilon_r"),
            stop_energy=given.get("stop_energy"),
            dihedral_min_rad=given.get("dihedral_min"),
        )
    except ConfigError as error:
        raise ConfigError(f"{origin}: {error.message}", remedy=error.remedy) from error
