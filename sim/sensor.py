"""Sensors: one TOML file each, every number with its uncertainty and source."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from sim.filling import Filling
from sim.layers import interface_shares
from sim.pad import BoxPad, Pad
from sim.scene import Layer, Material
from sim.sensor_optics import SensorOptics, parse_optics
from sim.sensor_pad import SURFACE_KEYS, filling_of, surface_of
from tacauchy_rig.errors import ConfigError
from tacauchy_rig.quantities import Dimension, parse_quantity


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """A number of a sensor file, SI, with its standard uncertainty and where it is from."""

    value: float
    uncertainty: float
    source: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraView:
    """How the camera sees the pad after its crop.

    Attributes:
        width: Image columns [px]; they run along the pad's x.
        height: Image rows [px]; they run along the pad's y.
        pixel_m: Size of a pixel on the gel, x and y [m].
        centre_m: Point of the pad in the middle of the image, x and y [m].
        crop: Part of the raw frame's width and height that is cut off at each border.
    """

    width: int
    height: int
    pixel_m: tuple[float, float]
    centre_m: tuple[float, float]
    crop: float = 0.0


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
        material: Of the whole gel, or of the layer that is touched.
        layers: From the clamped base upwards; empty for a gel of one material.
        filling: Settings of fTetWild.
        numbers: Every number of the file by its dotted name, for reports; layers count from 1.
    """

    name: str
    title: str
    pad: Pad
    material: Material
    layers: tuple[Layer, ...]
    camera: CameraView
    markers: MarkerGrid | None
    optics: SensorOptics
    filling: Filling
    numbers: dict[str, Measured]

    def young_uncertainty(self) -> tuple[float, str]:
        """Return the relative uncertainty of the stiffness and its source.

        A force scales with all moduli together, so that of a layered gel is no less certain than
        its least certain layer.
        """
        found = [number for name, number in self.numbers.items() if name.endswith(".young")]
        worst = max(found, key=lambda number: number.uncertainty / number.value)
        return worst.uncertainty / worst.value, worst.source


_MATERIAL = {"young": Dimension.PRESSURE, "poisson": Dimension.RATIO}
_DIMENSIONS = {
    "pad": dict.fromkeys(
        ("size_x", "size_y", "height", "dome_radius_x", "dome_radius_y"), Dimension.LENGTH
    ),
    "material": _MATERIAL,
    "camera": dict.fromkeys(("pixel_x", "pixel_y", "centre_x", "centre_y"), Dimension.LENGTH),
    "markers": dict.fromkeys(("pitch_x", "pitch_y", "radius"), Dimension.LENGTH),
}
_COUNTS = {"camera": ("width", "height"), "markers": ("columns", "rows")}
_PLAIN = {"camera": ("crop",)}
_OPTIONAL = {"pad.dome_radius_x", "pad.dome_radius_y"}


def sensor_names() -> list[str]:
    """Return the names of the built-in sensors."""
    folder = resources.files("sim.sensors")
    return sorted(f.name.removesuffix(".toml") for f in folder.iterdir() if f.name[-5:] == ".toml")


def load_sensor(name: str) -> Sensor:
    """Load a built-in sensor by name, or one from a TOML file by path.

    Raises:
        ConfigError: No such sensor, or its file has an unknown key, a wrong unit or a gap.
    """
    if name in sensor_names():
        text = resources.files("sim.sensors").joinpath(f"{name}.toml").read_text("utf-8")
        return parse_sensor(text, origin=f"sensor {name}")
    path = Path(name)
    if path.suffix != ".toml" or not path.is_file():
        raise ConfigError(
            f"sensor {name!r} is neither built in nor a TOML file",
            remedy=f"use one of {', '.join(sensor_names())}, or the path of a sensor file",
        )
    return parse_sensor(path.read_text("utf-8"), origin=str(path), folder=path.parent)


