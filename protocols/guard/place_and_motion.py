"""Where the tip may be and how deep, how the tool points, how fast it goes, whether it follows."""

import math
from collections import deque
from typing import NamedTuple

from protocols.guard.breach_reaction import BreachError, Reaction
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import SafetyError
from tacauchy_rig.core.rotations import rotated
from tacauchy_rig.core.run import ArmSample, Pose, Vector3

SPEED_MARGIN = 1.5
SPEED_NOISE_M_S = 0.003
_TOOL_AXIS: Vector3 = (0.0, 0.0, 1.0)


class Workspace:
    """The box, the tilt and the speeds that a configuration allows."""

    def __init__(self, config: RigConfig) -> None:
        box, robot = config.workspace, config.robot
        self._box = box
        self._bounds = ((box.x_min, box.x_max), (box.y_min, box.y_max), (box.z_min, box.z_max))
        self._home = robot.home
        self._axis = rotated(_TOOL_AXIS, robot.tool_rotation)
        fastest = max(robot.approach_speed, robot.retract_speed, robot.search_speed)
        self._speed_cap = fastest * SPEED_MARGIN + SPEED_NOISE_M_S

    def check_target(self, pose: Pose) -> None:
        """Refuse a target outside the box or tilted."""
        problem = self._outside(pose.position) or self._tilted(pose)
        if problem:
            limit, text = problem
            raise BreachError(
                f"{limit}: a move to {describe(pose)} was refused: {text}",
                limit=limit,
                reaction=Reaction.RETRACT,
                remedy="correct robot.home, sensor.surface or the workspace box",
            )

    def check_state(self, state: ArmSample) -> None:
        """Refuse an arm outside the box, tilted or too fast."""
        pose = state.pose
        problem = self._outside(pose.position) or self._tilted(pose) or self._too_fast(state)
        if problem:
            limit, text = problem
            raise BreachError(
                f"{limit}: the tip is at {describe(pose)}: {text}",
                limit=limit,
                reaction=Reaction.HOLD,
                remedy="move the arm back by hand in local mode, and see why it left",
            )

    def check_start(self, pose: Pose) -> None:
        """Refuse to start far from home."""
        distance = math.dist(pose.position, self._home)
        if distance > self._box.home_radius:
            raise SafetyError(
                f"robot: the tip is {distance * 1e3:.0f} mm from home, more than "
                f"workspace.home_radius {self._box.home_radius * 1e3:g} mm",
                remedy=f"jog it to {_millimetres(self._home)} mm with the pendant",
            )

    def _outside(self, position: Vector3) -> tuple[str, str] | None:
        for axis, value, (low, high) in zip("xyz", position, self._bounds, strict=True):
            if not low <= value <= high:
                side, bound = ("min", low) if value < low else ("max", high)
                text = f"{axis} = {value * 1e3:.2f} mm is beyond {bound * 1e3:g} mm"
                return f"workspace.{axis}_{side}", text
        return None

    def _tilted(self, pose: Pose) -> tuple[str, str] | None:
        axes = zip(rotated(_TOOL_AXIS, pose.rotation_vector), self._axis, strict=True)
        along = sum(now * straight for now, straight in axes)
        tilt = math.acos(min(1.0, max(-1.0, along)))
        if tilt <= self._box.max_tilt:
            return None
        allowed = f"{math.degrees(self._box.max_tilt):g} deg"
        found = f"the tool is tilted by {math.degrees(tilt):.1f} deg, more than {allowed}"
        return "workspace.max_tilt", found

    def _too_fast(self, state: ArmSample) -> tuple[str, str] | None:
        speed, cap = math.hypot(*state.velocity[:3]), self._speed_cap
        if speed <= cap:
            return None
        return "robot.speed", f"it moves at {speed * 1e3:.1f} mm/s, more than {cap * 1e3:.1f} mm/s"


def describe(pose: Pose) -> str:
    """Return ``x, y, z`` in millimetres for a message."""
    return f"({_millimetres(pose.position)}) mm"


def _millimetres(position: Vector3) -> str:
    return ", ".join(f"{value * 1e3:.2f}" for value in position)


BEYOND_M = 0.0002
"""How far below the lowest surface that is known the search goes on: the way of the softest gel to
the contact force, and what an arm does not repeat (CB3 0.1 mm)."""


class Floor(NamedTuple):
    """How low a search may go [m], and which setting says so."""

    height_m: float
    limit: str

    def check(self, z_m: float, *, is_late: bool) -> None:
        """Stop a search at a height [m] below the floor, or one that takes too long.

        Raises:
            BreachError: Nothing was touched.
        """
        if z_m < self.height_m or is_late:
            raise BreachError(
                f"{self.limit}: nothing was touched down to z = {z_m * 1e3:.2f} mm",
                limit=self.limit,
                reaction=Reaction.RETRACT,
                remedy="the force sensor sticks or reads far too little: hang a known weight on "
                "it; or the sensor is not under the indenter: check sensor.surface, and whether it "
                "was moved since an earlier trial (then begin a new run)",
            )


def search_floor(config: RigConfig, *, start_m: float, contact_m: float | None) -> Floor:
    """Return the highest floor that is known.

    Args:
        start_m: Height where the search begins [m].
        contact_m: Height of contact in an earlier trial [m], if there was one.
    """
    protocol, sensor = config.protocol, config.sensor
    lowest_m = sensor.surface[2] - sensor.surface_uncertainty - BEYOND_M
    floors = [
        Floor(start_m - protocol.search_travel, "protocol.search_travel"),
        Floor(lowest_m, "sensor.surface_uncertainty"),
    ]
    if contact_m is not None:
        floors.append(Floor(contact_m - BEYOND_M, "witness.contact_height"))
    return max(floors, key=lambda floor: floor.height_m)


