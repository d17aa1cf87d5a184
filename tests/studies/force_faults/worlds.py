"""Worlds to press in: what is drawn of a gel, a force sensor, an arm, and of what fails in them."""

import math
import random
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from tacauchy_rig.core.config.settings import RobotModel
from tacauchy_rig.core.run import ExpectedPress
from tests.mock.world import Gel

CURVE = np.array(
    [
        (0.0, 0.0, 0.0),
        (0.05, 0.0211, 0.0409),
        (0.1, 0.031, 0.0608),
        (0.2, 0.0481, 0.0901),
        (0.4, 0.0815, 0.1342),
        (0.7, 0.131, 0.1872),
        (1.0, 0.1801, 0.2367),
        (1.5, 0.2614, 0.3189),
        (2.0, 0.3426, 0.4009),
        (3.3, 0.5565, 0.616),
        (4.73, 0.7897, 0.8587),
        (7.2, 1.2051, 1.2363),
    ]
)
"""Force [N], depth under a straight and under a 2 degrees tilted face [mm]."""
FORCE_N, DEPTH_MM, TILTED_MM = CURVE.T
EXPECTED = ExpectedPress(
    sensor="gelsight-mini",
    made="a table of this study",
    depth_m=tuple((DEPTH_MM * 1e-3).tolist()),
    force_n=tuple(FORCE_N.tolist()),
    low=0.73,
    high=1.24,
    lean_m=84e-6,
    depth_error_m=35e-6,
    gel_height_m=4e-3,
)


class MiniGel(Gel):
    """A Mini's gel, so many times as stiff, under a face that is tilted by up to 2 degrees."""

    def __init__(
        self,
        *,
        stiffness: float = 1.0,
        tilt_share: float = 0.0,
        relaxed_fraction: float = 0.07,
        relaxation_time_s: float = 2.0,
    ) -> None:
        super().__init__(relaxed_fraction=relaxed_fraction, relaxation_time_s=relaxation_time_s)
        self.factor = stiffness
        self._depths_mm = (DEPTH_MM + tilt_share * (TILTED_MM - DEPTH_MM)).tolist()
        self._forces_n = FORCE_N.tolist()
        rise, way = FORCE_N[-1] - FORCE_N[-2], self._depths_mm[-1] - self._depths_mm[-2]
        self._end_slope = float(rise / way)

    def press(self, depth_m: float, *, duration_s: float) -> float:
        """Relax as any mock gel does, along the table's force instead of a straight line."""
        if depth_m <= 0.0:
            return super().press(0.0, duration_s=duration_s)
        depth_mm = depth_m * 1e3
        beyond = self._end_slope * max(0.0, depth_mm - self._depths_mm[-1])
        force_n = self.factor * (
            float(np.interp(depth_mm, self._depths_mm, self._forces_n)) + beyond
        )
        return super().press(force_n / self.stiffness_n_m, duration_s=duration_s)


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
    """One fault."""

    kind: Kind
    size: float  # of the force [1]; of a zero [N]. Positive reads too little
    trial: int  # in which it begins
    moment: float = 0.0  # where in that trial: 0 before its tare, 1 at its end
    time_s: float = 5.0  # with which creep builds up under load


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """Everything that is true.

    Attributes:
        surface_m: By how much the gel lies higher than stated.
    """

    seed: int
    model: RobotModel
    weighed: bool  # a known weight is hung before the first and after the last trial
    stiffness: float  # of the gel over what is stated [1]
    tilt_share: float  # of a tilt of 2 degrees
    relaxed_fraction: float  # of a held gel's force
    relaxation_time_s: float  # with which it relaxes
    warming_k: float  # by how much everything warms during the run
    gain: float  # of the force sensor when it is well [1]
    noise_n: float  # of the force sensor
    drift_n_s: float  # of its zero
    depth_share: tuple[float, ...]  # by how much the arm's way is off [1], per trial
    motion_delay_s: float
    sensor: Fault | None = None
    arm: Fault | None = None

    @property
    def place(self) -> Place | None:
        """Where something fails; None in an honest world."""
        if self.sensor is not None:
            return Place.SENSOR if self.arm is None else Place.BOTH
        return None if self.arm is None else Place.ARM


TRIAL_S = 25.0  # from one home to the next, about
MODULUS_PER_K, GAIN_PER_K, ZERO_N_PER_K = 3e-3, 2e-4, 0.01
"""Rubber elasticity (proportional to absolute temperature); a cell's sheet, as others have them."""
DEPTH_SHARE = {RobotModel.E_SERIES: 0.014, RobotModel.CB3: 0.021}
"""Standard deviation of an arm's way over 1 mm, of the run and again of each trial: 20 and 30 um in
all (``tacauchy_rig.core.config.settings``)."""


def honest_world(seed: int, *, weighed: bool | None = None) -> World:
    """Draw a world in which everything is within its stated range."""
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


LEAST, MOST = 0.1, 0.5  # of the force: what a fault takes away or adds
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
