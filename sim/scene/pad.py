"""Pads as data: a box, a disc, a box with a domed top, or any closed surface on a flat base."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.scene.triangle_pad import SurfacePad
from tacauchy_rig.errors import ConfigError

_ON_OUTLINE_M = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxPad:
    """Rectangular pad, x and y centred, base at z = 0, with a flat or domed top.

    Attributes:
        size_x_m: Extent in x [m].
        size_y_m: Extent in y [m].
        height_m: Thickness in the middle [m].
        dome_radius_x_m: Radius of curvature of the top along x [m], inf for flat.
        dome_radius_y_m: Radius of curvature of the top along y [m], inf for flat.
    """

    size_x_m: float
    size_y_m: float
    height_m: float
    dome_radius_x_m: float = np.inf
    dome_radius_y_m: float = np.inf

    def __post_init__(self) -> None:
        _check_lengths(self.size_x_m, self.size_y_m, self.height_m)
        corner = float(self.height_at(np.array(self.size_x_m / 2), np.array(self.size_y_m / 2)))
        if corner <= 0.1 * self.height_m:
            raise ConfigError(
                f"dome radii leave {corner * 1e3:.3g} mm of gel at the pad's corner",
                remedy="give larger dome radii or a thicker pad",
            )

    def height_at(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the height of the top at rest [m]."""
        return np.asarray(
            self.height_m - 0.5 * x**2 / self.dome_radius_x_m - 0.5 * y**2 / self.dome_radius_y_m
        )

    def half_extents(self) -> tuple[float, float]:
        """Return half the extents in x and y [m]."""
        return self.size_x_m / 2.0, self.size_y_m / 2.0

    def sectors(
        self, centre: FloatArray, count: int, *, start_rad: float, end_rad: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return directions from a point, corners among them, both ends included.

        Args:
            centre: The point, x and y [m], shape [2].
            count: About how many sectors a full turn has.
            start_rad: First direction [rad].
            end_rad: Last direction [rad], at most a full turn on.

        Returns:
            Angles [rad] and the distance to the outline in each [m].
        """
        half = np.array(self.half_extents())
        corners = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) * half - centre
        turns = np.mod(np.arctan2(corners[:, 1], corners[:, 0]) - start_rad, 2.0 * np.pi)
        middles = np.arange(4) * 0.5 * np.pi
        span = end_rad - start_rad
        inner = [turn for turn in (*turns, *middles) if 1e-9 < turn < span - 1e-9]
        marks = start_rad + np.array([0.0, *sorted(inner), span])
        parts = [
            np.linspace(a, b, max(1, round(count * (b - a) / (2.0 * np.pi))), endpoint=False)
            for a, b in pairwise(marks)
        ]
        angles = np.append(np.concatenate(parts), marks[-1])
        direction = np.column_stack([np.cos(angles), np.sin(angles)])
        room = np.where(direction >= 0.0, half - centre, half + centre)
        reach = (room / np.maximum(np.abs(direction), 1e-12)).min(axis=1)
        return angles, reach

    def distance_to_outline(self, points: FloatArray) -> FloatArray:
        """Return how far inside points [count, 2] lie [m]; negative outside."""
        half = np.array(self.half_extents())
        return np.asarray((half - np.abs(points)).min(axis=1))

    def covers(self, points: FloatArray) -> NDArray[np.bool_]:
        """Return which points [count, 2] lie on the pad, its outline included."""
        return np.asarray(self.distance_to_outline(points) >= -_ON_OUTLINE_M)


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscPad:
    """Round pad with a flat top, base at z = 0."""

    radius_m: float
    height_m: float

    def __post_init__(self) -> None:
        _check_lengths(self.radius_m, self.height_m)

    def height_at(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the height of the top at rest [m]."""
        return np.full(np.broadcast(x, y).shape, self.height_m)

    def half_extents(self) -> tuple[float, float]:
        """Return half the extents in x and y [m]."""
        return self.radius_m, self.radius_m

    def sectors(
        self, centre: FloatArray, count: int, *, start_rad: float, end_rad: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return evenly spaced directions from a point; see ``BoxPad.sectors``."""
        part = max(1, round(count * (end_rad - start_rad) / (2.0 * np.pi)))
        angles = np.linspace(start_rad, end_rad, part + 1)
        along = np.cos(angles) * centre[0] + np.sin(angles) * centre[1]
        squared = self.radius_m**2 - float(centre @ centre)
        return angles, np.sqrt(along**2 + squared) - along

    def distance_to_outline(self, points: FloatArray) -> FloatArray:
        """Return how far inside points [count, 2] lie [m]; negative outside."""
        return np.asarray(self.radius_m - np.linalg.norm(points, axis=1))

    def covers(self, points: FloatArray) -> NDArray[np.bool_]:
        """Return which points [count, 2] lie on the pad, its outline included."""
        return np.asarray(self.distance_to_outline(points) >= -_ON_OUTLINE_M)


ParametricPad = BoxPad | DiscPad
Pad = ParametricPad | SurfacePad


def _check_lengths(*lengths_m: float) -> None:
    for length in lengths_m:
        if not length > 0.0:
            raise ConfigError(
                f"pad length {length * 1e3:g} mm is not positive", remedy="give lengths above 0 mm"
            )