class DepthGuard:
    """Stops a press that goes below ``limits.max_depth``, or deeper than its force justifies.

    Args:
        target_n: Force that is pressed to [N].
        needed_m: Depth that the stated gel needs for it at most [m]; infinite if that is not known.
    """

    def __init__(self, config: RigConfig, *, target_n: float, needed_m: float) -> None:
        self._limit_m, self._target_n = config.limits.max_depth, target_n
        self._deepest_m = min(self._limit_m, needed_m)

    def check(self, depth_m: float, *, force_n: float) -> None:
        """Compare the depth below contact [m]; the force [N] is for the message.

        Raises:
            BreachError: The tip is too deep.
        """
        if depth_m <= self._deepest_m:
            return
        where = f"the tip is {depth_m * 1e3:.3f} mm below contact at {force_n:.3f} N"
        if self._deepest_m < self._limit_m:
            raise BreachError(
                f"witness: {where}; the stated gel needs no more than {self._deepest_m * 1e3:.3f} "
                f"mm for {self._target_n:g} N",
                limit="witness.depth",
                reaction=Reaction.RETRACT,
                remedy="the force sensor reads too little: hang a known weight on it; or the gel "
                "is softer than sensor.name says",
            )
        raise BreachError(
            f"limits.max_depth {self._limit_m * 1e3:g} mm: {where}",
            limit="limits.max_depth",
            reaction=Reaction.RETRACT,
            remedy="the gel is softer than expected, or contact was found on something else",
        )


LEAST_TRAVEL_M = 50e-6
"""Commanded travel below which nothing is concluded: a servo at its target hardly moves."""
LEAST_SHARE, MOST_SHARE = 0.25, 1.75
MOST_AHEAD_M = 100e-6
"""Beyond ``MOST_SHARE``: what an arm still goes of the velocity before, 1 mm/s for 100 ms."""


class FollowGuard:
    """Finds an arm that does not do the velocity it was given: stuck, paused, or too fast.

    Commanded and measured travel along z are compared over a window of at least ``window_s`` and
    ``LEAST_TRAVEL_M``, so that it works at 0.5 mm/s and at 0.02 mm/s. A controller's delay (below
    0.1 s), its acceleration and a speed slider at a third stay far from the limit. The window is
    longer than any delay with which an arm may begin to move.
    """

    def __init__(self, *, window_s: float) -> None:
        self._window_ns = round(window_s * 1e9)
        self._speed_m_s = 0.0
        self._commanded_m = 0.0
        self._looked_ns: int | None = None
        self._past: deque[tuple[int, float, float]] = deque()

    def command(self, speed_m_s: float) -> None:
        """Take the velocity along z that was commanded last [m/s]."""
        if speed_m_s * self._speed_m_s <= 0.0:
            self.forget()
        self._speed_m_s = speed_m_s

    def forget(self) -> None:
        """Begin anew: it was stopped, turned round, or goes a way of its own."""
        self._speed_m_s = 0.0
        self._looked_ns = None
        self._past.clear()

    def check(self, z_m: float, *, now_ns: int) -> None:
        """Refuse, once a turn, an arm that goes far less or more than commanded."""
        if self._speed_m_s == 0.0:
            return
        if self._looked_ns is not None:
            self._commanded_m += self._speed_m_s * (now_ns - self._looked_ns) * 1e-9
        self._looked_ns = now_ns
        self._past.append((now_ns, self._commanded_m, z_m))
        while len(self._past) > 1 and self._is_enough(self._past[1], now_ns):
            self._past.popleft()
        before_ns, commanded_before_m, z_before_m = self._past[0]
        commanded_m, gone_m = self._commanded_m - commanded_before_m, z_m - z_before_m
        duration_s = (now_ns - before_ns) * 1e-9
        if abs(gone_m) > MOST_SHARE * abs(commanded_m) + MOST_AHEAD_M:
            raise BreachError(
                f"robot: it moves further than commanded: commanded {commanded_m * 1e3:+.3f} mm in "
                f"{duration_s:.1f} s, measured {gone_m * 1e3:+.3f} mm (up is positive)",
                limit="limits.overshoot",
                reaction=Reaction.RETRACT,
                remedy="see the pendant: whether another program moves the arm, and its speed and "
                "units",
            )
        if not self._is_enough(self._past[0], now_ns):
            return
        if gone_m * commanded_m < LEAST_SHARE * commanded_m**2:
            way, sign = ("down", -1.0) if commanded_m < 0.0 else ("up", 1.0)
            measured_mm = round(sign * gone_m * 1e3, 3) + 0.0  # no "-0.000"
            raise BreachError(
                f"robot: it does not follow: commanded {abs(commanded_m) * 1e3:.3f} mm {way} in "
                f"{duration_s:.1f} s, measured {measured_mm:.3f} mm",
                limit="limits.no_motion",
                reaction=Reaction.HOLD,
                remedy="see the pendant: a pause, the speed slider, or something in the way; then "
                "`tacauchy-rig resume` repeats this trial",
            )

    def _is_enough(self, since: tuple[int, float, float], now_ns: int) -> bool:
        since_ns, commanded_m, _ = since
        long_enough = now_ns - since_ns >= self._window_ns
        return long_enough and abs(self._commanded_m - commanded_m) > LEAST_TRAVEL_M
