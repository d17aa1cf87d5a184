"""Sensors: one TOML file each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar

from pydantic import Field

from sim.scene.indenter import Indenter
from sim.scene.material import Layer, Material, RelaxationTerm, interface_shares
from sim.scene.pad import BoxPad, Pad, read_surface_pad
from sim.scene.scene import Scene, Target, TetWildOptions, tetwild_options_of
from sim.scene.triangle_surface import MeshUnit
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.lamps_and_optics import SensorOptics, parse_optics
from tacauchy_rig.core.config.field_ranges import Frequency, Length, Pressure, Ratio, Section, Time
from tacauchy_rig.core.config.load import parse_toml, read_section, read_toml
from tacauchy_rig.core.errors import ConfigError, naming
from tacauchy_rig.core.registry import Kind, load, names, unknown

_REMEDY = (
    'write a number as { value = "4 mm", uncertainty = "0.1 mm", source = "measured" }; '
    "docs/reference/sensor-file.md lists the keys"
)
T = TypeVar("T")
_Count = Annotated[int, Field(ge=1, strict=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """A number of a sensor file, SI, with its standard uncertainty and where it is from."""

    value: float
    uncertainty: float
    source: str


class _Number(Section, Generic[T]):
    """A number as the file has it."""

    value: T
    uncertainty: T
    source: str


class _Pad(Section):
    size_x: _Number[Length]
    size_y: _Number[Length]
    height: _Number[Length]
    dome_radius_x: _Number[Length] | None = None
    dome_radius_y: _Number[Length] | None = None


class _Surface(Section):
    surface: str = Field(min_length=1)
    unit: MeshUnit
    source: str = Field(min_length=1)


class _Gel(Section):
    young: _Number[Pressure]
    poisson: _Number[Ratio]


class _Layer(_Gel):
    share: _Number[Ratio]


class _Relaxation(Section):
    share: Ratio
    time: Time
    source: str


class _Camera(Section):
    width: _Count
    height: _Count
    pixel_x: _Number[Length]
    pixel_y: _Number[Length]
    centre_x: _Number[Length]
    centre_y: _Number[Length]
    rate: _Number[Frequency] | None = None
    crop: Ratio = 0.0
    min_rate: Frequency = Field(default=0.0, validate_default=False)


class _Markers(Section):
    columns: _Count
    rows: _Count
    pitch_x: _Number[Length]
    pitch_y: _Number[Length]
    radius: _Number[Length]


class _File(Section):
    """A sensor file; ``sim.sensor.lamps_and_optics`` reads lamps and optics."""

    name: str
    title: str
    pad: _Pad
    material: _Gel | None = None
    camera: _Camera
    markers: _Markers | None = None
    layers: tuple[_Layer, ...] = ()
    relaxation: tuple[_Relaxation, ...] = ()
    lamps: tuple[dict[str, Any], ...] = ()
    optics: dict[str, Any] = Field(default_factory=dict)
    mesh: dict[str, Any] = Field(default_factory=dict)


class _SurfaceFile(_File):
    pad: _Surface  # type: ignore[assignment]


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

    def with_gel(self, **changes: Any) -> Sensor:
        """Return the sensor with other fields of ``Material`` in its gel, in all of its layers."""
        return self._of(lambda material: replace(material, **changes))

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
    if unknown(Kind.SENSOR, name):
        file, origin = Path(name), name
        if file.suffix != ".toml" or not file.is_file():
            raise ConfigError(
                f"sensor {name!r} is neither built in nor a TOML file in {Path.cwd()}",
                remedy=f"use one of {', '.join(names(Kind.SENSOR))}, or the path of a sensor file "
                "from the folder where the command is run",
            )
    else:
        file, origin = load(Kind.SENSOR, name), f"sensor {name}"
    return _sensor_of(read_toml(file, remedy=_REMEDY), origin, file.parent)


def parse_sensor(text: str, *, origin: str, folder: Path | None = None) -> Sensor:
    """Read a sensor file's text; the path of a pad's surface starts in the folder.

    Raises:
        ConfigError: The text is not TOML, or has an unknown key, a wrong unit or a gap.
    """
    data = parse_toml(text.encode(), origin=origin, remedy=_REMEDY)
    return _sensor_of(data, origin, folder or Path())


def _sensor_of(data: dict[str, Any], origin: str, folder: Path) -> Sensor:
    has_surface = "surface" in (pad if isinstance(pad := data.get("pad"), dict) else ())
    kind = _SurfaceFile if has_surface else _File
    file = read_section(kind, data, where=f"{origin}: ", remedy=_REMEDY)
    if "like" in file.optics:
        with naming(f"{origin}: optics.like"):
            other = read_toml(load(Kind.SENSOR, str(file.optics["like"])), remedy=_REMEDY)
        own = {key: value for key, value in file.optics.items() if key != "like"}
        data = {"lamps": other.get("lamps", []), **data, "optics": other.get("optics", {}) | own}
    with naming(origin):
        if (file.material is None) == (not file.layers):
            raise ConfigError(
                "neither material nor layers"
                if file.material is None
                else "both material and layers",
                remedy="give [material] for a gel of one material, else one [[layers]] a layer",
            )
        layers = tuple(Layer(share=e.share.value, material=_material(e)) for e in file.layers)
        interface_shares(layers)
        sensor: dict[str, Any] = {
            "name": file.name,
            "title": file.title,
            "pad": _pad(file.pad, folder),
            "material": _material(file.material) if file.material else layers[-1].material,
            "layers": layers,
            "camera": _camera(file.camera),
            "markers": None if file.markers is None else _markers(file.markers),
            "tetwild": tetwild_options_of(file.mesh, origin="mesh"),
            "numbers": _numbers(file),
        }
        terms = _relaxation(file.relaxation)
    return Sensor(**sensor, optics=parse_optics(data, origin)).with_gel(relaxation=terms)


def _numbers(file: _File) -> dict[str, Measured]:
    """Return the numbers of every table by their dotted names; layers count from 1."""
    tables = {name: getattr(file, name) for name in ("pad", "material", "camera", "markers")}
    tables |= {f"layers.{index}": layer for index, layer in enumerate(file.layers, start=1)}
    return {
        f"{table}.{key}": Measured(**dict(number))
        for table, numbers in tables.items()
        for key, number in numbers or ()
        if isinstance(number, _Number)
    }


def _relaxation(entries: Sequence[_Relaxation]) -> tuple[RelaxationTerm, ...]:
    """Return the terms of a Prony series of all of the gel."""
    terms = []
    for index, entry in enumerate(entries, start=1):
        with naming(f"relaxation.{index}"):
            terms.append(RelaxationTerm(share=entry.share, time_s=entry.time))
    if (total := sum(term.share for term in terms)) >= 1.0:
        raise ConfigError(
            f"the relaxation's shares sum to {total:g}",
            remedy="give shares of the stiffness that is there at once; together less than 1",
        )
    return tuple(terms)


def _pad(table: _Pad | _Surface, folder: Path) -> Pad:
    """Return a pad of stated sizes, or one that a mesh bounds, whose path starts in the folder."""
    if isinstance(table, _Surface):
        return read_surface_pad(folder / table.surface, unit=table.unit)
    return BoxPad(**{f"{name}_m": number.value for name, number in table if number is not None})


def _material(table: _Gel) -> Material:
    return Material(young_pa=table.young.value, poisson=table.poisson.value)


def _camera(table: _Camera) -> CameraGeometry:
    """Return the pixels after the crop; ``core.config.load`` reads the rates, checked here."""
    if table.rate is not None and table.min_rate > table.rate.value:
        raise ConfigError(
            f"camera.min_rate {table.min_rate:g} Hz is above camera.rate {table.rate.value:g} Hz",
            remedy="state the rate that the camera delivers, and the least that suffices",
        )
    pixel_x, pixel_y = table.pixel_x.value, table.pixel_y.value
    return CameraGeometry(
        width=table.width,
        height=table.height,
        scale_x_m=pixel_x,
        scale_y_m=pixel_y,
        centre_x_px=0.5 * (table.width - 1) - table.centre_x.value / pixel_x,
        centre_y_px=0.5 * (table.height - 1) - table.centre_y.value / pixel_y,
        crop_fraction=table.crop,
    )


def _markers(table: _Markers) -> MarkerGrid:
    pitch_m, radius_m = (table.pitch_x.value, table.pitch_y.value), table.radius.value
    return MarkerGrid(columns=table.columns, rows=table.rows, pitch_m=pitch_m, radius_m=radius_m)
