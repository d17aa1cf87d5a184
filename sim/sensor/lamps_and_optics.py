"""How a sensor shows its gel: ``[optics]`` and ``[[lamps]]`` of its file, read by a renderer."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from tacauchy_rig.core.arrays import IntArray
from tacauchy_rig.core.errors import ConfigError, naming
from tacauchy_rig.core.quantities import Dimension, parse_quantity
from tacauchy_rig.core.registry import Kind, load


@dataclass(frozen=True, slots=True, kw_only=True)
class Lamp:
    """A lamp beside the gel, as drawings state it; a calibration replaces it."""

    azimuth_rad: float  # where it stands, from growing columns towards growing rows [rad]
    elevation_rad: float  # angle of its light to the unloaded surface [rad]
    # Grey levels added to red, green and blue of a surface that faces the lamp; of a calibration
    # where the no-contact frame's light is at the model's reference
    colour: tuple[float, float, float]
    # From the middle of the image along the gel [m]; None shines in one direction everywhere
    distance_m: float | None = None

    @property
    def towards(self) -> tuple[float, float, float]:
        """Direction to it along columns, rows and up, of length 1."""
        level, up = math.cos(self.elevation_rad), math.sin(self.elevation_rad)
        return level * math.cos(self.azimuth_rad), level * math.sin(self.azimuth_rad), up


@dataclass(frozen=True, slots=True, kw_only=True)
class ShadowCaster:
    """Lamps that cast shadows, and how soft those are."""

    lamps: Sequence[Lamp]
    softness_m: float  # height by which the gel must reach over a ray to hide the lamp whole [m]
    spread: float = 0.0  # what is added to that over the distance from what casts the shadow


@dataclass(frozen=True, slots=True, kw_only=True)
class Renderer:
    """A kind of sensor images, found in the registry by ``optics.kind``."""

    # From ``[optics]``, the lamps and the file's name for messages to the colours before any
    # calibration, a ``ColourModel`` of ``sim.optics.colour``; None where the file gives none
    read: Callable[[Mapping[str, Any], tuple[Lamp, ...], str], Any]
    needed: tuple[str, ...] = ()  # keys that ``[optics]`` must have, beside ``kind``
    optional: tuple[str, ...] = ("source",)
    # Of the terms that a calibration fits, shape [term_count, 5], see ``PhotometricModel``; None
    # cannot be calibrated
    exponents: IntArray | None = None
    sees_slope: bool = True  # colours depend on the gel's slope; otherwise grey on its depth


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorOptics:
    """How a sensor turns its gel's surface into an image."""

    table: Mapping[str, Any]  # ``[optics]`` as the file has it, with what it takes from another
    renderer: Renderer
    lamps: tuple[Lamp, ...]
    shadows: ShadowCaster | None
    model: Any = field(compare=False)


def parse_optics(data: dict[str, Any], origin: str) -> SensorOptics:
    """Read ``[optics]`` and ``[[lamps]]``; ``origin`` names the file in messages.

    Raises:
        ConfigError: No such renderer, or a key is unknown, missing or wrong.
    """
    table = data.get("optics", {"kind": "photometric"})
    kind = str(table.get("kind", ""))
    with naming(origin):
        lamps = _lamps(data.get("lamps", []))
        with naming("optics.kind"):
            renderer: Renderer = load(Kind.RENDERER, kind)
        needed = {"kind", *renderer.needed}
        allowed = needed | {*renderer.optional}
        wrong = sorted((needed - set(table)) | (set(table) - allowed))
        if wrong:
            raise ConfigError(
                f"optics of kind {kind}: missing or unknown {', '.join(wrong)}",
                remedy=f"give {', '.join(sorted(allowed))}",
            )
        shadows = _shadows(table, lamps)
    model = renderer.read(table, lamps, origin)
    return SensorOptics(table=table, renderer=renderer, lamps=lamps, shadows=shadows, model=model)


def _shadows(table: dict[str, Any], lamps: tuple[Lamp, ...]) -> ShadowCaster | None:
    if "shadow_softness" not in table:
        return None
    name = "optics.shadow_softness"
    value = parse_quantity(str(table["shadow_softness"]), dimension=Dimension.LENGTH, field=name)
    if not value > 0.0 or not lamps:
        raise ConfigError(
            f"{name} needs a positive length and at least one lamp that casts the shadow",
            remedy='write shadow_softness = "0.05 mm" and [[lamps]], or leave it out',
        )
    return ShadowCaster(lamps=lamps, softness_m=value)


def grey_levels(entry: Any, name: str, count: int | None = None) -> tuple[float, ...]:
    """Return a list of grey levels, of so many if a count is given.

    Raises:
        ConfigError: It is none; the message says its name.
    """
    levels = entry if isinstance(entry, list) else []
    are_numbers = all(type(each) in (int, float) and math.isfinite(each) for each in levels)
    if not levels or not are_numbers or len(levels) != (count or len(levels)):
        raise ConfigError(
            f"{name} = {entry!r} is no list of {count or 'two or more'} grey levels",
            remedy="write numbers, such as [80, 0, 0]",
        )
    return tuple(map(float, levels))


def _lamps(entries: list[dict[str, Any]]) -> tuple[Lamp, ...]:
    found = []
    for number, entry in enumerate(entries, start=1):
        name = f"lamp {number}"
        if set(entry) != {"azimuth", "elevation", "colour", "source"}:
            raise ConfigError(
                f"{name} needs azimuth, elevation, colour and source",
                remedy='write azimuth = "90 deg", elevation = "20 deg", colour = [80, 0, 0]',
            )
        azimuth, elevation = (
            parse_quantity(str(entry[key]), dimension=Dimension.ANGLE, field=f"{name} {key}")
            for key in ("azimuth", "elevation")
        )
        red, green, blue = grey_levels(entry["colour"], f"{name} colour", 3)
        found.append(Lamp(azimuth_rad=azimuth, elevation_rad=elevation, colour=(red, green, blue)))
    return tuple(found)
