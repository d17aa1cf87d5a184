"""``PLAN.toml`` as it is written, and its presses, checked and named by their content."""

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from functools import lru_cache
from itertools import islice, product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field
from scipy.special import ndtri

from sim.optics.colour.nominal_optics import nominal_model
from sim.scene.indenter import MeshIndenter
from sim.scene.pad import BoxPad
from sim.scene.scene_parsing import parse_indenter
from sim.sensor.sensor import Sensor, load_sensor
from tacauchy_rig.app.replay.chosen_optics import OpticalCalibration, optics_and_frame
from tacauchy_rig.core.arrays import FloatArray, ImageArray, content_hash
from tacauchy_rig.core.config.field_ranges import Length, Ratio, Section
from tacauchy_rig.core.config.load import read_section, read_toml
from tacauchy_rig.core.errors import ConfigError, naming
from tacauchy_rig.core.quantities import Dimension, parse_quantity
from tacauchy_rig.core.versions import installed

PRESSES_MOST = 1_000_000
"""Of one plan; an index of so many is read at once."""
STATED = "stated"
"""As ``press.material``: the uncertainty that the sensor's file states."""
# Of a normal distribution: what is drawn beyond is taken to be there.
_DEVIATIONS_MOST = 3.0


class Design(StrEnum):
    """How the values of several variables are combined."""

    GRID = "grid"
    LIST = "list"
    LATIN_HYPERCUBE = "latin-hypercube"
    SOBOL = "sobol"


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """The values of a variable: choices, a range, or a normal distribution."""

    choices: tuple[Any, ...] = ()  # what it may be; of a range, its steps
    # The ends of a range, or mean and standard deviation
    between: tuple[float, float] | None = None
    is_normal: bool = False  # it is the latter
    # Its logarithm is normal, so that no stiffness is negative however uncertain
    is_ratio: bool = False

    def at(self, shares: FloatArray) -> list[Any]:
        """Return the values that such shares of it lie below, each share from 0 to 1."""
        if self.between is None:
            count = len(self.choices)
            return [self.choices[min(int(share * count), count - 1)] for share in shares]
        first, second = self.between
        if not self.is_normal:
            return list((first + shares * (second - first)).tolist())
        deviations = np.clip(ndtri(shares), -_DEVIATIONS_MOST, _DEVIATIONS_MOST)
        drawn = first + second * deviations
        if self.is_ratio:
            drawn = first * (1.0 + second / first) ** deviations
        return list(drawn.tolist())


_NOUGHT, _ONE = Spread(choices=(0.0,)), Spread(choices=(1.0,))


def _spread(dimension: Dimension | None) -> BeforeValidator:
    def one(value: Any) -> Any:
        if dimension is None:
            if not isinstance(value, str):
                raise ValueError("is no text; write it in quotes")
            return value
        try:
            return parse_quantity(str(value), dimension=dimension)
        except ConfigError as error:
            told = error.message.removeprefix("value: ")
            raise ValueError(f"{told}; {error.remedy}") from error

    def read(value: Any) -> Spread:
        if isinstance(value, Spread):
            return value
        if value == STATED and dimension is Dimension.RATIO:
            return Spread(between=(1.0, math.nan), is_normal=True, is_ratio=True)
        if not isinstance(value, dict):
            given = value if isinstance(value, list) else [value]
            if not given:
                raise ValueError("is an empty list; give at least one value")
            return Spread(choices=tuple(map(one, given)))
        if dimension is not None and set(value) == {"value", "uncertainty"}:
            return Spread(between=(one(value["value"]), one(value["uncertainty"])), is_normal=True)
        if dimension is None or {"from", "to"} != set(value) - {"steps"}:
            raise ValueError("write a value, a list, {from, to, steps} or {value, uncertainty}")
        ends, steps = (one(value["from"]), one(value["to"])), value.get("steps", 0)
        if not isinstance(steps, int) or not 0 <= steps <= PRESSES_MOST:
            raise ValueError(f"steps = {steps!r} is no whole number up to {PRESSES_MOST}")
        return Spread(choices=tuple(np.linspace(*ends, steps).tolist()), between=ends)

    return BeforeValidator(read)


