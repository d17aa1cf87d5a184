"""A scene as plain data: what is pressed into what, how far, and how well it must be known."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from sim.scene.material import LawName, Layer, Material
from tacauchy_rig.core.errors import ConfigError, naming
from tacauchy_rig.core.quantities import Dimension, parse_quantity

if TYPE_CHECKING:  # shapes bring NumPy, which the help of a command has no use for
    from sim.scene.indenter import Indenter
    from sim.scene.pad import Pad

# Half of a regular tetrahedron's angle between faces [rad].
_ANGLE_MAX = 0.5 * math.acos(1.0 / 3.0)
# Of each setting as it is written: its field, dimension and range, and what is usual.
_TETWILD_SETTINGS = {
    "l_r": ("l_r", Dimension.RATIO, 0.0, 0.5, "the preset takes 0.05 to 0.1"),
    "epsilon_r": ("epsilon_r", Dimension.RATIO, 0.0, 0.01, "1e-3 is usual"),
    "stop_energy": ("stop_energy", Dimension.RATIO, 3.0, 1e3, "10 is usual"),
    "dihedral_min": ("dihedral_min_rad", Dimension.ANGLE, 0.0, _ANGLE_MAX, "2 deg is the preset's"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class TetWildOptions:
    """How fTetWild fills a pad; None leaves a setting to the preset."""

    l_r: float | None = None  # largest edge length over the bounding box's diagonal
    epsilon_r: float | None = None  # how far the surface may move over the bounding box's diagonal
    stop_energy: float | None = None  # AMIPS energy to stop at; 3 is a regular tetrahedron's
    dihedral_min_rad: float | None = None  # least angle between faces that is accepted [rad]

    def __post_init__(self) -> None:
        for name, _, low, high, usual in _TETWILD_SETTINGS.values():
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
    unknown = [key for key in table if key not in _TETWILD_SETTINGS]
    if unknown:
        raise ConfigError(
            f"{origin}: unknown mesh setting {', '.join(unknown)}",
            remedy=f"settings are {', '.join(_TETWILD_SETTINGS)}",
        )
    given = {
        name: parse_quantity(str(table[key]), dimension=dimension, field=f"{origin}: {key}")
        for key, (name, dimension, *_) in _TETWILD_SETTINGS.items()
        if key in table
    }
    with naming(origin):
        return TetWildOptions(**given)


def parse_tetwild_options(text: str) -> TetWildOptions:
    """Read ``l_r=0.08,epsilon_r=1e-3,stop_energy=10,dihedral_min=5deg`` as a table is read."""
    given = dict(part.partition("=")[::2] for part in text.split(","))
    return tetwild_options_of(given, origin="--mesh")


BARRIER_M = 5e-6
# Preset fast's widest; it is no wider than these shares of the roundness and of the depth.
_WIDE_BARRIER_M = 40e-6
# Bonded gel gives along the surface too, by a share of d_hat: a sharp punch 0.2 mm deep then is
# 0.34 % off with the whole of it.
_BONDED_SHARE = 0.5
_ROUND_SHARE, _DEPTH_SHARE = 0.4, 0.1


class ContactMode(StrEnum):
    """How points in contact may move along the indenter."""

    FRICTIONLESS = "frictionless"
    BONDED = "bonded"
    FRICTION = "friction"


class Drive(StrEnum):
    """How a force target is reached.

    ``load`` makes the indenter's travel an unknown of the solve; ``search`` is the paper's
    displacement search (section IV-C).
    """

    LOAD = "load"
    SEARCH = "search"


class Output(StrEnum):
    """What a scene is simulated for; force and depth always."""

    FORCE = "force"
    DEPTH = "depth"
    PRESSURE = "pressure"
    SHEAR = "shear"
    IMAGE = "image"
    MARKERS = "markers"


class Effect(StrEnum):
    """What a simulation may include or leave out."""

    INERTIA = "inertia"
    GRAVITY = "gravity"
    FRICTION = "friction"
    FINITE_STRAIN = "finite-strain"
    LOCKING_FREE_ELEMENT = "locking-free-element"
    SECOND_LAYER = "second-layer"
    VISCOELASTICITY = "viscoelasticity"
    SELF_CONTACT = "self-contact"
    SYMMETRY = "symmetry"


class Preset(StrEnum):
    """Mesh and element, which set accuracy and cost."""

    FAST = "fast"
    BALANCED = "balanced"
    ACCURATE = "accurate"
    PAPER = "paper"
    REFERENCE = "reference"


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """Motion of the indenter after the press, at constant depth or force.

    Attributes:
        shift_m: Translation along x and y [m].
        twist_rad: Rotation about the pad's z axis through the tip, counter-clockwise [rad].
        tilt_rad: Rotations about x and y that the indenter has from the start [rad].
    """

    shift_m: tuple[float, float] = (0.0, 0.0)
    twist_rad: float = 0.0
    tilt_rad: tuple[float, float] = (0.0, 0.0)

    @property
    def is_straight(self) -> bool:
        """The indenter goes straight down and no further."""
        return not (self.moves or any(self.tilt_rad))

    @property
    def moves(self) -> bool:
        """The indenter shifts or twists after the press."""
        return any((*self.shift_m, self.twist_rad))


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """Where the press ends: at a depth or at a force, exactly one of them.

    Attributes:
        depth_m: Travel of the tip below first touch of the undeformed pad [m].
        force_n: Pressing force F_z [N].
    """

    depth_m: float | None = None
    force_n: float | None = None

    def __post_init__(self) -> None:
        if (self.depth_m is None) == (self.force_n is None):
            raise ConfigError(
                "a press needs either a depth or a force", remedy="give exactly one of the two"
            )
        value = self.depth_m if self.depth_m is not None else self.force_n
        if value is not None and not 0.0 <= value < math.inf:
            raise ConfigError(f"press target {value:g} cannot be", remedy="give 0 or more")


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """One press.

    Attributes:
        centre_m: Where the indenter's tip comes down, x and y in the pad's frame [m].
        material: Material of the gel, or its properties that ``layers`` do not state.
        layers: Layers from the clamped base upwards; empty for a gel of one material.
        friction: Coulomb coefficient mu, for contact ``friction``.
        duration_s: Time in which the indenter reaches its target [s].
        tolerance: Relative error of F_z that omitted effects may cause; None takes the preset's.
        output_tolerances: The same for other outputs; those left out follow from F_z's.
        effects: Effects that the user switched on or off.
        refinement: Edges are the preset's divided by this. In a light scene this holds in the
            section through the axis, and the number of sectors grows with its root.
        path_refinement: Refinement of the mesh for the loading path; only the end state is then
            found on the scene's own mesh. None uses one mesh for both.
        force_tolerance_n: How closely a force target is met [N].
        barrier_m: Contact distance d_hat [m]; None is ``contact_distance_m``'s choice.
        sensor: Name of the sensor, for reports; empty for a bare pad.
    """

    pad: Pad
    material: Material
    indenter: Indenter
    target: Target
    centre_m: tuple[float, float] = (0.0, 0.0)
    layers: tuple[Layer, ...] = ()
    contact: ContactMode = ContactMode.FRICTIONLESS
    friction: float = 0.5
    motion: Motion = Motion()
    duration_s: float = 1.0
    outputs: frozenset[Output] = frozenset()
    tolerance: float | None = None
    output_tolerances: tuple[tuple[Output, float], ...] = ()
    effects: tuple[tuple[Effect, bool], ...] = ()
    drive: Drive = Drive.LOAD
    preset: Preset = Preset.BALANCED
    refinement: float = 1.0
    path_refinement: float | None = None
    force_tolerance_n: float = 1e-3
    barrier_m: float | None = None
    tetwild: TetWildOptions = field(default_factory=TetWildOptions)
    sensor: str = ""

    def __post_init__(self) -> None:
        for name, kind in (("contact", ContactMode), ("drive", Drive), ("preset", Preset)):
            value = getattr(self, name)
            if value not in [*kind]:
                raise ConfigError(f"{name} {value!r} is none", remedy=f"one of: {', '.join(kind)}")
            object.__setattr__(self, name, kind(value))  # a word is one of them, too

    @property
    def materials(self) -> tuple[Material, ...]:
        """Every material of the gel, from the base upwards."""
        return tuple(layer.material for layer in self.layers) or (self.material,)

    @property
    def has_sharp_rim(self) -> bool:
        """A sharp edge presses on the gel: stress is singular there."""
        return getattr(self.indenter, "fillet_m", None) == 0.0

    @property
    def is_light(self) -> bool:
        """A rounded body lets preset fast do with a coarser rim and fewer sectors."""
        return self.has_wide_barrier and self._edge_radius_m > 0.0

    @property
    def has_wide_barrier(self) -> bool:
        """Preset fast's barrier is wide, and a parabola.

        What sticks altogether gives by a share of the barrier's width, so that it stays narrow.
        """
        return self.preset is Preset.FAST and self.contact is not ContactMode.BONDED

    @property
    def contact_distance_m(self) -> float:
        """Contact distance d_hat [m], a numerical setting.

        The gel stays about this far from the indenter, and depth counts from there.
        """
        if self.barrier_m is not None:
            return self.barrier_m
        if not self.has_wide_barrier:
            return _BONDED_SHARE * BARRIER_M if self.contact is ContactMode.BONDED else BARRIER_M
        # It halves Newton's iterations. Under a 5 mm cylinder with a fillet of 0.3 mm, 1 mm deep,
        # F_z is 1.0 % larger with 40 um than with 10 um; on shorter edges that falls as the mesh's
        # own error does.
        depth = self.target.depth_m
        widest = _DEPTH_SHARE * depth if depth is not None else _WIDE_BARRIER_M
        widest = min(widest, _WIDE_BARRIER_M)
        if self._edge_radius_m > 0.0:
            widest = min(widest, _ROUND_SHARE * self._edge_radius_m)
        return max(BARRIER_M, widest / max(1.0, self.refinement) ** 2)

    @property
    def _edge_radius_m(self) -> float:
        """Radius at which a rigid body is rounded where the contact ends [m]; zero if it is not."""
        return float(getattr(self.indenter, "fillet_m", 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneTerms:
    """The words of a press: each field is the value of the option of its name."""

    indenter: str
    sensor: str | None = None
    pad: str | None = None
    depth: str | None = None
    force: str | None = None
    at: str | None = None
    shift: str | None = None
    twist: str | None = None
    tilt: str | None = None
    young: str | None = None
    poisson: float | None = None
    layer: list[str] | None = None
    law: str = LawName.STABLE_NEO_HOOKEAN
    contact: str = "frictionless"
    duration: str | None = None
    preset: Preset | None = None
    mesh: str | None = None
    tolerance: str | None = None
    effect: list[str] | None = None
    drive: Drive = Drive.LOAD
    # What is asked for besides force and depth; no option of every command
    output: Sequence[Output] = ()
