"""What a sensor file may say: its keys, its numbers, the pad's surface.

Messages name keys; who reads the file names that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.scene.material import RelaxationTerm
from sim.scene.pad import SurfacePad, read_surface_pad
from sim.scene.triangle_surface import MeshUnit
from tacauchy_rig.core.errors import ConfigError, naming
from tacauchy_rig.core.quantities import Dimension, parse_quantity

MATERIAL = {"young": Dimension.PRESSURE, "poisson": Dimension.RATIO}
DIMENSIONS = {
    "pad": dict.fromkeys(
        ("size_x", "size_y", "height", "dome_radius_x", "dome_radius_y"), Dimension.LENGTH
    ),
    "material": MATERIAL,
    "camera": dict.fromkeys(("pixel_x", "pixel_y", "centre_x", "centre_y"), Dimension.LENGTH),
    "markers": dict.fromkeys(("pitch_x", "pitch_y", "radius"), Dimension.LENGTH),
}
_PLAIN = {"camera": ("width", "height", "crop"), "markers": ("columns", "rows")}
_OPTIONAL = {"pad.dome_radius_x", "pad.dome_radius_y"}
_LISTS = {"lamps", "layers", "relaxation"}
SURFACE_KEYS = ("surface", "unit", "source")


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """A number of a sensor file, SI, with its standard uncertainty and where it is from."""

    value: float
    uncertainty: float
    source: str


def refuse_unknown(data: dict[str, Any]) -> None:
    """Refuse a file with a key that means nothing, or without one that it needs.

    Raises:
        ConfigError: The message names the keys.
    """
    known = {"name", "title", "lamps", "layers", "optics", "mesh", "relaxation", *DIMENSIONS}
    for key in data.keys() & known - {"name", "title"}:
        is_list = key in _LISTS
        entries = data[key] if is_list and isinstance(data[key], list) else [data[key]]
        if is_list != isinstance(data[key], list) or not all(isinstance(e, dict) for e in entries):
            form = f"[[{key}]], one a table" if is_list else f"[{key}]"
            raise ConfigError(f"{key} is no table: {data[key]!r:.60}", remedy=f"write {form}")
    keys = [key for key in data if key not in known]
    for section, dimensions in DIMENSIONS.items():
        allowed = {*dimensions, *_PLAIN.get(section, ())}
        if section == "pad" and "surface" in data.get("pad", {}):
            allowed = set(SURFACE_KEYS)
        keys += [f"{section}.{key}" for key in data.get(section, {}) if key not in allowed]
    missing = [key for key in ("name", "title", "pad", "camera") if key not in data]
    if keys:
        raise ConfigError(f"unknown {', '.join(keys)}", remedy="remove it or correct its spelling")
    if missing:
        raise ConfigError(f"no {', '.join(missing)}", remedy="add what is missing")
    if ("material" in data) == ("layers" in data):
        found = "both material and layers" if "material" in data else "neither material nor layers"
        raise ConfigError(
            found,
            remedy="give [material] for a gel of one material, else one [[layers]] a layer",
        )


def read_numbers(data: dict[str, Any]) -> dict[str, Measured]:
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
                found[name] = read_number(data[section][key], name, dimension)
            elif name not in _OPTIONAL:
                raise ConfigError(f"no {name}", remedy="add it")
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


def read_relaxation(entries: Any) -> tuple[RelaxationTerm, ...]:
    """Read the ``[[relaxation]]`` tables, one a term of a Prony series of all of the gel.

    Raises:
        ConfigError: One lacks share, time or source, or they are no such numbers.
    """
    terms = []
    for index, entry in enumerate(entries, start=1):
        name = f"relaxation.{index}"
        if not isinstance(entry, dict) or set(entry) != {"share", "time", "source"}:
            raise ConfigError(
                f"{name} needs a share, a time and a source",
                remedy='write share = "3 %", time = "0.3 s", source = "where it is from"',
            )
        share, time_s = (
            parse_quantity(str(entry[key]), dimension=dimension, field=f"{name}.{key}")
            for key, dimension in (("share", Dimension.RATIO), ("time", Dimension.TIME))
        )
        with naming(name):
            terms.append(RelaxationTerm(share=share, time_s=time_s))
    total = sum(term.share for term in terms)
    if total >= 1.0:
        raise ConfigError(
            f"the relaxation's shares sum to {total:g}",
            remedy="give shares of the stiffness that is there at once; together less than 1",
        )
    return tuple(terms)


def read_count(data: dict[str, Any], section: str, key: str) -> int:
    """Return a whole number of a section.

    Raises:
        ConfigError: It is missing or below 1.
    """
    count = data[section].get(key)
    if not isinstance(count, int) or count < 1:
        raise ConfigError(
            f"{section}.{key} = {count!r} is not a whole number above 0",
            remedy="give a count such as 320",
        )
    return count


def surface_of(table: Mapping[str, Any], folder: Path) -> SurfacePad:
    """Read ``surface = "gel.stl"``, ``unit = "mm"`` and ``source`` of ``[pad]``.

    A relative path starts in the folder.

    Raises:
        ConfigError: A key is missing or wrong, or the file bounds no pad.
    """
    missing = [key for key in SURFACE_KEYS if not str(table.get(key, "")).strip()]
    if missing:
        raise ConfigError(
            f"pad has a surface but no {', '.join(missing)}",
            remedy='write surface = "gel.stl", unit = "mm", source = "where it is from"',
        )
    unit = str(table["unit"])
    if unit not in set(MeshUnit):
        raise ConfigError(
            f"pad.unit = {unit!r} is no unit", remedy=f"one of: {', '.join(MeshUnit)}"
        )
    return read_surface_pad(folder / str(table["surface"]), unit=MeshUnit(unit))