Texts = Annotated[Spread, _spread(None)]
Lengths = Annotated[Spread, _spread(Dimension.LENGTH)]
Forces = Annotated[Spread, _spread(Dimension.FORCE)]
Angles = Annotated[Spread, _spread(Dimension.ANGLE)]
Ratios = Annotated[Spread, _spread(Dimension.RATIO)]


class Press(Section):
    """``[press]``: what is varied; see ``example.toml``."""

    sensor: Texts
    indenter: Texts
    size: Lengths | None = None
    x: Lengths = _NOUGHT
    y: Lengths = _NOUGHT
    depth: Lengths | None = None
    force: Forces | None = None
    shift_x: Lengths = _NOUGHT
    shift_y: Lengths = _NOUGHT
    twist: Angles = _NOUGHT
    tilt_x: Angles = _NOUGHT
    tilt_y: Angles = _NOUGHT
    material: Ratios = _ONE
    friction: Ratios = _NOUGHT
    light: Ratios = _ONE
    noise: Ratios = _NOUGHT


class Simulation(Section):
    """``[simulation]``: what all rows are computed with.

    Attributes:
        edge: Of elements at the gel's surface [m].
        tolerance: Presses that state a larger force error are computed again with smaller elements.
        optics: What ``calibrate optics`` wrote, of the plan's only sensor; None is its nominal one.
        background: Its no-contact frame; None is an even grey.
        samples: Of a pixel, both ways.
        cell: Pixels of a cell of pressure and shear, both ways.
        shard: Presses that are computed together and share a file.
    """

    edge: Length = Field(default=1.25e-3, validate_default=False, ge=0.4e-3, le=5e-3)
    tolerance: Annotated[Ratio, Field(ge=0.005, le=1.0)] = 1.0
    optics: Path | None = None
    background: Path | None = None
    samples: Annotated[int, Field(ge=1, le=4)] = 2
    cell: Annotated[int, Field(ge=1, le=64)] = 8
    shard: Annotated[int, Field(ge=1, le=1000)] = 50


