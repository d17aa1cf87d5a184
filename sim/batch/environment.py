"""What the environments of a batch have of their own, and what they give.

Each has a load history: depths or loads, frame by frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.batch.pilot import Pilot
from sim.solve.load_steps.first_touch import touch_height
from tacauchy_rig.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class Environment:
    """One press of a batch.

    Attributes:
        young_pa: E [Pa] of the gel.
        poisson: nu of the gel.
        depths_m: Depth of every frame below first touch [m], growing; or none, and
        loads_n: Force F_z that pushes the indenter in every frame [N], growing.
        offset_m: Where the indenter comes down beside the pilot's place, x and y [m].
        rotation: Indenter frame to pad frame, shape [3, 3].
    """

    young_pa: float
    poisson: float
    depths_m: FloatArray | None = None
    loads_n: FloatArray | None = None
    offset_m: tuple[float, float] = (0.0, 0.0)
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        if (self.depths_m is None) == (self.loads_n is None):
            raise ConfigError(
                "an environment has both depths and loads, or neither",
                remedy="give the one that is known, frame by frame",
            )
        given = self.load_history
        if given.ndim != 1 or len(given) == 0 or np.diff(given, prepend=0.0).min() <= 0.0:
            unit, scale = ("mm", 1e3) if self.is_displaced else ("N", 1.0)
            shown = ", ".join(f"{scale * value:.4g}" for value in given.reshape(-1)[:8])
            raise ConfigError(
                f"the frames of an environment, {shown} {unit}, do not grow from above zero",
                remedy="give growing depths or loads",
            )

    @property
    def is_displaced(self) -> bool:
        """Its depths are given, not its loads."""
        return self.depths_m is not None

    @property
    def load_history(self) -> FloatArray:
        """What is given frame by frame: depths [m] or loads [N]."""
        given = self.depths_m if self.depths_m is not None else self.loads_n
        return np.asarray(given, dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchOptions:
    """Settings of the solver.

    Attributes:
        residual_relative: Norm of the unbalanced force, and difference of base reaction and
            indenter force, over the contact force.
        forcing: Conjugate gradients end at this share of their first residual.
        extension: Share of d_hat below which the barrier is a parabola. At 1 it is one altogether,
            and gaps stay positive while the pressure is below 8 E.
        search_max: Most steps of conjugate gradients for one of Newton.
        newton_max: Most Newton steps for a frame.
        halving_max: Most halvings of a Newton step.
        retry_max: Most further starts of a frame where Newton did not arrive: from the last frame
            as it is, then half extrapolated.
        growth_max: Most that a Newton step may multiply the norm of the unbalanced force by.
        lead_max: Frames that an environment may be ahead of the slowest one's stiffness. Farther
            from it conjugate gradients take many times as long, or fail.
    """

    residual_relative: float = 1e-6
    forcing: float = 0.25
    extension: float = 1.0
    search_max: int = 100
    newton_max: int = 40
    halving_max: int = 12
    retry_max: int = 2
    lead_max: int = 1
    growth_max: float = 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchResult:
    """What a batch gives; not a number where Newton gave up.

    Attributes:
        force_n: Force on the indenter, whole pad [N], shape [frame_count, environment_count, 3].
        depth_m: Depth below first touch [m], shape [frame_count, environment_count].
        residual: Norm of the unbalanced force over the contact force's, the same shape.
        imbalance: Base reaction against the indenter's force, over the latter, the same shape.
        gap_m: Smallest gap [m], the same shape.
        evaluations: Forces, or stiffness times a direction, that each environment took.
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

    @property
    def frames_per_s(self) -> float:
        """Frames of all environments over the time of the presses [1/s]."""
        return float(np.isfinite(self.force_n[..., 2]).sum() / self.wall_s)


def refuse_unfit(pilot: Pilot, environments: Sequence[Environment]) -> None:
    """End where environments do not fit together or to their pilot.

    Raises:
        ConfigError: Names the first that does not fit.
    """
    if not environments:
        raise ConfigError("a batch without environments", remedy="give at least one")
    lengths = {len(environment.load_history) for environment in environments}
    if len(lengths) > 1:
        raise ConfigError(
            "the environments of a batch have unlike numbers of frames: "
            + ", ".join(map(str, sorted(lengths))),
            remedy="give each the same number of depths or loads",
        )
    for number, environment in enumerate(environments):
        if environment.is_displaced == pilot.is_pushed:
            given, wanted = ("depths", "loads")[:: 1 if pilot.is_pushed else -1]
            raise ConfigError(
                f"environment {number} has {given}, and the pilot is made for {wanted}",
                remedy=f"give {wanted}, or make a pilot for {given}",
            )
        symmetry = pilot.model.mesh.symmetry
        turned = not np.array_equal(environment.rotation, np.eye(3))
        if symmetry.copies > 1 and (turned or environment.offset_m != (0.0, 0.0)):
            raise ConfigError(
                f"environment {number} moves or turns the indenter, but symmetry lets only a "
                f"{'quarter' if symmetry.copies == 4 else 'half'} of the pad be modelled",
                remedy="mesh the whole pad: switch the effect symmetry off",
            )


def touch_point(pilot: Pilot, environment: Environment) -> FloatArray:
    """Return where an environment's indenter first touches the pad: its tip [m], shape [3]."""
    x, y = np.add(pilot.centre_m, environment.offset_m)
    if environment.offset_m == (0.0, 0.0) and np.array_equal(environment.rotation, np.eye(3)):
        return np.array([x, y, pilot.touch_m])
    model = pilot.model
    height = touch_height(
        model,
        pilot.indenter,
        model.nodes,
        centre_m=(float(x), float(y)),
        rotation=environment.rotation,
    )
    return np.array([x, y, height])


def segments(pilot: Pilot, load_histories: FloatArray) -> list[tuple[int, int]]:
    """Return which of a pilot's stiffnesses serves up to which frame: (stiffness, end frame).

    Args:
        load_histories: Depths [m] or loads on the modelled part [N], shape [frame_count, count].
    """
    nearest = pilot.nearest(load_histories.mean(axis=1))
    return [
        (int(which), int(np.flatnonzero(nearest == which)[-1]) + 1) for which in np.unique(nearest)
    ]


def extrapolation(load_histories: FloatArray) -> FloatArray:
    """Return the shares of the last three frames in the next one's start: Lagrange's polynomials.

    The untouched gel, at zero, counts as a frame before the first.

    Args:
        load_histories: Shape [frame_count, environment_count].

    Returns:
        Shape [frame_count, environment_count, 3], newest first.
    """
    frames, count = load_histories.shape
    shares = np.zeros((frames, count, 3))
    shares[:, :, 0] = 1.0
    points = np.concatenate([np.zeros((1, count)), load_histories])
    for frame in range(frames - 1):
        order = min(frame + 1, 3) if frame else 2
        known, ahead = points[frame - order + 2 : frame + 2][::-1], points[frame + 2]
        for k in range(order):
            others = [j for j in range(order) if j != k]
            factors = [(ahead - known[j]) / (known[k] - known[j]) for j in others]
            shares[frame, :, k] = np.prod(factors, axis=0)
    return shares
