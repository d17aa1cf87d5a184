"""The gel as a plant: pose of the indenter in, wrench and surface out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from drivers.emulators.plant.arrays import FloatArray
from drivers.emulators.plant.press_table import case_for, press_table
from drivers.emulators.plant.tips import Tip
from drivers.emulators.plant.truth import PlantTruth
from tacauchy_rig.run import Pose, Vector3


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
    """The deformed surface around the indenter's axis.

    Attributes:
        depth_m: Tip below the gel's highest point [m]; zero or less is no contact.
        centre: The indenter's axis from the gel's centre, x and y [m].
        tilt: Real lean of the indenter's axis towards x and y [rad].
        contact_radius: Radius in contact [m].
        radius: Deformed radii from the axis [m], rising, shape [point_count].
        height: Height there relative to the gel's highest point at rest [m].
        radius_rest: Where those points were at rest [m].
    """

    depth_m: float
    centre: tuple[float, float]
    tilt: tuple[float, float]
    contact_radius: float
    radius: FloatArray
    height: FloatArray
    radius_rest: FloatArray


class Plant:
    """One gel under one indenter.

    ``wrench`` remembers what it was asked before (relaxation): one process, one caller, rising
    stamps. ``surface_at`` and ``depth`` remember nothing.

    Args:
        truth: The emulated world.
        tip: The indenter's.
        surface: Where the gel's highest point is expected, in the robot's base frame [m].
    """

    def __init__(self, truth: PlantTruth, tip: Tip, surface: Vector3 = (0.0, 0.0, 0.0)) -> None:
        self.truth = truth
        self.tip = tip
        self.expected_surface = surface
        self.table = press_table(case_for(tip, truth.poisson, gel=truth.unit.gel))
        self._force = CubicSpline(self.table.depths, self.table.force)
        self._stiffness = self._force.derivative()
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
        normal = self._relaxation.advance(self.relaxed_force(depth), duration_s)
        if normal <= 0.0:
            return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        lean_x, lean_y = self.lean(pose)
        force = (normal * lean_x, normal * lean_y, normal)
        # A tilted flat face presses harder on its lower side; half-space ratio of the stiffnesses.
        radius = float(np.interp(depth, self.table.depths, self.table.contact_radius))
        restoring = 2.0 / 3.0 * radius**2 * self.tangent_stiffness(depth)
        arm_x, arm_y = self.truth.pose_error_m
        return force, (
            arm_y * force[2] + restoring * lean_y,
            -arm_x * force[2] - restoring * lean_x,
            arm_x * force[1] - arm_y * force[0],
        )

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

    def lean(self, pose: Pose) -> tuple[float, float]:
        """Return how the indenter's axis (tip to flange) leans towards base x and y [rad]."""
        axis = Rotation.from_rotvec(pose.rotation_vector).apply((0.0, 0.0, 1.0)).tolist()
        return (-axis[0] + self.truth.tilt_rad[0], -axis[1] + self.truth.tilt_rad[1])

    def relaxed_force(self, depth: float) -> float:
        """Return the long-term force at ``depth`` [m], [N]."""
        if depth <= 0.0:
            return 0.0
        last = float(self.table.depths[-1])
        inside = min(depth, last)
        beyond = depth - inside
        slope = float(self._stiffness(inside))
        force = float(self._force(inside)) + slope * beyond * (1.0 + 0.5 * beyond / _STIFFENING_M)
        return max(0.0, force * self.truth.young_pa)

    def tangent_stiffness(self, depth: float) -> float:
        """Return dF/d(depth) of the relaxed force [N/m]."""
        inside = min(max(depth, 0.0), float(self.table.depths[-1]))
        beyond = max(0.0, depth - inside)
        slope = float(self._stiffness(inside)) * (1.0 + beyond / _STIFFENING_M)
        return slope * self.truth.young_pa

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
        moved = (1.0 - share) * table.displacement[upper - 1] + share * table.displacement[upper]
        if depth > inside:
            moved = moved * (depth / inside)
        contact = float(np.interp(inside, table.depths, table.contact_radius))
        radius = np.maximum.accumulate(table.radius_rest + moved[:, 0])
        height = table.height_rest + moved[:, 1]
        if depth > 0.0:
            # The penalty let the tip sink in by some tenths of a micrometre: take that back.
            face = self.tip.height(radius) - depth
            height = np.minimum(height, face)
        return SurfaceProfile(
            depth_m=depth,
            centre=centre,
            tilt=tilt,
            contact_radius=contact if depth > 0.0 else 0.0,
            radius=radius,
            height=height,
            radius_rest=table.radius_rest,
        )
