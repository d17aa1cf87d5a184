"""What else knows of the force while the arm presses, and whether the force sensor agrees.

Three witnesses, as far as there are any: the expected press of the stated gel, together with what
earlier presses found of it, the arm's own estimate of force, and the camera, which sees the gel
being touched. None is precise; all of them are independent of the force sensor. Their limits follow
from stated uncertainties alone.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from protocols.guard.breach_reaction import BreachError, Reaction
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.config.settings import RigConfig, RobotModel
from tacauchy_rig.core.force_sensor_gain import ARM_WINDOW_S, ARM_ZERO_S, CREEP_SHARE
from tacauchy_rig.core.run import FZ, ArmSample, ExpectedPress

AVERAGED_S = 0.05
"""Samples of the force sensor are averaged over this long before the gel is asked."""
POINT_M = 20e-6
"""Travel between two points of a press that are remembered [m]."""
SEEN_TRAVEL_M = 0.1e-3
"""Travel over which the camera must go on seeing a contact: three frames at 15 fps and 0.5 mm/s.
Within it a gel of 0.1 MPa under a 5 mm punch (1.4 N/mm) passes a contact force of 0.05 N, and so
does a Mini's under a face that is tilted by 2 degrees (0.04 mm)."""
_SIGN_REMEDY = (
    "force_sensor.compression_sign is wrong or the sensor's sign turned; or it sticks near zero"
)
_MUCH_REMEDY = (
    "the force sensor reads too much (range, unit, gain or axes): hang a known weight on it; or "
    "the arm is deeper than it says, or the gel stiffer than that of sensor.name"
)


class Stage(StrEnum):
    """What the arm is doing."""

    REST = "rest"
    SEARCH = "search"
    PRESS = "press"


