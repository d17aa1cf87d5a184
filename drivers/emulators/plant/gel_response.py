"""The gel as a plant: pose of the indenter in, wrench and surface out."""

import math
from dataclasses import dataclass

import numpy as np

from drivers.emulators.plant.press_table import case_for, press_table
from drivers.emulators.plant.truth import PlantTruth, Tip
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.rotations import rotated
from tacauchy_rig.core.run import Pose, Vector3


class Relaxation:
    """The force's memory, advanced one sample at a time."""

    def __init__(self, weights: tuple[float, ...], times_s: tuple[float, ...]) -> None:
        self._weights = weights
        self._times_s = times_s
        self._memory = [0.0] * len(weights)
        self._relaxed = 0.0

    def advance(self, relaxed: float, duration_s: float) -> float:
        """Return the force after ``duration_s`` [s] in which the relaxed force came to ``relaxed``.

        Out of contact (``relaxed`` zero) the memory fades and the force is zero: gel that has not
        yet risen does not pull.
        """
        change = relaxed - self._relaxed
        self._relaxed = relaxed
        for i, (weight, time_s) in enumerate(zip(self._weights, self._times_s, strict=True)):
            x = duration_s / time_s
            mean = -math.expm1(-x) / x if x > 0.0 else 1.0
            self._memory[i] = self._memory[i] * math.exp(-x) + weight * change * mean
        return max(0.0, relaxed + sum(self._memory)) if relaxed > 0.0 else 0.0


_STIFFENING_M = 3e-4  # beyond the table the stiffness doubles every so much depth


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceProfile:
    """The deformed surface around the indenter's axis."""

    depth_m: float  # tip below the gel's highest point [m]; zero or less is no contact
    centre: tuple[float, float]  # the indenter's axis from the gel's centre, x and y [m]
    # Tilt of the indenter's face towards x and y [rad]; of a ball, of the gel under it.
    tilt: tuple[float, float]
    contact_radius: float  # radius in contact [m]
    radius: FloatArray  # deformed radii from the axis [m], rising, shape [point_count]
    height: FloatArray  # height there relative to the gel's highest point at rest [m]
    radius_rest: FloatArray  # where those points were at rest [m]
    # What a tilt of one radian adds to the height on the side that the indenter tilts to, at those
    # radii [m]; empty for a ball.
    tilt_height: FloatArray


_FACE_GRID = 64  # points across a face, for how it comes into contact
_EVEN_DEPTH_M = 4e-4  # at which a face that tilts by some degrees touches all around


def tilted_depths(
    radius_m: float, dome_radius_m: float, tilt_rad: float
) -> tuple[FloatArray, FloatArray]:
    """Return depths of a tilted face's middle [m] and those of an upright one of the same force.

    On a bed of springs: exact where a domed gel is touched in one place only, off the middle, and
    where the face touches all around.
    """
    side = np.linspace(-radius_m, radius_m, _FACE_GRID)
    x, y = np.meshgrid(side, side)
    inside = np.hypot(x, y) <= radius_m
    x, sag = x[inside], 0.5 * (x[inside] ** 2 + y[inside] ** 2) / dome_radius_m
    depth = np.linspace(-tilt_rad * radius_m, _EVEN_DEPTH_M, 4 * _FACE_GRID)[:, None]
    upright = np.linspace(0.0, 2.0 * _EVEN_DEPTH_M, 8 * _FACE_GRID)[:, None]
    sunk = np.maximum(depth - sag + tilt_rad * x, 0.0).mean(axis=1)
    even = np.maximum(upright - sag, 0.0).mean(axis=1)
    return depth[:, 0], np.interp(sunk, even, upright[:, 0])


