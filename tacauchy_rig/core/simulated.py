"""Simulators' outputs for a run's presses, their forces over depth, and our replay. All SI."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tacauchy_rig.core.arrays import FloatArray

REPLAY_NAME = "force-matched"
"""Of our replay within a run."""
IMAGE_S = "image_s"
"""Of a trial's ``wall_s``: rendering, the no-contact frame's reading included [s]."""


class Driven(StrEnum):
    """The input of a simulated press; the other one of force and depth is the output."""

    DEPTH = "depth"
    FORCE = "force"


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulator:
    """Who simulated.

    Attributes:
        version: As its maker numbers it.
        milliseconds_an_image: From the press's depth or force to the image [ms]; None: not stated.
        machine: That this was measured on.
        fitted_to_these: Something of it was fitted to the very presses that are judged.
        driven_by: Its input; None where it gives no force.
        note: What a reader has to know, in a sentence.
    """

    name: str
    version: str
    milliseconds_an_image: float | None = None
    machine: str = ""
    fitted_to_these: bool = False
    driven_by: Driven | None = None
    note: str = ""

    @property
    def title(self) -> str:
        """Name and version."""
        return f"{self.name} {self.version}"


@dataclass(frozen=True, slots=True, kw_only=True)
class PressOutput:
    """One press, simulated.

    Attributes:
        image: RGB, of the scored size, shape [height, width, 3].
        force_n: F_z on the indenter, positive in compression [N].
        depth_m: From first touch [m].
        height_m: Height of the gel's surface over itself at rest [m], negative where it is pressed
            in, a value a pixel of the scored image, shape [height, width].
        pressure_pa: Normal pressure on the gel, likewise [Pa].
        shear_pa: Tangential traction on the gel along the pad's x and y [Pa], shape
            [height, width, 2].
    """

    image: NDArray[np.uint8] | None = None
    force_n: float | None = None
    depth_m: float | None = None
    height_m: NDArray[np.float64] | None = None
    pressure_pa: NDArray[np.float64] | None = None
    shear_pa: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Outputs:
    """All presses of a simulator, by the run's trial.

    Attributes:
        left_out: Trials that it did not simulate, by its own statement.
    """

    simulator: Simulator
    presses: dict[int, PressOutput] = field(default_factory=dict)
    left_out: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayTrial:
    """One replayed trial; its fields and image are files of their own.

    Attributes:
        force_simulated_n: Simulated pressing force at the accepted depth [N].
        force_history: (depth [m], force [N]) of every evaluation of the displacement search.
        force_error_estimate: Estimated relative error of the simulated force, None if unknown;
            ``force_error_basis`` states how it was estimated.
    """

    index: int
    force_measured_n: float
    force_simulated_n: float
    depth_simulated_m: float
    force_error_estimate: float | None
    force_error_basis: str
    newton_iterations: int
    search_iterations: int
    wall_s: dict[str, float]
    balance_relative: float
    gap_min_m: float
    min_jacobian: float
    force_history: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Alternative:
    """Settings next to those that were used.

    Attributes:
        role: ``cheaper`` or ``better``.
        setting: A preset, or a mesh between two.
        error_relative: Estimated relative error of ``quantity``; None if unknown.
        time_ratio: Its time over that of the settings used.
        wall_s: The time it would have taken here [s]; None where nothing was pressed.
        quantity: ``force`` at the depth, or ``depth`` at the force.
    """

    role: str
    setting: str
    error_relative: float | None
    time_ratio: float
    wall_s: float | None
    quantity: str = "force"

    def __str__(self) -> str:
        error = "unknown" if self.error_relative is None else f"{self.error_relative:.1%}"
        seconds = "" if self.wall_s is None else f" ({_short(self.wall_s)} s)"
        time = f"about {_short(self.time_ratio)} times the time{seconds}"
        return f"preset {self.setting}: {time}, {self.quantity} error {error}"


def _short(value: float) -> str:
    """Return two significant digits, or whole numbers from 100 on."""
    return f"{value:.2g}" if value < 99.5 else f"{value:.0f}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayLayer:
    """One of the gel's layers; ``share`` is its part of the height."""

    share: float
    young_pa: float
    poisson: float


_LeftOut = Field(exclude_if=lambda value: value is None)
"""A key that is not written where there is nothing to say."""


@pydantic_dataclass(frozen=True, slots=True, kw_only=True)
class MarkerMotion:
    """How the markers of a trial moved in the recording and in the simulator.

    Attributes:
        drawn: Markers in the rendered image.
        tracked: Markers found in both recorded frames; this and what follows is None where no
            frame of the dwell could be read.
        lost: Markers of the no-contact frame that were not found again.
        apart_rms_m: Of the recorded minus the simulated motion [m].
        apart_median_px: Likewise, the median over the markers in the image [px].
        tracking_error_px: Standard error of a tracked motion along columns or rows [px].
    """

    trial: int
    drawn: int
    tracked: Annotated[int | None, _LeftOut] = None
    lost: Annotated[int | None, _LeftOut] = None
    recorded_rms_m: Annotated[float | None, _LeftOut] = None
    recorded_largest_m: Annotated[float | None, _LeftOut] = None
    simulated_rms_m: Annotated[float | None, _LeftOut] = None
    simulated_largest_m: Annotated[float | None, _LeftOut] = None
    apart_rms_m: Annotated[float | None, _LeftOut] = None
    apart_largest_m: Annotated[float | None, _LeftOut] = None
    apart_median_px: Annotated[float | None, _LeftOut] = None
    tracking_error_px: Annotated[float | None, _LeftOut] = None


