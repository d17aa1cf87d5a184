"""What a sensor file may say: its keys, its numbers, the pad's surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.scene.material import RelaxationTerm
from sim.scene.pad import SurfacePad, read_surface_pad
from sim.scene.triangle_file import MeshUnit
from tacauchy_rig.errors import ConfigError, naming
from tacauchy_rig.quantities import Dimension, parse_quantity

MATERIAL = {"young": Dimension.PRESSURE, "poisson": Dimension.RATIO}
DIMENSIONS = {
    "pad": dict.fromkeys(
        ("size_x", "size_y", "height", "dome_radius_x", "dome_radius_y"), Dimension.LENGTH
    ),
    "material": MATERIAL,
    "camera": dict.fromkeys(("pixel_x", "pixel_y", "centre_x", "centre_y"), Dimension.LENGTH),
    "markers": dict.fromkeys(("pitch_x", "pitch_y", "radius"), Dimension.LENGTH),
}
_COUNTS = {"camera": ("width", "height"), "markers": ("columns", "rows")}
_PLAIN = {"camera": ("crop",)}
_OPTIONAL = {"pad.dome_radius_x", "pad.dome_radius_y"}
SURFACE_KEYS = ("surface", "unit", "source")


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """A number of a sensor file, SI, with its standard uncertainty and where it is from."""

    value: float
    uncertainty: float
    source: str


def refuse_unknown(data: dict[str, Any], origin: str) -> None:
    """Refuse a file with a key that means nothing, or without one that it needs.

    Raises:
        ConfigError: The message names the keys.
    """
    known = {"name", "title", "lamps", "layers", "optics", "mesh", "relaxation", *DIMENSIONS}
    keys = [key for key in data if key not in known]
    for section, dimensions in DIMENSIONS.items():
        allowed = {*dimensions, *_COUNTS.get(section, ()), *_PLAIN.get(section, ())}
        if section == "pad" and "surface" in data.get("pad", {}):
            allowed = set(SURFACE_KEYS)
        keys += [f"{section}.{key}" for key in data.get(section, {}) if key not in allowed]
    missing = [key for key in ("name", "title", "pad", "camera") if key not in data]
    if keys:
        raise ConfigError(
            f"{origin}: unknown {', '.join(keys)}", remedy="remove it or correct its spelling"
        )
    if missing:
        raise ConfigError(f"{origin}: no {', '.join(missing)}", remedy="add what is missing")
    if ("material" in data) == ("layers" in data):
        found = "both material and layers" if "material" in data else "neither material nor layers"
        raise ConfigError(
            f"{origin}: {found}",
            remedy="give [material] for a gel of one material, else one [[layers]] a layer",
        )


def read_numbers(data: dict[str, Any], origin: str) -> dict[str, Measured]:
    """Return the numbers of every section by their dotted names; layers are left out.

    Raises:
        ConfigError: A number is missing, or lacks its unit, uncertainty or source.
    """
    found: dict[str, Measured] = {}
    for section, dimensions in DIMENSIONS.items():
        if section not in data or "surface" in data[section]:
            continue
        for key, dimension in dimensions.items():
            name = f"{section}.{key}"
            if key in data[section]:
                found[name] = read_number(data[section][key], f"{origin}: {name}", dimension)
            elif name not in _OPTIONAL:
                raise ConfigError(f"{origin}: no {name}", remedy="add it")
    return found


def read_number(entry: Any, name: str, dimension: Dimension) -> Measured:
    """Return one number.

    Raises:
        ConfigError: It lacks its unit, uncertainty or source.
    """
    if not isinstance(entry, dict) or set(entry) != {"value", "uncertainty", "source"}:
        raise ConfigError(
            f"{name} needs a value, an uncertainty and a source",
            remedy='write { value = "4 mm", uncertainty = "0.1 mm", source = "measured" }',
        )
    value, uncertainty = (
        parse_quantity(str(entry[part]), dimension=dimension, field=f"{name}.{part}")
        for part in ("value", "uncertainty")
    )
    return Measured(value=value, uncertainty=uncertainty, source=str(entry["source"]))


def read_relaxation(entries: Any, origin: str) -> tuple[RelaxationTerm, ...]:
    """Read the ``[[relaxation]]`` tables, one a term of a Prony series of all of the gel.

    Raises:
        ConfigError: One lacks share, time or source, or they are no such numbers.
    """
    terms = []
    for index, entry in enumerate(entries, start=1):
        name = f"relaxation.{index}"
        if not isinstance(entry, dict) or set(entry) != {"share", "time", "source"}:
            raise ConfigError(
                f"{origin}: {name} needs a share, a time and a source",
                remedy='write share = "3 %", time = "0.3 s", source = "where it is from"',
            )
        share, time_s = (
            parse_quantity(str(entry[key]), dimension=dimension, field=f"{origin}: {name}.{key}")
            for key, dimension in (("share", Dimension.RATIO), ("time", Dimension.TIME))
        )
        with naming(f"{origin}: {name}"):
            terms.append(RelaxationTerm(share=share, time_s=time_s))
    total = sum(term.share for term in terms)
    if total >= 1.0:
        raise ConfigError(
            f"{origin}: the relaxation's shares sum to {total:g}",
            remedy="give shares of the stiffness that is there at once; together less than 1",
        )
    return tuple(terms)


def read_counts(data: dict[str, Any], origin: str) -> dict[str, int]:
    """Return the whole numbers by their dotted names.

    Raises:
        ConfigError: One is missing or below 1.
    """
    found: dict[str, int] = {}
    for section, keys in _COUNTS.items():
        for key in keys if section in data else ():
            count = data[section].get(key)
            if not isinstance(count, int) or count < 1:
                raise ConfigError(
                    f"{origin}: {section}.{key} = {count!r} is not a whole number above 0",
                    remedy="give a count such as 320",
                )
            found[f"{section}.{key}"] = count
    return found


def surface_of(table: Mapping[str, Any], *, origin: str, folder: Path) -> SurfacePad:
    """Read ``surface = "gel.stl"``, ``unit = "mm"`` and ``source`` of ``[pad]``.

    Args:
        origin: The sensor file, for messages.
        folder: Where a relative path starts.

    Raises:
        ConfigError: A key is missing or wrong, or the file bounds no pad.
    """
    missing = [key for key in SURFACE_KEYS if not str(table.get(key, "")).strip()]
    if missing:
        raise ConfigError(
            f"{origin}: pad has a surface but no {', '.join(missing)}",
            remedy='write surface = "gel.stl", unit = "mm", source = "where it is from"',
        )
    unit = str(table["unit"])
    if unit not in set(MeshUnit):
        raise ConfigError(
            f"{origin}: pad.unit = {unit!r} is no unit", remedy=f"one of: {', '.join(MeshUnit)}"
        )
    with naming(origin):
        return read_surface_pad(folder / str(table["surface"]), unit=MeshUnit(unit))
