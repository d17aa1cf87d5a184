"""Sensors: one TOML file each."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sim.scene.indenter import Indenter
from sim.scene.material import Layer, Material, RelaxationTerm, interface_shares
from sim.scene.pad import BoxPad, Pad
from sim.scene.scene import Scene, Target
from sim.scene.tetwild_options import TetWildOptions, tetwild_options_of
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.optics import SensorOptics, parse_optics
from sim.sensor.tables import (
    DIMENSIONS,
    MATERIAL,
    Measured,
    read_count,
    read_number,
    read_numbers,
    read_relaxation,
    refuse_unknown,
    surface_of,
)
from tacauchy_rig.core.errors import ConfigError, naming
from tacauchy_rig.core.quantities import Dimension, parse_quantity
from tacauchy_rig.core.registry import Kind, load, names, unknown


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
    return parse_sensor(path.read_text("utf-8"), origin=str(path), folder=path.parent)


def parse_sensor(text: str, *, origin: str, folder: Path | None = None) -> Sensor:
    """Read a sensor file's text; the path of a pad's surface starts in the folder.

    Raises:
        ConfigError: The text is not TOML, or has an unknown key, a wrong unit or a gap.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{origin}: not TOML: {error}", remedy="correct the line") from error
    with naming(origin):
        refuse_unknown(data)
        numbers = read_numbers(data)
        layers = _layers(data, numbers)
        pad = _pad(data["pad"], numbers, folder or Path())
        camera, markers = _camera(data, numbers), _markers(data, numbers)
        tetwild = tetwild_options_of(data.get("mesh", {}), origin="mesh")
        terms = read_relaxation(data.get("relaxation", []))
    return Sensor(
        name=str(data["name"]),
        title=str(data["title"]),
        pad=pad,
        material=layers[-1].material if layers else _material(numbers, "material"),
        layers=layers,
        camera=camera,
        markers=markers,
        optics=parse_optics(data, origin),
        tetwild=tetwild,
        numbers=numbers,
    ).relaxing(terms)


def _pad(section: dict[str, Any], numbers: dict[str, Measured], folder: Path) -> Pad:
    if "surface" in section:
        return surface_of(section, folder)
    sizes = [name for name in DIMENSIONS["pad"] if f"pad.{name}" in numbers]
    return BoxPad(**{f"{name}_m": numbers[f"pad.{name}"].value for name in sizes})


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
            numbers[f"{name}.{key}"] = read_number(entry[key], f"{name}.{key}", dimension)
        share = numbers[f"{name}.share"].value
        layers.append(Layer(share=share, material=_material(numbers, name)))
    interface_shares(layers)
    return tuple(layers)


def _camera(data: dict[str, Any], numbers: dict[str, Measured]) -> CameraGeometry:
    """Return the pixels after the crop; ``centre`` is what of the pad is in the image's middle."""
    width, height = (read_count(data, "camera", key) for key in ("width", "height"))
    pixel_x, pixel_y, centre_x, centre_y = (
        numbers[f"camera.{name}"].value for name in ("pixel_x", "pixel_y", "centre_x", "centre_y")
    )
    crop = str(data["camera"].get("crop", 0.0))
    return CameraGeometry(
        width=width,
        height=height,
        scale_x_m=pixel_x,
        scale_y_m=pixel_y,
        centre_x_px=0.5 * (width - 1) - centre_x / pixel_x,
        centre_y_px=0.5 * (height - 1) - centre_y / pixel_y,
        crop_fraction=parse_quantity(crop, dimension=Dimension.RATIO, field="camera.crop"),
    )


def _markers(data: dict[str, Any], numbers: dict[str, Measured]) -> MarkerGrid | None:
    if "markers" not in data:
        return None
    return MarkerGrid(
        columns=read_count(data, "markers", "columns"),
        rows=read_count(data, "markers", "rows"),
        pitch_m=(numbers["markers.pitch_x"].value, numbers["markers.pitch_y"].value),
        radius_m=numbers["markers.radius"].value,
    )
