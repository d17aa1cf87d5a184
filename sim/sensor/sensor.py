"""Sensors: one TOML file each."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sim.scene.indenter import Indenter
from sim.scene.material import Layer, Material, RelaxationTerm, interface_shares
from sim.scene.pad import BoxPad, Pad, read_surface_pad
from sim.scene.scene import Scene, Target, TetWildOptions, tetwild_options_of
from sim.scene.triangle_surface import MeshUnit
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.lamps_and_optics import SensorOptics, parse_optics
from tacauchy_rig.core.errors import ConfigError, naming
from tacauchy_rig.core.quantities import Dimension, parse_quantity
from tacauchy_rig.core.registry import Kind, load, names, unknown

MATERIAL = {"young": Dimension.PRESSURE, "poisson": Dimension.RATIO}
DIMENSIONS = {
    "pad": dict.fromkeys(
        ("size_x", "size_y", "height", "dome_radius_x", "dome_radius_y"), Dimension.LENGTH
    ),
    "material": MATERIAL,
    "camera": {
        **dict.fromkeys(("pixel_x", "pixel_y", "centre_x", "centre_y"), Dimension.LENGTH),
        "rate": Dimension.FREQUENCY,
    },
    "markers": dict.fromkeys(("pitch_x", "pitch_y", "radius"), Dimension.LENGTH),
}
_PLAIN = {"camera": ("width", "height", "crop", "min_rate"), "markers": ("columns", "rows")}
_OPTIONAL = {"pad.dome_radius_x", "pad.dome_radius_y", "camera.rate"}
_LISTS = {"lamps", "layers", "relaxation"}
SURFACE_KEYS = ("surface", "unit", "source")


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """A number of a sensor file, SI, with its standard uncertainty and where it is from."""

    value: float
    uncertainty: float
    source: str


def _refuse_unknown(data: dict[str, Any]) -> None:
    """Refuse a file with a key that means nothing, or without one that it needs."""
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
        raise ConfigError(
            "both material and layers" if "material" in data else "neither material nor layers",
            remedy="give [material] for a gel of one material, else one [[layers]] a layer",
        )


def _numbers(data: dict[str, Any]) -> dict[str, Measured]:
    """Return the numbers of every section by their dotted names; layers are left out."""
    found: dict[str, Measured] = {}
    for section, dimensions in DIMENSIONS.items():
        if section not in data or "surface" in data[section]:
            continue
        for key, dimension in dimensions.items():
            name = f"{section}.{key}"
            if key in data[section]:
                found[name] = _number(data[section][key], name, dimension)
            elif name not in _OPTIONAL:
                raise ConfigError(f"no {name}", remedy="add it")
    return found


def _number(entry: Any, name: str, dimension: Dimension) -> Measured:
    """Return a number that has its unit, uncertainty and source."""
    if not isinstance(entry, dict) or set(entry) != {"value", "uncertainty", "source"}:
        shown = entry.get("value", "0.8") if isinstance(entry, dict) else entry
        raise ConfigError(
            f"{name} needs a value, an uncertainty and a source",
            remedy=f'write {name.rpartition(".")[2]} = {{ value = "{shown}", uncertainty = "its '
            'standard uncertainty, with its unit", source = "measured" }',
        )
    value, uncertainty = (
        parse_quantity(str(entry[part]), dimension=dimension, field=f"{name}.{part}")
        for part in ("value", "uncertainty")
    )
    return Measured(value=value, uncertainty=uncertainty, source=str(entry["source"]))


def _relaxation(entries: list[dict[str, Any]]) -> tuple[RelaxationTerm, ...]:
    """Read the ``[[relaxation]]`` tables, one a term of a Prony series of all of the gel."""
    terms = []
    for index, entry in enumerate(entries, start=1):
        name = f"relaxation.{index}"
        if set(entry) != {"share", "time", "source"}:
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
    if (total := sum(term.share for term in terms)) >= 1.0:
        raise ConfigError(
            f"the relaxation's shares sum to {total:g}",
            remedy="give shares of the stiffness that is there at once; together less than 1",
        )
    return tuple(terms)


def _count(table: Mapping[str, Any], section: str, key: str) -> int:
    """Return a whole number of a section's table."""
    count = table.get(key)
    if type(count) is not int or count < 1:
        raise ConfigError(
            f"{section}.{key} = {count!r} is not a whole number above 0",
            remedy="give a count such as 320",
        )
    return count


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerGrid:
    """Dots printed on the gel: a grid centred on the pad."""

    columns: int
    rows: int
    pitch_m: tuple[float, float]
    radius_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """A tactile sensor as its file says.

    Attributes:
        material: Material of the gel, or of the layer that touches the indenter.
        layers: Layers from the clamped base upwards; empty for a gel of one material.
        numbers: Every number of the file by its dotted name, for reports; layers count from 1.
    """

    name: str
    title: str
    pad: Pad
    material: Material
    layers: tuple[Layer, ...]
    camera: CameraGeometry
    markers: MarkerGrid | None
    optics: SensorOptics
    tetwild: TetWildOptions
    numbers: dict[str, Measured]

    def scene(self, indenter: Indenter, target: Target, **further: Any) -> Scene:
        """Return a press into this sensor; further fields of a scene overrule the sensor's own."""
        own = {name: getattr(self, name) for name in ("pad", "material", "layers", "tetwild")}
        return Scene(indenter=indenter, target=target, **{**own, "sensor": self.name, **further})

    def relaxing(self, terms: tuple[RelaxationTerm, ...]) -> Sensor:
        """Return the sensor with a gel, all of its layers, that relaxes by these terms."""
        return self._of(lambda material: replace(material, relaxation=terms))

    def stiffer(self, factor: float) -> Sensor:
        """Return the sensor with a gel, all of its layers, that is so many times as stiff."""
        return self._of(lambda material: replace(material, young_pa=factor * material.young_pa))

    def with_poisson(self, more: float) -> Sensor:
        """Return the sensor with this added to Poisson's ratio of its gel, of all of its layers.

        Raises:
            ConfigError: One is not below 0.5 then.
        """
        return self._of(lambda material: replace(material, poisson=material.poisson + more))

    def with_law(self, law: str) -> Sensor:
        """Return the sensor with a gel, all of its layers, that follows this law."""
        return self._of(lambda material: replace(material, law=law))

    def _of(self, changed: Callable[[Material], Material]) -> Sensor:
        layers = tuple(replace(layer, material=changed(layer.material)) for layer in self.layers)
        return replace(self, material=changed(self.material), layers=layers)

    def young_uncertainty(self) -> tuple[float, str]:
        """Return the relative uncertainty of the stiffness and its source.

        A force scales with all moduli together, so that of a layered gel is no less certain than
        its least certain layer.
        """
        found = [number for name, number in self.numbers.items() if name.endswith(".young")]
        worst = max(found, key=lambda number: number.uncertainty / number.value)
        return worst.uncertainty / worst.value, worst.source

    @property
    def least_certain_poisson(self) -> Measured:
        """Poisson's ratio of the layer where it is least certain."""
        found = [number for name, number in self.numbers.items() if name.endswith(".poisson")]
        return max(found, key=lambda number: number.uncertainty)