class Witness:
    """Compares the force sensor with everything else that feels the press.

    Attributes:
        band: Least and most force of the stated gel; None without its curve.
        points: Depths of this press below contact [m] and the force at each [N].
    """

    def __init__(self, config: RigConfig, expected: ExpectedPress | None) -> None:
        protocol = config.protocol
        self.stage = Stage.REST
        self.band: PressBand | None = None
        if expected is not None:
            self.band = PressBand(expected, contact_force_n=protocol.contact_force)
        self._model = config.robot.model
        self._force_sign = config.robot.force_sign
        self._arm = ArmEstimate(config.robot.model, sign=self._force_sign)
        self._contact_force_n = protocol.contact_force
        # A trial whose zero drifts further fails; so far it may be off.
        self._zero_error_n = protocol.drift
        rate_hz = config.force_sensor.rate
        self._forces: deque[float] = deque(maxlen=max(1, round(AVERAGED_S * rate_hz)))
        self._slow: deque[float] = deque(maxlen=max(1, round(ARM_WINDOW_S * rate_hz)))
        self._contact_z_m = self._depth_m = 0.0
        self.points: list[tuple[float, float]] = []
        self._earlier: list[tuple[float, float]] = []
        self._seen_from_m: float | None = None

    def begin_search(self) -> None:
        """Judge a descent in which nothing touches yet; the arm stands still above the gel."""
        self.stage = Stage.SEARCH
        self._arm.zero()
        self._seen_from_m = None

    def begin_press(self, contact_z_m: float) -> None:
        """Judge a press from the height at which the force sensor found contact [m]."""
        self.stage = Stage.PRESS
        self._contact_z_m = contact_z_m
        self.points = [(0.0, self._contact_force_n)]

    def path(self) -> tuple[tuple[float, float], ...]:
        """Return depths below contact [m] and the force at each [N], from contact to now."""
        return (*self.points, (self._depth_m, self.cell_n))

    def remember_press(self) -> None:
        """Hold later presses against the one that was just held: it was into the same gel.

        What was felt first at a depth stays, so that a gain that sinks from press to press is no
        less found. Either press may have been off in depth and zero.
        """
        if self.band is None:
            return
        later_m, known_m = self.band.expected.depth_error_m, 0.0
        if self._earlier:
            known_m = self._earlier[-1][0]
        self._earlier += [
            (depth_m + later_m, force_n - self._zero_error_n)
            for depth_m, force_n in self.points
            if depth_m + later_m > known_m
        ]

    def rest(self) -> None:
        """Judge nothing: the arm leaves the gel, or is far from it."""
        self.stage = Stage.REST

    @property
    def cell_n(self) -> float:
        """Pressing force as the force sensor has it, averaged [N]."""
        return sum(self._forces) / len(self._forces)

    @property
    def arm_force_n(self) -> float | None:
        """Pressing force as the arm feels it [N], tared; None where it does not."""
        return self._arm.force_n

    def force_bounds(self, depth_m: float) -> tuple[float, float] | None:
        """Return between which forces the stated gel pushes at a depth below contact [N].

        What was felt on the way does not matter here; None without a curve.
        """
        if self.band is None:
            return None
        least_n, most_n = self.band.bounds([(0.0, self._contact_force_n)], depth_m)
        return least_n - self._zero_error_n, most_n + self._zero_error_n

    def depth_bound(self, target_n: float) -> float:
        """Return how deep below contact a target justifies [m]; infinite without a curve."""
        if self.band is None:
            return math.inf
        return self.band.depth_bound(target_n + self._zero_error_n)

    def check(
        self, forces_n: Sequence[float], states: Sequence[ArmSample], *, z_m: float, seen: bool
    ) -> None:
        """Compare what one turn brought; ``seen`` is whether the camera sees the gel touched."""
        self._forces.extend(forces_n)
        self._slow.extend(forces_n)
        self._arm.take(states)
        if self.stage is Stage.REST or len(self._slow) < (self._slow.maxlen or 1):
            return
        self._check_arm(z_m)
        if self.stage is Stage.SEARCH:
            self._check_camera(z_m, seen=seen)
        else:
            self._check_gel(z_m)

    def _check_arm(self, z_m: float) -> None:
        arm_n = self._arm.force_n
        if arm_n is None:
            return
        cell_n = sum(self._slow) / len(self._slow)
        allowed_n = self._arm.tolerance.of(max(abs(cell_n), abs(arm_n)))
        if abs(arm_n - cell_n) <= allowed_n:
            return
        raise BreachError(
            f"witness: the force sensor says {cell_n:.3f} N, the arm ({self._model.value}) "
            f"estimates {arm_n:.2f} N, more than {allowed_n:.2f} N apart{self._gel_text(z_m)}",
            limit="witness.arm",
            reaction=Reaction.RETRACT,
            remedy=self._cell_remedy(cell_n, arm_n),
        )

    def _check_camera(self, z_m: float, *, seen: bool) -> None:
        if not seen:
            self._seen_from_m = None
            return
        if self._seen_from_m is None:
            self._seen_from_m = z_m
        travel_m = self._seen_from_m - z_m
        cell_n = self.cell_n
        if travel_m < SEEN_TRAVEL_M or cell_n >= self._contact_force_n:
            return
        raise BreachError(
            f"witness: the camera shows contact for {travel_m * 1e3:.2f} mm, the force "
            f"sensor says {cell_n:.3f} N, less than protocol.contact_force "
            f"{self._contact_force_n:g} N{self._arm_text()}",
            limit="witness.camera",
            reaction=Reaction.RETRACT,
            remedy="the force sensor sticks or reads far too little (range, unit, gain or axes): "
            "hang a known weight on it; or the light on the gel changed",
        )

    def _check_gel(self, z_m: float) -> None:
        depth_m, cell_n = self._contact_z_m - z_m, self.cell_n
        self._depth_m = depth_m
        if self.band is not None:
            self._check_band(self.band, depth_m, cell_n)
        if depth_m >= self.points[-1][0] + POINT_M:
            self.points.append((depth_m, cell_n))

    def _check_band(self, band: PressBand, depth_m: float, cell_n: float) -> None:
        passed = [point for point in self.points if point[0] < depth_m] or self.points[:1]
        most_n = band.most(passed, depth_m) + self._zero_error_n
        passed += [point for point in self._earlier if point[0] < depth_m]
        least_n = band.least(passed, depth_m) - self._zero_error_n
        if least_n <= cell_n <= most_n:
            return
        much, remedy = "much", _MUCH_REMEDY
        if cell_n < least_n:
            much, remedy = "little", self._little_remedy(cell_n)
        raise BreachError(
            f"witness: the force sensor says {cell_n:.3f} N at {depth_m * 1e3:.3f} mm below "
            f"contact, too {much}: by the forces so far the gel of {band.expected.sensor} "
            f"gives {least_n:.3f} to {most_n:.3f} N there{self._arm_text()}",
            limit="witness.gel",
            reaction=Reaction.RETRACT,
            remedy=remedy,
        )

    def _little_remedy(self, cell_n: float) -> str:
        if min(cell_n, self._forces[-1] + self._contact_force_n) < 0.0:
            return _SIGN_REMEDY
        return (
            "the force sensor sticks, lags or reads too little (range, unit, gain or axes): hang a "
            "known weight on it; or the gel is softer than sensor.name says"
        )

    def _cell_remedy(self, cell_n: float, arm_n: float) -> str:
        if cell_n < -self._arm.tolerance.force_n / 2 and arm_n > 0.0:
            return _SIGN_REMEDY
        if cell_n > 0.0 and arm_n < -cell_n / 2:
            return (
                "the force sensor's reading jumped (range, unit, gain or axes): hang a known "
                "weight on it; or the controller counts a push on its tool the other way "
                f"(actual_TCP_force): set robot.force_sign = {-self._force_sign}"
            )
        way = "too little" if abs(cell_n) < abs(arm_n) else "too much"
        return (
            f"the force sensor sticks, lags or reads {way} (range, unit, gain or axes): hang a "
            "known weight on it; or the arm's payload and centre of gravity are set wrongly"
        )

    def _gel_text(self, z_m: float) -> str:
        depth_m = self._contact_z_m - z_m
        bounds = self.force_bounds(depth_m) if self.stage is Stage.PRESS else None
        if bounds is None:
            return ""
        least_n, most_n = bounds
        return (
            f"; the stated gel gives {least_n:.2f} to {most_n:.2f} N at {depth_m * 1e3:.3f} mm "
            "below contact"
        )

    def _arm_text(self) -> str:
        arm_n = self._arm.force_n
        return "" if arm_n is None else f"; the arm estimates {arm_n:.2f} N"

    def present(self) -> dict[str, str]:
        """Return which witnesses there are, in words, for the journal."""
        allowed = self._arm.tolerance
        arm = f"{self._model.value}, to {allowed.force_n:g} N and {allowed.share:.0%}"
        gel = "none" if self.band is None else self.band.expected.made
        return {"arm": arm if self._arm.has_estimate else "none", "gel_curve": gel}


