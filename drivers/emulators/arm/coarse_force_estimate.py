"""An emulated arm's own estimate of the force on its tool.

An e-Series arm measures it in its flange, a CB3 infers it from the currents of its joints. Neither
is a force sensor for a gel; how coarse each is stands in ``COARSENESS``.
"""

import math
import random
from dataclasses import dataclass
from operator import sub

from tacauchy_rig.core.config.settings import RobotModel
from tacauchy_rig.core.run import Vector6, vector6

_MOST_DEVIATIONS = 2.0
# Turns errors of a force into errors of a moment [m]: 0.30 N m and 4.0 N in UR5e's data sheet.
_LEVER_M = 0.075


@dataclass(frozen=True, slots=True, kw_only=True)
class Coarseness:
    """By how much an arm's own estimate of a force is off; offset, drift and gain are drawn."""

    offset_n: float  # standard deviation of its zero [N], drawn within two of them
    drift_n_s: float  # standard deviation of the zero's drift [N/s]
    gain_ratio: float  # standard deviation of its gain [1]
    noise_n: float  # standard deviation of its noise [N]
    noise_time_s: float  # over which the noise forgets itself [s]: the controller filters
    friction_n: float  # joint friction that it takes for a force, against the motion [N]
    friction_travel_m: float  # over which that friction builds up and turns round [m]


COARSENESS = {
    # Offset: the data sheet of UR5e states an accuracy of 4.0 N, taken for two deviations. The
    # others are likely, not confirmed: no such arm was connected.
    RobotModel.E_SERIES: Coarseness(
        offset_n=2.0,
        drift_n_s=1e-3,
        gain_ratio=0.02,
        noise_n=0.3,
        noise_time_s=0.01,
        friction_n=0.0,
        friction_travel_m=1e-4,
    ),
    # Offset: users of UR5 CB3 tell of 10 N either way. The others are likely, not confirmed.
    RobotModel.CB3: Coarseness(
        offset_n=5.0,
        drift_n_s=5e-3,
        gain_ratio=0.05,
        noise_n=0.8,
        noise_time_s=0.02,
        friction_n=2.5,
        friction_travel_m=2e-4,
    ),
}


class ForceEstimate:
    """One arm's estimate, sample by sample.

    Friction follows Dahl's law (P. Dahl, "A solid friction model", 1968): it turns round over a
    short travel, and stays as it is while the tool stands still.

    Args:
        sign: 1 where the controller counts a push on its tool as positive, -1 where as negative.
    """

    def __init__(self, model: RobotModel, *, seed: int, sign: int = 1) -> None:
        self._sign = sign
        self._coarseness = coarseness = COARSENESS[model]
        self._random = random.Random(seed)  # noqa: S311 - noise, not a secret
        scales = (1.0,) * 3 + (_LEVER_M,) * 3
        offsets_n = [self._drawn() * coarseness.offset_n for _ in scales]
        drifts_n_s = [self._drawn() * coarseness.drift_n_s for _ in scales]
        self._axes = tuple(zip(scales, offsets_n, drifts_n_s, strict=True))
        self._gain = 1.0 + self._drawn() * coarseness.gain_ratio
        self._noise = [0.0] * 6
        self._friction = [0.0] * 6
        self._elapsed_s = 0.0
        self._newest: Vector6 = (0.0,) * 6
        self._zero: Vector6 = (0.0,) * 6

    def zero(self) -> None:
        """Make the newest estimate the zero of those that follow, noise and all."""
        self._zero = self._newest

    def advance(self, wrench: Vector6, velocity: Vector6, *, duration_s: float) -> Vector6:
        """Return the estimate ``duration_s`` [s] after the last one.

        Args:
            wrench: True force and moment on the tool [N, N m], base frame.
            velocity: Of the tool [m/s, rad/s], base frame.
        """
        self._elapsed_s = elapsed_s = self._elapsed_s + duration_s
        kept = math.exp(-duration_s / self._coarseness.noise_time_s)
        fresh = self._coarseness.noise_n * math.sqrt(1.0 - kept * kept)
        sign, gain, gauss = self._sign, self._gain, self._random.gauss
        if self._coarseness.friction_n > 0.0:
            self._advance_friction(velocity, duration_s)
        self._noise = [kept * old + gauss(0.0, fresh) for old in self._noise]
        axes = zip(wrench, self._axes, self._noise, self._friction, strict=True)
        self._newest = vector6(
            [
                sign * (gain * true + scale * (offset + drift * elapsed_s + noise + friction))
                for true, (scale, offset, drift), noise, friction in axes
            ]
        )
        return vector6(map(sub, self._newest, self._zero))

    def _advance_friction(self, velocity: Vector6, duration_s: float) -> None:
        for axis, speed in enumerate(velocity[:3]):
            against = -math.copysign(self._coarseness.friction_n, speed)
            share = math.exp(-abs(speed) * duration_s / self._coarseness.friction_travel_m)
            self._friction[axis] = against + share * (self._friction[axis] - against)

    def _drawn(self) -> float:
        return max(-_MOST_DEVIATIONS, min(_MOST_DEVIATIONS, self._random.gauss(0.0, 1.0)))