class Description(Section):
    """``[dataset]``: what the datasheet says."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.-]*$", max_length=80)] = "presses"
    creator: str = ""
    licence: str = "CC-BY-4.0"


class Plan(Section):
    """A file of a plan."""

    design: Design
    count: Annotated[int, Field(ge=1, le=PRESSES_MOST)] | None = None
    seed: Annotated[int, Field(ge=0)] = 0
    press: Press
    simulation: Simulation = Simulation()
    dataset: Description = Description()


def read_plan(path: Path) -> Plan:
    """Read a plan.

    Raises:
        ConfigError: No such file, not TOML, or a key is unknown, missing or wrong; one line each.
    """
    tables = read_toml(path, remedy=_EXAMPLE)
    return read_section(Plan, tables, where=f"{path}: ", remedy=_EXAMPLE)


_EXAMPLE = "`tacauchy-rig sweep --example > plan.toml` writes a plan with comments"


_FORMAT = 6  # of a row's outputs; after a change all rows are computed again


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """The inputs of one press; SI."""

    sensor: str
    indenter: str  # as ``press --indenter`` takes it
    object: str  # the same as the plan has it, without its size, for splits by object
    x_m: float
    y_m: float
    depth_m: float | None  # travel below first touch of the undeformed gel [m]; or
    force_n: float | None  # F_z that pushes the indenter [N]
    shift_x_m: float
    shift_y_m: float
    twist_rad: float
    tilt_x_rad: float
    tilt_y_rad: float
    material: float  # stiffness over that of the sensor's file
    friction: float
    light: float  # brightness of the lamps over that of the sensor's optics
    noise: float  # standard deviation of a pixel [grey levels]


_UNITS = {"size": "", "x": "_m", "y": "_m", "depth": "_m", "force": "_n", "twist": "_rad"}
_UNITS |= {"shift_x": "_m", "shift_y": "_m", "tilt_x": "_rad", "tilt_y": "_rad"}
_LIMITS = {
    "material": (0.05, 20.0),
    "friction": (0.0, 2.0),
    "light": (0.1, 2.0),
    "noise": (0.0, 50.0),
    "tilt_x": (-0.5, 0.5),
    "tilt_y": (-0.5, 0.5),
    "twist": (-1.6, 1.6),
}
"""Limits of variables, SI; nothing beyond them was compared with a reference."""


def rows_of(plan: Plan, limit: int | None = None) -> tuple[Row, ...]:
    """Return the presses of a plan, each once, in its order; the first of them if limited.

    Raises:
        ConfigError: There are too many, the design lacks something, or a press is not possible.
    """
    if (plan.press.depth is None) == (plan.press.force is None):
        raise ConfigError("press: needs a depth or a force", remedy="give exactly one of the two")
    spreads = {
        name: spread
        for name in Press.model_fields
        if (spread := getattr(plan.press, name)) is not None
    }
    _state_material(spreads)
    if (plan.press.size is not None) != any("{size}" in i for i in plan.press.indenter.choices):
        raise ConfigError(
            "press.indenter and press.size do not belong together",
            remedy='write "sphere:diameter={size}" and a size, or no size at all',
        )
    rows = tuple(dict.fromkeys(map(_row, islice(_combined(plan, spreads), limit))))
    _check(rows)
    if len(sensors := {row.sensor for row in rows}) > 1 and (own := plan.simulation.optics):
        raise ConfigError(
            f"simulation.optics = {own} in a plan with {len(sensors)} sensors",
            remedy="write one plan for each sensor",
        )
    for sensor in sensors:
        drawn_with(sensor, plan.simulation)
    return rows


def _state_material(spreads: dict[str, Spread]) -> None:
    """Put in the stiffness's uncertainty where the sensor's file is to state it."""
    between = spreads["material"].between
    if between is None or not math.isnan(between[1]):
        return
    sensors = spreads["sensor"].choices
    if len(sensors) > 1:
        raise ConfigError(
            f'press.material = "{STATED}" in a plan with {len(sensors)} sensors',
            remedy='write { value = 1, uncertainty = "10 %" }, or one plan for each sensor',
        )
    share, _source = load_sensor(sensors[0]).young_uncertainty()
    spreads["material"] = Spread(between=(1.0, share), is_normal=True, is_ratio=True)


def _combined(plan: Plan, spreads: dict[str, Spread]) -> Any:
    """Yield the values of each press by variable."""
    names, columns = list(spreads), list[Sequence[Any]]()
    if plan.design in (Design.GRID, Design.LIST):
        unsettled = [name for name, spread in spreads.items() if not spread.choices]
        if unsettled or plan.count:
            which = f"press.{unsettled[0]} has no steps" if unsettled else "count is given"
            raise ConfigError(
                f"{which}, but the design is {plan.design}",
                remedy="give lists, or from, to and steps, and no count; "
                "latin-hypercube and sobol draw `count` presses from ranges",
            )
        columns = [spreads[name].choices for name in names]
        count = (math.prod if plan.design is Design.GRID else max)(map(len, columns))
        if count > PRESSES_MOST:
            raise ConfigError(
                f"the plan has {count:,} presses; at most {PRESSES_MOST:,} are allowed",
                remedy="take fewer steps, or draw them: design = 'sobol' with a count",
            )
        if plan.design is Design.GRID:
            return (dict(zip(names, values, strict=True)) for values in product(*columns))
        for name, column in zip(names, columns, strict=True):
            if len(column) not in (1, count):
                raise ConfigError(
                    f"press.{name} has {len(column)} values in a list of {count} presses",
                    remedy="give each variable one value, or one a press",
                )
        columns = [[*column] * count if len(column) == 1 else column for column in columns]
    else:
        if plan.count is None:
            raise ConfigError(
                f"count is missing; the design is {plan.design}",
                remedy="state how many presses to draw",
            )
        drawn = [n for n in names if spreads[n].between or len(spreads[n].choices) > 1]
        shares = dict(zip(drawn, _shares(plan, len(drawn), plan.count).T, strict=True))
        still = np.zeros(plan.count)
        columns = [spreads[name].at(shares.get(name, still)) for name in names]
    return (dict(zip(names, values, strict=True)) for values in zip(*columns, strict=True))


def _shares(plan: Plan, dimensions: int, count: int) -> FloatArray:
    """Return points of the unit cube, shape [count, dimensions]; a longer Sobol goes on."""
    from scipy.stats import qmc  # noqa: PLC0415 - half a second that the workers do not need

    if not dimensions:
        return np.zeros((count, 0))
    if plan.design is Design.SOBOL:
        power = max(0, math.ceil(math.log2(count)))
        return np.asarray(qmc.Sobol(dimensions, rng=plan.seed).random_base2(power)[:count])
    return np.asarray(qmc.LatinHypercube(dimensions, rng=plan.seed).random(count))


def _row(values: dict[str, Any]) -> Row:
    written = values["indenter"]
    for name, (least, most) in _LIMITS.items():
        if not least <= values[name] <= most:
            raise ConfigError(
                f"press.{name} = {values[name]:g} is not from {least:g} to {most:g}",
                remedy="give values in that range (angles in rad)",
            )
    size = values.pop("size", None)
    indenter = written if size is None else written.replace("{size}", f"{size * 1e3:.6g}mm")
    given = {f"{name}{_UNITS.get(name, '')}": value for name, value in values.items()}
    given |= {"indenter": indenter, "object": written}
    for target in ("depth_m", "force_n"):
        given.setdefault(target, None)
    return Row(**given)


def _check(rows: Sequence[Row]) -> None:
    """End before any work where a press is not possible."""
    for number, row in enumerate(rows, start=1):
        pad, _ = sensor_of(row.sensor).pad, indenter_of(row.indenter)
        with naming(f"press {number}"):
            if not isinstance(pad, BoxPad):
                raise ConfigError(
                    f"sensor {row.sensor}: its pad is a mesh", remedy="take a box or a dome"
                )
            ends = [(row.x_m, row.y_m), (row.x_m + row.shift_x_m, row.y_m + row.shift_y_m)]
            if (inside := pad.distance_to_outline(np.array(ends))).min() <= 0.0:
                x, y = ends[int(np.argmin(inside))]
                half = " and ".join(f"{half * 1e3:.4g}" for half in pad.half_extents())
                raise ConfigError(
                    f"x = {x * 1e3:.4g} mm, y = {y * 1e3:.4g} mm is beside the gel of {row.sensor}",
                    remedy=f"stay within {half} mm of its middle, shift included",
                )
            if row.depth_m is not None and not 0.0 < row.depth_m < pad.height_m:
                raise ConfigError(
                    f"depth = {row.depth_m * 1e3:.4g} mm in a gel of {pad.height_m * 1e3:.4g} mm",
                    remedy="press deeper than 0 and less than the gel's height",
                )
            if row.force_n is not None and not row.force_n > 0.0:
                raise ConfigError(
                    f"force = {row.force_n:.4g} N is not positive", remedy="give more than 0 N"
                )


@lru_cache(maxsize=64)
def sensor_of(name: str) -> Sensor:
    """Return a sensor that has colours.

    Raises:
        ConfigError: No such sensor, or its file gives no optics.
    """
    sensor = load_sensor(name)
    nominal_model(sensor)
    return sensor


@lru_cache(maxsize=8)
def drawn_with(sensor: str, simulation: Simulation) -> tuple[OpticalCalibration, ImageArray]:
    """Return a sensor's optics and its no-contact frame.

    Raises:
        ConfigError: A file is missing, damaged, or of another sensor.
    """
    return optics_and_frame(sensor_of(sensor), simulation.optics, simulation.background)


indenter_of = lru_cache(maxsize=1024)(parse_indenter)
"""An indenter of its text."""


@lru_cache(maxsize=1)
def made_with() -> dict[str, str]:
    """Return the versions that rows depend on."""
    return {"format": str(_FORMAT), **installed("tacauchy-rig", "warp-lang", "numpy", "scipy")}


def row_hash(row: Row, simulation: Simulation) -> str:
    """Return what names a press: its inputs, files, settings and versions; 32 hex digits."""
    body = indenter_of(row.indenter)
    files = (simulation.optics, simulation.background)
    content = {
        "row": asdict(row),
        "sensor": _sensor_hash(row.sensor),
        "body": body.content_hash if isinstance(body, MeshIndenter) else "",
        "simulation": simulation.model_dump(exclude={"shard", "optics", "background"}),
        "optics": [None if file is None else _file_hash(file) for file in files],
        "versions": made_with(),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:32]


@lru_cache(maxsize=64)
def _sensor_hash(name: str) -> str:
    return content_hash(sensor_of(name))


@lru_cache(maxsize=64)
def _file_hash(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