WORST_SHARE, WORST_N = 1.5, 0.5
"""Of the target [1], and more [N]: what a gel may feel at most when the force sensor is wrong."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """How far the tared estimate may be from the force: so much [N], and a share of it."""

    force_n: float
    share: float

    def of(self, force_n: float) -> float:
        """Return the tolerance at a force [N]."""
        return self.force_n + self.share * abs(force_n)

    def bounds(self, target_n: float) -> bool:
        """Return whether such an arm finds any silent fault before the gel feels the worst it may.

        There the force sensor still says less than the target [N], or the press would have ended.
        """
        worst_n = WORST_SHARE * target_n + WORST_N
        return worst_n - target_n >= self.of(worst_n)


TOLERANCE = {
    # Noise of 0.3 N with 10 ms of memory is 0.095 N in the mean of 0.2 s: five deviations. The rest
    # is drift, 0.1 N in 50 s. Its gain: five deviations of 2 %.
    RobotModel.E_SERIES: Tolerance(force_n=0.6, share=0.1),
    # Joint friction that turns round, 2.5 N either way; five deviations of noise, 0.36 N; drift.
    RobotModel.CB3: Tolerance(force_n=7.5, share=0.25),
}
"""None of it was measured on an arm of ours: see docs/explanation/witness.md."""


class ArmEstimate:
    """The arm's own estimate of the pressing force: coarse, but another's.

    It is a mean over ``ARM_WINDOW_S``, and only a difference from what the arm felt in the same
    posture before the search began, over ``ARM_ZERO_S``. ``sign`` is -1 where the controller counts
    a push as negative.
    """

    def __init__(self, model: RobotModel, *, sign: int = 1) -> None:
        self.tolerance = TOLERANCE[model]
        self._sign = sign
        self._felt: deque[tuple[int, float]] = deque()  # stamps [ns] and forces [N]
        self._zero_n: float | None = None

    def take(self, states: Iterable[ArmSample]) -> None:
        """Take new states; those without an estimate say nothing."""
        for state in states:
            if state.tcp_force is not None:
                self._felt.append((state.stamp_ns, self._sign * state.tcp_force[FZ]))
        while self._felt and self._felt[-1][0] - self._felt[0][0] > ARM_ZERO_S * 1e9:
            self._felt.popleft()

    def zero(self) -> None:
        """Make what is felt now the zero: nothing touches."""
        self._zero_n = self._mean(ARM_ZERO_S)

    @property
    def has_estimate(self) -> bool:
        """True once the arm has told one."""
        return bool(self._felt)

    @property
    def force_n(self) -> float | None:
        """Pressing force as the arm feels it [N]; None without an estimate or a zero."""
        mean_n = self._mean(ARM_WINDOW_S)
        return None if mean_n is None or self._zero_n is None else mean_n - self._zero_n

    def _mean(self, window_s: float) -> float | None:
        near_n = [n for ns, n in self._felt if self._felt[-1][0] - ns <= window_s * 1e9]
        return sum(near_n) / len(near_n) if near_n else None


DEEPEST_SHARE = 0.5
"""Of the gel's height: deeper, neither the gel nor its simulation has been tried."""
_STRIPS = 40
_GRID = 400


