"""Gel profiles around a ball as the simulator presses them, in place of a formula."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim.arrays import FloatArray
from sim.optics.calibrate.presses.gel_profile import RadialProfile
from sim.optics.camera_geometry import CameraGeometry
from sim.optics.height.height_map import HeightMaps
from tacauchy_rig.errors import ConfigError


class PressedProfiles:
    """Profiles of simulated presses at several depths, interpolated in the contact's radius.

    Between two presses, and beyond the first and last, profiles are scaled as a ball of fixed size
    wants it: lengths along the gel with the contact's radius a, tilt with a, indentation with a^2.

    Args:
        presses: Contact radius [m] and profile of each simulated press.

    Raises:
        ConfigError: No press, or one without contact.
    """

    def __init__(self, presses: Sequence[tuple[float, RadialProfile]]) -> None:
        if not presses or min(radius for radius, _ in presses) <= 0.0:
            raise ConfigError(
                f"{len(presses)} simulated presses give no gel profile",
                remedy="give at least one press whose contact has an area",
            )
        self._presses = sorted(presses, key=lambda press: press[0])
        self._radii = np.array([radius for radius, _ in self._presses])

    def __call__(self, contact_radius_m: float) -> RadialProfile:
        """Return the gel's surface where the contact has this radius [m]."""
        place = float(np.interp(contact_radius_m, self._radii, np.arange(len(self._radii))))
        lower = min(int(place), len(self._radii) - 1)
        upper = min(lower + 1, len(self._radii) - 1)
        share = place - lower
        reach = max(
            self._presses[i][1].radius_m[-1] * contact_radius_m / self._radii[i]
            for i in (lower, upper)
        )
        count = max(len(self._presses[i][1].radius_m) for i in (lower, upper))
        radius = np.linspace(0.0, reach, count)
        tilt_low, depth_low = self._scaled(lower, contact_radius_m, radius)
        tilt_high, depth_high = self._scaled(upper, contact_radius_m, radius)
        return RadialProfile(
            radius_m=radius,
            tilt=(1.0 - share) * tilt_low + share * tilt_high,
            indentation_m=(1.0 - share) * depth_low + share * depth_high,
        )

    def _scaled(
        self, i: int, contact_radius_m: float, radius: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        known_radius, profile = self._presses[i]
        scale = contact_radius_m / known_radius
        tilt = scale * np.interp(radius / scale, profile.radius_m, profile.tilt, right=0.0)
        depth = np.interp(radius / scale, profile.radius_m, profile.indentation_m, right=0.0)
        return tilt, scale**2 * depth


def radial_profile(maps: HeightMaps, geometry: CameraGeometry) -> tuple[float, RadialProfile]:
    """Average the height maps of a press on the pad's centre over the azimuth.

    Args:
        maps: Loaded and rest surface, seen finely (20 um per pixel, say).
        geometry: Their pixels.

    Returns:
        Contact radius [m] from the contact's area, and the profile.
    """
    x, y = geometry.pad_grid()
    r = np.hypot(x, y)
    step = max(geometry.scale_x_m, geometry.scale_y_m)
    half_width = min(float(np.abs(x).max()), float(np.abs(y).max()))
    ring = np.rint(r / step).astype(np.int64).ravel()
    kept = ring <= int(half_width / step)
    ring, indentation = ring[kept], (maps.rest - maps.loaded).ravel()[kept]
    count = np.bincount(ring)
    filled = count > 0
    radius = (np.bincount(ring, r.ravel()[kept]) / np.maximum(count, 1))[filled]
    depth = (np.bincount(ring, indentation) / np.maximum(count, 1))[filled]
    slope = -np.gradient(depth, radius)
    area = float(maps.contact.sum()) * geometry.scale_x_m * geometry.scale_y_m
    return float(np.sqrt(area / np.pi)), RadialProfile(
        radius_m=radius, tilt=slope / np.hypot(1.0, slope), indentation_m=depth
    )