class Plant:
    """One gel under one indenter.

    ``wrench`` remembers what it was asked before (relaxation): one process, one caller, rising
    stamps. ``surface_at`` and ``depth`` remember nothing.

    Args:
        surface: Where the gel's highest point is expected, in the robot's base frame [m].
    """

    def __init__(self, truth: PlantTruth, tip: Tip, surface: Vector3 = (0.0, 0.0, 0.0)) -> None:
        self.truth = truth
        self.tip = tip
        self.expected_surface = surface
        gel = truth.unit.gel
        case = case_for(tip, truth.poisson, gel=gel, friction=truth.friction)
        self.table = press_table(case)
        tilt = math.hypot(*truth.tilt_rad)
        face_m = tip.rim_radius_m if case.has_face else 0.0
        self._even_depths = (
            tilted_depths(face_m, gel.dome_radius_m, tilt) if face_m * tilt else None
        )
        self._relaxation = Relaxation(truth.relaxation_weights, truth.relaxation_times_s)
        self._stamp_ns: int | None = None

    def wrench(self, pose: Pose, stamp_ns: int) -> tuple[Vector3, Vector3]:
        """Return force [N] and moment about the robot's tip [N m] on the indenter, base frame.

        Args:
            pose: Pose of the tip as the robot has it.
            stamp_ns: When that was; earlier than the last call counts as the same moment.
        """
        depth = self.depth(pose)
        duration_s = 0.0 if self._stamp_ns is None else max(0, stamp_ns - self._stamp_ns) * 1e-9
        self._stamp_ns = stamp_ns
        normal = self._relaxation.advance(self.relaxed(depth)[0], duration_s)
        if normal <= 0.0:
            return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        tilt_x, tilt_y = self.tilt(pose)
        side, restoring = self._against_tilt(depth, normal)
        force = (side * tilt_x, side * tilt_y, normal)
        arm_x, arm_y = self.truth.pose_error_m
        return force, (
            arm_y * force[2] + restoring * tilt_y,
            -arm_x * force[2] - restoring * tilt_x,
            arm_x * force[1] - arm_y * force[0],
        )

    def _against_tilt(self, depth: float, normal: float) -> tuple[float, float]:
        """Return side force [N] and moment about the tip [N m] of a tilt of one radian."""
        table, inside = self.table, self._even_depth(depth)
        relaxed, stiffness = self.relaxed(depth)
        if not len(table.moment):
            # Of a half-space under a disc: a tilt presses harder on the lower side.
            radius = float(np.interp(inside, table.depths, table.contact_radius))
            return normal, 2.0 / 3.0 * radius**2 * stiffness
        scale = self.truth.young_pa * (normal / relaxed if relaxed > 0.0 else 0.0)
        found = (np.interp(inside, table.depths, of) for of in (table.side_force, table.moment))
        side, moment = (scale * float(each) for each in found)
        return side, moment

    def _even_depth(self, depth: float) -> float:
        """Return the depth of an upright face that presses as hard [m]."""
        if self._even_depths is None or depth >= self._even_depths[0][-1]:
            return depth
        return float(np.interp(depth, *self._even_depths))

    def depth(self, pose: Pose) -> float:
        """Return how far the tip is below the undeformed surface under it [m]; negative above."""
        x, y = self.centre(pose)
        length, width = self.truth.unit.pad_size_m
        if abs(x) > 0.5 * length or abs(y) > 0.5 * width:
            return -math.inf
        surface_z = self.expected_surface[2] + self.truth.surface_error_m
        sag = 0.5 * (x * x + y * y) / self.truth.unit.gel.dome_radius_m
        return surface_z - sag - pose.position[2]

    def centre(self, pose: Pose) -> tuple[float, float]:
        """Return where the indenter's axis really is, from the gel's centre, x and y [m]."""
        return (
            pose.position[0] - self.expected_surface[0] + self.truth.pose_error_m[0],
            pose.position[1] - self.expected_surface[1] + self.truth.pose_error_m[1],
        )

    def tilt(self, pose: Pose) -> tuple[float, float]:
        """Return how the indenter's axis (tip to flange) is tilted towards base x and y [rad]."""
        axis = rotated((0.0, 0.0, 1.0), pose.rotation_vector)
        return (-axis[0] + self.truth.tilt_rad[0], -axis[1] + self.truth.tilt_rad[1])

    def relaxed(self, depth: float) -> tuple[float, float]:
        """Return the long-term force at ``depth`` [m], [N], and its slope over the depth [N/m]."""
        depth = self._even_depth(depth)
        inside = min(max(depth, 0.0), float(self.table.depths[-1]))
        beyond = max(depth, 0.0) - inside
        force, slope = self.table.at(inside)
        force += slope * beyond * (1.0 + 0.5 * beyond / _STIFFENING_M)
        slope *= 1.0 + beyond / _STIFFENING_M
        young_pa = self.truth.young_pa
        return max(0.0, force * young_pa) if depth > 0.0 else 0.0, slope * young_pa

    def light_gain(self, elapsed_s: float) -> float:
        """Return the gain of the lights when they have been on for ``elapsed_s`` [s]."""
        warmth = -math.expm1(-elapsed_s / self.truth.light_drift_time_s)
        return 1.0 + self.truth.light_drift_ratio * warmth

    def surface_at(
        self, depth: float, centre: tuple[float, float], tilt: tuple[float, float] = (0.0, 0.0)
    ) -> SurfaceProfile:
        """Return the surface at ``depth`` [m] with the axis at ``centre`` [m]."""
        table = self.table
        inside = min(max(depth, 0.0), float(table.depths[-1]))
        upper = int(np.clip(np.searchsorted(table.depths, inside), 1, table.depths.size - 1))
        share = (inside - table.depths[upper - 1]) / (table.depths[upper] - table.depths[upper - 1])

        def between(rows: FloatArray) -> FloatArray:
            return np.asarray((1.0 - share) * rows[upper - 1] + share * rows[upper])

        moved = between(table.displacement)
        if depth > inside:
            moved = moved * (depth / inside)
        contact = float(np.interp(inside, table.depths, table.contact_radius))
        radius = np.maximum.accumulate(table.radius_rest + moved[:, 0])
        height = table.height_rest + moved[:, 1]
        if depth > 0.0:
            # The penalty let the tip sink in by some tenths of a micrometre: take that back.
            face = self.tip.height(radius) - depth
            height = np.minimum(height, face)
        tilt_height = np.zeros(0)
        if len(table.tilt_displacement) and any(tilt):
            tilted = math.hypot(*tilt)
            tilt_height = _odd_part(radius, height, tilted * between(table.tilt_displacement))
            tilt_height /= tilted
        return SurfaceProfile(
            depth_m=depth,
            centre=centre,
            tilt=tilt,
            contact_radius=contact if depth > 0.0 else 0.0,
            radius=radius,
            height=height,
            radius_rest=table.radius_rest,
            tilt_height=tilt_height,
        )


def _odd_part(radius: FloatArray, height: FloatArray, moved: FloatArray) -> FloatArray:
    """Return half of what two sides of the surface are apart in height, at its radii [m].

    Args:
        moved: (r, z) of one side's motion by the tilt [m], the other side's is the opposite.
    """
    sides = [
        np.interp(
            radius, np.maximum.accumulate(radius + sign * moved[:, 0]), height + sign * moved[:, 1]
        )
        for sign in (1.0, -1.0)
    ]
    odd: FloatArray = 0.5 * (sides[0] - sides[1])
    return odd