class PressBand:
    """Least and most force of a press into the stated gel, from what the press gave before.

    Where the gel begins is known from the force sensor alone, and to the contact force at best. So
    the band is one of rises: from each point of a press to each deeper one the force must rise by
    what the gel gives between the two depths, times what is left open of its stiffness. A tilted
    flat face presses as strips side by side, each as deep as it lies (a Winkler bed): right for a
    thin layer, too little for a deep one. The least rise is that of the most tilted face.
    """

    def __init__(self, expected: ExpectedPress, *, contact_force_n: float) -> None:
        self.expected = expected
        self._depth = np.array(expected.depth_m)
        self._force = np.array(expected.force_n)
        rise_n, way_m = self._force[-1] - self._force[-2], self._depth[-1] - self._depth[-2]
        self._end_slope = rise_n / way_m
        self._grid = np.linspace(0.0, max(self._depth[-1], expected.gel_height_m), _GRID)
        self._tilted = self._strips(self._grid)
        # Where the force sensor calls a soft gel touched.
        self._begin_m = float(np.interp(contact_force_n / expected.low, self._force, self._depth))

    @property
    def deepest_m(self) -> float:
        """Depth below contact that no target justifies [m]."""
        return DEEPEST_SHARE * self.expected.gel_height_m

    def bounds(self, points: Sequence[tuple[float, float]], depth_m: float) -> tuple[float, float]:
        """Return between which forces a press lies [N] that was felt at shallower points before."""
        return self.least(points, depth_m), self.most(points, depth_m)

    def least(self, points: Sequence[tuple[float, float]], depth_m: float) -> float:
        """Return the lower of ``bounds`` [N]."""
        at_m, felt_n = np.array(points).T
        nearer_m = np.maximum(depth_m - self.expected.depth_error_m, at_m)
        rise_n = self._tilted_force(nearer_m) - self._tilted_force(at_m)
        return (1.0 - CREEP_SHARE) * float((felt_n + self.expected.low * rise_n).max())

    def most(self, points: Sequence[tuple[float, float]], depth_m: float) -> float:
        """Return the upper of ``bounds`` [N]."""
        at_m, felt_n = np.array(points).T
        further_m = np.maximum(depth_m, at_m) + self.expected.depth_error_m
        rise_n = self._straight(further_m + self._begin_m) - self._straight(at_m + self._begin_m)
        return float((felt_n + (1.0 + CREEP_SHARE) * self.expected.high * rise_n).min())

    def depth_bound(self, force_n: float) -> float:
        """Return how deep below contact a force may lie [m]: in the softest, most tilted gel."""
        needed_n = force_n / (self.expected.low * (1.0 - CREEP_SHARE))
        if needed_n >= self._tilted[-1]:
            return self.deepest_m
        depth_m = float(np.interp(needed_n, self._tilted, self._grid))
        return min(depth_m + self.expected.depth_error_m, self.deepest_m)

    def _tilted_force(self, depth_m: FloatArray) -> FloatArray:
        return np.asarray(np.interp(depth_m, self._grid, self._tilted))

    def _straight(self, depth_m: FloatArray) -> FloatArray:
        """Return the curve's force [N]; beyond its end it goes on as steep as there."""
        beyond = np.maximum(depth_m - self._depth[-1], 0.0)
        return np.asarray(np.interp(depth_m, self._depth, self._force) + self._end_slope * beyond)

    def _strips(self, depth_m: FloatArray) -> FloatArray:
        """Return the force of a face that is tilted by ``lean_m`` [N], over strips of a disc."""
        place = (np.arange(_STRIPS) + 0.5) / _STRIPS * 2.0 - 1.0
        width = np.sqrt(1.0 - place**2)
        behind = self.expected.lean_m * (1.0 - place)
        forces = self._straight(np.maximum(depth_m[:, None] - behind, 0.0))
        return np.asarray(forces @ (width / width.sum()))
