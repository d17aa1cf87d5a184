"""The environments of a batch: what each has of its own, its trajectory, and the result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.scene.material import Material
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """Where an indenter goes, frame by frame.

    Attributes:
        depths_m: Depth below first touch [m]; or none, and
        loads_n: Force F_z that pushes it [N].
        shifts_m: Along x and y from where it came down [m], shape [frame_count, 2]; none is zero.
        turns_rad: About z through its tip [rad]; none is zero.
    """

    depths_m: FloatArray | None = None
    loads_n: FloatArray | None = None
    shifts_m: FloatArray | None = None
    turns_rad: FloatArray | None = None

    def __post_init__(self) -> None:
        if (self.depths_m is None) == (self.loads_n is None):
            raise ConfigError(
                "a trajectory has both depths and loads, or neither",
                remedy="give the one that is known, frame by frame",
            )
        count = self.frame_count
        for name, given in (("shifts_m", self.shifts_m), ("turns_rad", self.turns_rad)):
            if given is not None and len(given) != count:
                raise ConfigError(
                    f"{name}: {len(given)} of them for {count} frames", remedy="give as many"
                )
        if count == 0 or not np.isfinite(self.goals).all():
            raise ConfigError(
                "a trajectory has no frames, or numbers in it that are not finite",
                remedy="give at least one frame, and finite numbers",
            )

    @property
    def is_pushed(self) -> bool:
        """Its loads are given, not its depths."""
        return self.loads_n is not None

    @property
    def along(self) -> FloatArray:
        """What is given frame by frame: depths [m] or loads [N]."""
        given = self.depths_m if self.depths_m is not None else self.loads_n
        return np.asarray(given, dtype=np.float64)

    @property
    def frame_count(self) -> int:
        """Frames."""
        return len(self.along)

    @property
    def goals(self) -> FloatArray:
        """What ``goals_of`` makes of it frame by frame."""
        return goals_of(self.along, self.shifts_m, self.turns_rad)


def goals_of(
    along: FloatArray, shifts_m: FloatArray | None, turns_rad: FloatArray | None
) -> FloatArray:
    """Return depths [m] or loads [N], shifts [m] and turns [rad], shape [..., 4]; none is zero."""
    shifts = np.zeros((len(along), 2)) if shifts_m is None else shifts_m
    turns = np.zeros(len(along)) if turns_rad is None else turns_rad
    return np.column_stack([along, shifts, turns]).astype(np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class Environment:
    """One press of a batch: what it has of its own; None is what the model has.

    Attributes:
        materials: Of the gel's layers, from the camera's side.
        offset_m: Where the indenter comes down beside the pilot's place, x and y [m].
        rotation: Indenter frame to pad frame, shape [3, 3].
    """

    materials: tuple[Material, ...] | None = None
    friction: float | None = None
    offset_m: tuple[float, float] = (0.0, 0.0)
    rotation: FloatArray | None = None

    @property
    def is_guided(self) -> bool:
        """Its indenter comes down where and as the pilot's does."""
        return self.rotation is None and self.offset_m == (0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchOptions:
    """Settings of the solver.

    Attributes:
        residual_relative: Norm of the unbalanced force, and difference of base reaction and
            indenter force, over the contact force.
        parts_max: Into how many parts a step is cut at most where the descent does not arrive.
    """

    residual_relative: float = 1e-6
    steps_max: int = 200
    parts_max: int = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchResult:
    """What a batch gives; not a number where the descent gave up.

    Attributes:
        force_n: Force on the indenter, whole pad [N], shape [frame_count, environment_count, 3].
        depth_m: Depth below first touch [m], shape [frame_count, environment_count].
        residual: Norm of the unbalanced force over the contact force's, the same shape.
        imbalance: Base reaction against the indenter's force, over the latter, the same shape.
        gap_m: Smallest gap [m], the same shape.
        evaluations: Of the forces, by environment.
        wall_s: Time of the presses, without setting up.
    """

    force_n: FloatArray
    depth_m: FloatArray
    residual: FloatArray
    imbalance: FloatArray
    gap_m: FloatArray
    evaluations: NDArray[np.int32]
    wall_s: float

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Which environments did not reach their last frame."""
        return np.isnan(self.force_n[-1, :, 2])


def refuse_unfit(model: Model, environments: Sequence[Environment]) -> None:
    """End where environments do not fit to their pad.

    Raises:
        ConfigError: Names the first that does not fit.
    """
    if not environments:
        raise ConfigError("a batch without environments", remedy="give at least one")
    symmetry = model.mesh.symmetry
    for number, environment in enumerate(environments):
        turned = environment.rotation is not None
        if symmetry.copies > 1 and (turned or environment.offset_m != (0.0, 0.0)):
            raise ConfigError(
                f"environment {number} moves or turns the indenter, but symmetry lets only a "
                f"{'quarter' if symmetry.copies == 4 else 'half'} of the pad be modelled",
                remedy="mesh the whole pad: switch the effect symmetry off",
            )
        friction = environment.friction
        if friction is not None and not (model.contact_options.friction > 0.0 and friction > 0.0):
            raise ConfigError(
                f"environment {number} has a friction of {friction:g}, and the model is made for "
                f"{model.contact_options.friction:g}",
                remedy="give a friction above zero to all, or to none",
            )
