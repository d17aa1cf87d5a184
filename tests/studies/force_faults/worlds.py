"""Worlds to press in: what is drawn of a gel, a force sensor, an arm, and of what fails in them."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, replace
from enum import StrEnum

from tacauchy_rig.core.config.model import RobotModel

TRIALS = 6


class Kind(StrEnum):
    """What fails, each in its own way over time."""

    STEP = "step"
    ZERO_STEP = "zero step"
    RAMP = "ramp"
    ZERO_RAMP = "zero ramp"
    CREEP = "creep"
    HYSTERESIS = "hysteresis"
    CROSS_TALK = "cross-talk"


class Place(StrEnum):
    """Where a fault is."""

    SENSOR = "sensor"
    ARM = "arm"
    BOTH = "both"


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One fault.

    Attributes:
        size: Of the force [1]; of a zero [N]. Positive reads too little.
        trial: In which it begins.
        moment: Where in that trial: 0 before its tare, 1 at its end.
        time_s: With which creep builds up under load.
    """

    kind: Kind
    size: float
    trial: int
    moment: float = 0.0
    time_s: float = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """Everything that is true.

    Attributes:
        stiffness: Of the gel over what is stated [1].
        tilt_share: Of a tilt of 2 degrees.
        relaxed_fraction: Of a held gel's force.
        relaxation_time_s: With which it relaxes.
        warming_k: By how much everything warms during the run.
        gain: Of the force sensor when it is well [1].
        noise_n: Of the force sensor.
        drift_n_s: Of its zero.
        depth_share: By how much the arm's way is off [1], per trial.
        surface_m: By how much the gel lies higher than stated.
        weighed: A known weight is hung before the first and after the last trial.
    """

    seed: int
    model: RobotModel
    weighed: bool
    stiffness: float
    tilt_share: float
    relaxed_fraction: float
    relaxation_time_s: float
    warming_k: float
    gain: float
    noise_n: float
    drift_n_s: float
    depth_share: tuple[float, ...]
    motion_delay_s: float
    sensor: Fault | None = None
    arm: Fault | None = None

    @property
    def place(self) -> Place | None:
        """Where something fails; None in an honest world."""
        if self.sensor is not None:
            return Place.SENSOR if self.arm is None else Place.BOTH
        return None if self.arm is None else Place.ARM


TRIAL_S = 25.0
"""From one home to the next, about."""
MODULUS_PER_K, GAIN_PER_K, ZERO_N_PER_K = 3e-3, 2e-4, 0.01
"""Rubber elasticity (proportional to absolute temperature); a cell's sheet, as others have them."""
DEPTH_SHARE = {RobotModel.E_SERIES: 0.014, RobotModel.CB3: 0.021}
"""Standard deviation of an arm's way over 1 mm, of the run and again of each trial: 20 and 30 um in
all (``tacauchy_rig.core.config.uncertainty``)."""


def honest_world(seed: int, *, weighed: bool | None = None) -> World:
    """Draw a world in which everything is within its stated range.

    Args:
        seed: Of the draw.
        weighed: Whether a weight is hung; None leaves that to the arm, as a run does.
    """
    draw = random.Random(seed)  # noqa: S311 - a world, not a secret
    model = draw.choice(list(RobotModel))
    share = DEPTH_SHARE[model]
    common = _within(draw, share)
    return World(
        seed=seed,
        model=model,
        weighed=model is RobotModel.CB3 if weighed is None else weighed,
        stiffness=draw.uniform(0.8, 1.2),
        tilt_share=draw.uniform(0.0, 1.0),
        relaxed_fraction=draw.uniform(0.0, 0.08),
        relaxation_time_s=math.exp(draw.uniform(math.log(0.3), math.log(10.0))),
        warming_k=draw.uniform(-3.0, 3.0),
        gain=1.0 + _within(draw, 0.01),
        noise_n=draw.uniform(0.004, 0.012),
        drift_n_s=draw.uniform(-1.0, 1.0) * 0.03 / TRIAL_S,
        depth_share=tuple(common + _within(draw, share) for _ in range(TRIALS)),
        motion_delay_s=draw.uniform(0.01, 0.05),
    )


def faulty_world(
    seed: int, place: Place, *, weighed: bool | None = None, alike: bool = False
) -> World:
    """Draw a world in which something fails; in both, each by itself unless ``alike``."""
    world = honest_world(seed, weighed=weighed)
    draw = random.Random(f"fault {seed}")  # noqa: S311 - a world, not a secret
    trial = 1 + seed % TRIALS
    sensor = None if place is Place.ARM else _fault(draw, trial)
    arm = None if place is Place.SENSOR else _fault(draw, trial)
    return replace(world, sensor=sensor, arm=sensor if alike else arm)


LEAST, MOST = 0.1, 0.5
"""Of the force: what a fault takes away or adds."""
ZERO_N = (0.1, 1.0)


def _fault(draw: random.Random, trial: int) -> Fault:
    kind = draw.choice(list(Kind))
    least, most = ZERO_N if kind in (Kind.ZERO_STEP, Kind.ZERO_RAMP) else (LEAST, MOST)
    size = math.exp(draw.uniform(math.log(least), math.log(most)))
    return Fault(
        kind=kind,
        # Most faults of a cell lose force; creep and cross-talk do nothing else.
        size=size
        if kind in (Kind.CREEP, Kind.CROSS_TALK)
        else size * draw.choice((1.0, 1.0, -1.0)),
        trial=trial,
        moment=draw.uniform(0.0, 1.0),
        time_s=math.exp(draw.uniform(math.log(1.0), math.log(20.0))),
    )


def _within(draw: random.Random, deviation: float) -> float:
    """Return a normal number within two standard deviations."""
    return max(-2.0, min(2.0, draw.gauss(0.0, 1.0))) * deviation