@pydantic_dataclass(frozen=True, slots=True, kw_only=True)
class FoundValue:
    """A component of the indenter's tilt or place, found from a run.

    Attributes:
        value: In ``unit``; None if unknown.
        uncertainty: Standard uncertainty, likewise.
        taken: It is significant, and is simulated if the plan says so; otherwise zero is taken.
        basis: How it is known, or why it is not.
    """

    name: str
    value: float | None
    uncertainty: float | None
    unit: str
    taken: bool
    basis: str


@pydantic_dataclass(frozen=True, slots=True, kw_only=True)
class ForceInput:
    """Something that the force at a depth depends on, and by how much it is uncertain.

    Attributes:
        basis: Value, standard uncertainty and source, or why its part is not known.
        depths_m: Rising measured depths at which ``changes`` was tried [m].
        changes: Relative change of the force there by one standard uncertainty, tried by the
            simulator on a coarse mesh; None where that was not possible.
    """

    name: str
    basis: str
    depths_m: tuple[float, ...] = ()
    changes: tuple[float, ...] | None = None


@pydantic_dataclass(frozen=True, slots=True, kw_only=True)
class FoundCause:
    """By how much an input is off, found from images; the replay was made without it.

    Attributes:
        cause: Which of ``ResidualSplit``'s causes it belongs to.
        value: In ``unit``; 1 is a ratio.
    """

    name: str
    cause: str
    value: float
    unit: str


@pydantic_dataclass(frozen=True, slots=True, kw_only=True)
class TrialSplit:
    """What the residual inside a trial's contact is made of.

    Attributes:
        residual: Its norm over that of the recorded change.
        shares: Of its square, by cause; they add up to 1, and one may be below zero.
    """

    trial: int
    residual: float
    shares: dict[str, float]


@pydantic_dataclass(frozen=True, slots=True, kw_only=True)
class ResidualSplit:
    """What the residuals of a run's images are made of.

    Attributes:
        shares: By cause, of all trials' squares together; the largest first.
        found: What was found of each unknown.
    """

    trials: tuple[TrialSplit, ...]
    shares: dict[str, float]
    found: tuple[FoundCause, ...]