def parse_sensor(text: str, *, origin: str, folder: Path | None = None) -> Sensor:
    """Read a sensor file's text.

    Args:
        origin: Names it in messages.
        folder: Where the path of a pad's surface starts; None is the current folder.

    Raises:
        ConfigError: The text is not TOML, or has an unknown key, a wrong unit or a gap.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{origin}: not TOML: {error}", remedy="correct the line") from error
    _refuse_unknown(data, origin)
    numbers = _numbers(data, origin)
    counts = _counts(data, origin)

    def value(key: str) -> float:
        return numbers[key].value

    layers = _layers(data, numbers, origin)
    return Sensor(
        name=str(data["name"]),
        title=str(data["title"]),
        pad=_pad(data["pad"], numbers, origin, folder or Path()),
        material=layers[-1].material if layers else _material(numbers, "material"),
        layers=layers,
        camera=CameraView(
            width=counts["camera.width"],
            height=counts["camera.height"],
            pixel_m=(value("camera.pixel_x"), value("camera.pixel_y")),
            centre_m=(value("camera.centre_x"), value("camera.centre_y")),
            crop=_crop(data["camera"], origin),
        ),
        markers=_markers(numbers, counts),
        optics=parse_optics(data, origin),
        filling=filling_of(data.get("mesh", {}), origin=f"{origin}: mesh"),
        numbers=numbers,
    )


def _pad(section: dict[str, Any], numbers: dict[str, Measured], origin: str, folder: Path) -> Pad:
    if "surface" in section:
        return surface_of(section, origin=origin, folder=folder)
    sizes = [name for name in _DIMENSIONS["pad"] if f"pad.{name}" in numbers]
    given = {f"{name}_m": numbers[f"pad.{name}"].value for name in sizes}
    return BoxPad(**given)


def _material(numbers: dict[str, Measured], name: str) -> Material:
    young, poisson = (numbers[f"{name}.{key}"].value for key in _MATERIAL)
    return Material(young_pa=young, poisson=poisson)


def _layers(data: dict[str, Any], numbers: dict[str, Measured], origin: str) -> tuple[Layer, ...]:
    """Read the layers from the base upwards and note their numbers."""
    wanted = {"share": Dimension.RATIO, **_MATERIAL}
    layers = []
    for index, entry in enumerate(data.get("layers", []), start=1):
        name = f"layers.{index}"
        if set(entry) != set(wanted):
            raise ConfigError(
                f"{origin}: {name} has {', '.join(entry) or 'nothing'}",
                remedy=f"give {', '.join(wanted)}, no more and no less",
            )
        for key, dimension in wanted.items():
            numbers[f"{name}.{key}"] = _number(entry[key], f"{origin}: {name}.{key}", dimension)
        share = numbers[f"{name}.share"].value
        layers.append(Layer(share=share, material=_material(numbers, name)))
    try:
        interface_shares(layers)
    except ConfigError as error:
        raise ConfigError(f"{origin}: {error.message}", remedy=error.remedy) from error
    return tuple(layers)


def _crop(section: dict[str, Any], origin: str) -> float:
    value = section.get("crop", 0.0)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < 0.5:
        raise ConfigError(
            f"{origin}: camera.crop is {value!r}",
            remedy="give the part of the frame cut off at each border, such as 0.15; 0 is none",
        )
    return float(value)


def _markers(numbers: dict[str, Measured], counts: dict[str, int]) -> MarkerGrid | None:
    if "markers.columns" not in counts:
        return None
    return MarkerGrid(
        columns=counts["markers.columns"],
        rows=counts["markers.rows"],
        pitch_m=(numbers["markers.pitch_x"].value, numbers["markers.pitch_y"].value),
        radius_m=numbers["markers.radius"].value,
    )


def _refuse_unknown(data: dict[str, Any], origin: str) -> None:
    known = {"name", "title", "lamps", "layers", "optics", "mesh", *_DIMENSIONS}
    keys = [key for key in data if key not in known]
    for section, dimensions in _DIMENSIONS.items():
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


def _numbers(data: dict[str, Any], origin: str) -> dict[str, Measured]:
    found: dict[str, Measured] = {}
    for section, dimensions in _DIMENSIONS.items():
        if section not in data or "surface" in data[section]:
            continue
        for key, dimension in dimensions.items():
            name = f"{section}.{key}"
            if key in data[section]:
                found[name] = _number(data[section][key], f"{origin}: {name}", dimension)
            elif name not in _OPTIONAL:
                raise ConfigError(f"{origin}: no {name}", remedy="add it")
    return found


def _number(entry: Any, name: str, dimension: Dimension) -> Measured:
    if not isinstance(entry, dict) or set(entry) != {"value", "uncertainty", "source"}:
        raise ConfigError(
            f"{name} needs a value, an uncertainty and a source",
            remedy='write { value = "4 mm", uncertainty = "0.1 mm", source = "measured" }',
        )
    value, uncertainty = (
        parse_quantity(str(entry[part]), dimension=dimension, field=f"{name}.{part}").value
        for part in ("value", "uncertainty")
    )
    return Measured(value=value, uncertainty=uncertainty, source=str(entry["source"]))


def _counts(data: dict[str, Any], origin: str) -> dict[str, int]:
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