def load_sensor(name: str) -> Sensor:
    """Load a sensor by the name that the registry knows it by, or from a TOML file by path.

    Raises:
        ConfigError: No such sensor, or its file has an unknown key, a wrong unit or a gap.
    """
    if not unknown(Kind.SENSOR, name):
        file: Path = load(Kind.SENSOR, name)
        return parse_sensor(file.read_text("utf-8"), origin=f"sensor {name}", folder=file.parent)
    path = Path(name)
    if path.suffix != ".toml" or not path.is_file():
        raise ConfigError(
            f"sensor {name!r} is neither built in nor a TOML file in {Path.cwd()}",
            remedy=f"use one of {', '.join(names(Kind.SENSOR))}, or the path of a sensor file from "
            "the folder where the command is run",
        )
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"sensor {path} cannot be read: {error}", remedy="give a TOML file in UTF-8"
        ) from error
    return parse_sensor(text, origin=str(path), folder=path.parent)


def parse_sensor(text: str, *, origin: str, folder: Path | None = None) -> Sensor:
    """Read a sensor file's text; the path of a pad's surface starts in the folder.

    Raises:
        ConfigError: The text is not TOML, or has an unknown key, a wrong unit or a gap.
    """
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a whole number of 5000 digits, lists in lists
        raise ConfigError(f"{origin}: not TOML: {error}", remedy="correct the line") from error
    with naming(origin):
        _refuse_unknown(data)
        numbers = _numbers(data)
        layers = _layers(data, numbers)
        sensor: dict[str, Any] = {
            "name": str(data["name"]),
            "title": str(data["title"]),
            "pad": _pad(data["pad"], numbers, folder or Path()),
            "material": layers[-1].material if layers else _material(numbers, "material"),
            "layers": layers,
            "camera": _camera(data["camera"], numbers),
            "markers": _markers(data["markers"], numbers) if "markers" in data else None,
            "tetwild": tetwild_options_of(data.get("mesh", {}), origin="mesh"),
            "numbers": numbers,
        }
        terms = _relaxation(data.get("relaxation", []))
    return Sensor(**sensor, optics=parse_optics(data, origin)).relaxing(terms)