@pydantic_dataclass(frozen=True, slots=True, kw_only=True)
class ReplayModel:
    """What a run was replayed with, its accuracy and its cost.

    Attributes:
        centre_x_m: Where the indenter's tip came down, in the pad's frame [m].
        layers: From the clamped base upwards; empty for a gel of one material.
        preset: Mesh and element: a preset, or a mesh between two.
        barrier_m: Distance at which contact begins to push [m].
        setup_s: Time of meshing and assembling [s].
        tolerance: What chose the preset, in words; None where nothing did.
        force_error_largest_relative: Of the trials' estimated errors; None if one is unknown.
        wall_s: Time of the whole replay [s].
        effects: What was simulated and what was left out, with reasons.
        young_uncertainty_relative: Of the stated modulus; ``young_source`` is its source.
        optics: Where the optics are from.
        scale_x_m_px: Gel surface per pixel of the rendered image [m/px].
        image_centre_m: Place that the image's middle sees, in the pad's frame [m].
        modulus_factor: What the stated modulus was multiplied by, fitted to the run's depths; it
            and the fields that belong to it are None where the stated modulus was used.
        modulus_factor_deviation: Standard deviation of the trials' own factors.
        stated_force_history: (depth [m], force [N]) of the gel with the stated modulus.
        markers: Of each trial of a sensor with markers.
        friction: Coulomb coefficient; None for a contact without.
        tilt_rad: Rotations of the indenter about x and y [rad].
        found: Tilt and place of the indenter found from the run, where that was asked for.
        found_offset_m: What was added to the stated place because of the images [m].
        force_inputs: What the force at a depth depends on besides the modulus.
        residual: What the images' residual is made of; None where that was not tried.
        trials: That were pressed with it; empty is all of the run's.
    """

    sensor: str
    indenter: str
    centre_x_m: float
    centre_y_m: float
    contact: str
    drive: str
    law: str
    young_pa: float
    poisson: float
    layers: tuple[ReplayLayer, ...]
    preset: str
    element: str
    element_is_linear: bool
    tet_count: int
    node_count: int
    mesh: str
    mesh_hash: str
    barrier_m: float
    linear_solver: str
    device: str
    setup_s: float
    tolerance: str | None
    force_error_largest_relative: float | None
    wall_s: float
    alternatives: tuple[Alternative, ...]
    effects: tuple[dict[str, Any], ...]
    young_uncertainty_relative: float | None = None
    young_source: str = ""
    optics: dict[str, Any] = field(default_factory=dict)
    scale_x_m_px: float | None = None
    image_centre_m: tuple[float, float] = (0.0, 0.0)
    scale_y_m_px: float | None = None
    modulus_factor: Annotated[float | None, _LeftOut] = None
    modulus_factor_deviation: Annotated[float | None, _LeftOut] = None
    modulus_trials: Annotated[int | None, _LeftOut] = None
    stated_force_history: Annotated[tuple[tuple[float, float], ...] | None, _LeftOut] = None
    markers: tuple[MarkerMotion, ...] = ()
    friction: Annotated[float | None, _LeftOut] = None
    tilt_rad: tuple[float, float] = (0.0, 0.0)
    found: tuple[FoundValue, ...] = ()
    found_offset_m: tuple[float, float] = (0.0, 0.0)
    force_inputs: tuple[ForceInput, ...] = ()
    residual: Annotated[ResidualSplit | None, _LeftOut] = None
    trials: tuple[int, ...] = ()

    @property
    def tilt_deg(self) -> float:
        """How far the simulated indenter is tilted [deg]."""
        return math.degrees(math.hypot(*self.tilt_rad))

    @property
    def found_offset_mm(self) -> float:
        """How far it was moved because of the images [mm]."""
        return 1e3 * math.hypot(*self.found_offset_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class Replay:
    """All trials of a run; those of one indenter at one place share a model.

    Attributes:
        others: Models of further indenters and places.
        made_from: SHA-256 of the run's files that it was made from, and of its configuration.
        files: SHA-256 of its own arrays and images.
    """

    name: str
    trials: tuple[ReplayTrial, ...]
    model: ReplayModel
    versions: dict[str, str]
    made_from: dict[str, str] = field(default_factory=dict)
    files: dict[str, str] = field(default_factory=dict)
    others: tuple[ReplayModel, ...] = ()

    @property
    def models(self) -> tuple[ReplayModel, ...]:
        """All models."""
        return (self.model, *self.others)


def model_of(models: Sequence[ReplayModel], trial: int) -> ReplayModel:
    """Return what a trial was pressed with; the first that does not say of which trials it is."""
    return next((each for each in models if trial in each.trials), models[0])


_SAME_DEPTH_M = 1e-9
_BEYOND_SHARE = 0.25
"""Of the deepest simulated press: so far its last chord is followed. A gel softer than stated is
pressed deeper than that; a ball's force, which bends most, is 2 % off there."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ForceDepthCurve:
    """A pressing force over the depth below first touch."""

    depth_m: FloatArray  # rising depths [m], shape [n]
    force_n: FloatArray  # force at each [N], shape [n]

    @classmethod
    def merged(cls, histories: Sequence[Sequence[tuple[float, float]]]) -> Self | None:
        """Merge the evaluations of all trials' searches into one curve from first touch on.

        The trials share one model, so every (depth [m], force [N]) lies on the same curve.

        Returns:
            None when there is no evaluation; else its first point is zero.
        """
        points = np.array(
            sorted((d, f) for history in histories for d, f in history if d > 0.0), dtype=np.float64
        ).reshape(-1, 2)
        if not len(points):
            return None
        apart = np.diff(points[:, 0], prepend=0.0) > _SAME_DEPTH_M  # trials pass the same depths
        depth_m, force_n = np.concatenate([[[0.0, 0.0]], points[apart]]).T
        return cls(depth_m=depth_m, force_n=force_n)

    def force_at(self, depth_m: float) -> float | None:
        """Interpolate the force [N] at a depth [m].

        Returns:
            None where nothing was simulated: above the first depth, or more than a quarter below
            the last; up to there the curve goes on as straight as over its last quarter.
        """
        depths, forces = self.depth_m, self.force_n
        if len(depths) < 2 or not depths[0] <= depth_m <= (1.0 + _BEYOND_SHARE) * depths[-1]:
            return None
        if depth_m <= depths[-1]:
            return float(np.interp(depth_m, depths, forces))
        # Not from the last two points: a nanometre apart they show the solver's tolerance.
        before_m = 0.75 * depths[-1]
        slope = (forces[-1] - np.interp(before_m, depths, forces)) / (depths[-1] - before_m)
        return float(forces[-1] + slope * (depth_m - depths[-1]))

    def depth_at(self, force_n: float) -> float | None:
        """Return the depth [m] at which a force [N] is first reached; None above all forces."""
        reached = np.flatnonzero(self.force_n >= force_n)
        if len(self.force_n) < 2 or not len(reached):
            return None
        last = max(int(reached[0]), 1)
        (d0, d1), (f0, f1) = self.depth_m[last - 1 : last + 1], self.force_n[last - 1 : last + 1]
        return float(d0 + (d1 - d0) * (force_n - f0) / (f1 - f0)) if f1 > f0 else float(d0)

    def scaled(self, factor: float) -> Self:
        """Return the curve of a gel so many times as stiff."""
        return replace(self, force_n=factor * self.force_n)