def _pad(table: dict[str, Any], numbers: dict[str, Measured], folder: Path) -> Pad:
    """Return a pad of stated sizes, or one that a mesh bounds, whose path starts in the folder."""
    if "surface" not in table:
        sizes = [name for name in DIMENSIONS["pad"] if f"pad.{name}" in numbers]
        return BoxPad(**{f"{name}_m": numbers[f"pad.{name}"].value for name in sizes})
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


def _material(numbers: dict[str, Measured], name: str) -> Material:
    young, poisson = (numbers[f"{name}.{key}"].value for key in MATERIAL)
    return Material(young_pa=young, poisson=poisson)


def _layers(data: dict[str, Any], numbers: dict[str, Measured]) -> tuple[Layer, ...]:
    """Read the layers from the base upwards and note their numbers."""
    wanted = {"share": Dimension.RATIO, **MATERIAL}
    layers = []
    for index, entry in enumerate(data.get("layers", []), start=1):
        name = f"layers.{index}"
        if set(entry) != set(wanted):
            raise ConfigError(
                f"{name} has {', '.join(entry) or 'nothing'}",
                remedy=f"give {', '.join(wanted)}, no more and no less",
            )
        for key, dimension in wanted.items():
            numbers[f"{name}.{key}"] = _number(entry[key], f"{name}.{key}", dimension)
        share = numbers[f"{name}.share"].value
        layers.append(Layer(share=share, material=_material(numbers, name)))
    interface_shares(layers)
    return tuple(layers)


def _camera(table: dict[str, Any], numbers: dict[str, Measured]) -> CameraGeometry:
    """Return the pixels after the crop; ``core.config.load`` reads the rates, checked here."""
    width, height = (_count(table, "camera", key) for key in ("width", "height"))
    pixel_x, pixel_y, centre_x, centre_y = (
        numbers[f"camera.{name}"].value for name in ("pixel_x", "pixel_y", "centre_x", "centre_y")
    )
    plain = {
        key: parse_quantity(str(table[key]), dimension=dimension, field=f"camera.{key}")
        for key, dimension in (("crop", Dimension.RATIO), ("min_rate", Dimension.FREQUENCY))
        if key in table
    }
    rate, least_hz = numbers.get("camera.rate"), plain.get("min_rate", 0.0)
    if rate is not None and least_hz > rate.value:
        raise ConfigError(
            f"camera.min_rate {least_hz:g} Hz is above camera.rate {rate.value:g} Hz",
            remedy="state the rate that the camera delivers, and the least that suffices",
        )
    return CameraGeometry(
        width=width,
        height=height,
        scale_x_m=pixel_x,
        scale_y_m=pixel_y,
        centre_x_px=0.5 * (width - 1) - centre_x / pixel_x,
        centre_y_px=0.5 * (height - 1) - centre_y / pixel_y,
        crop_fraction=plain.get("crop", 0.0),
    )


def _markers(table: dict[str, Any], numbers: dict[str, Measured]) -> MarkerGrid:
    return MarkerGrid(
        columns=_count(table, "markers", "columns"),
        rows=_count(table, "markers", "rows"),
        pitch_m=(numbers["markers.pitch_x"].value, numbers["markers.pitch_y"].value),
        radius_m=numbers["markers.radius"].value,
    )
