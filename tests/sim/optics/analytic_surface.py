"""Analytic gel surfaces for the tests of the optics: on irregular meshes, and around a ball."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from sim.fields.saved_press import SurfaceState
from sim.optics.calibrate.gel_profile import RadialProfile
from sim.scene.indenter import Indenter, Plane
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.arrays import FloatArray, IntArray

_STEEPEST = 0.999
_SAMPLES_PER_LENGTH = 100
_LENGTHS = 8.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ExponentialSkirt:
    """A ball inside the contact; outside, a skirt whose tilt decays exponentially from the rim.

    Tilt is continuous at the rim, as under a smooth ball (Hertz), and dies out over a length.
    """

    ball_radius_m: float  # radius of the ball [m]
    decay_m: float  # distance over which the tilt falls by e [m]

    def __call__(self, contact_radius_m: float) -> RadialProfile:
        """Return the gel's surface where the contact has this radius [m]."""
        rim_radius = min(contact_radius_m, _STEEPEST * self.ball_radius_m)
        reach = rim_radius + _LENGTHS * self.decay_m
        step = min(rim_radius, self.decay_m) / _SAMPLES_PER_LENGTH
        radius = np.linspace(0.0, reach, max(2, round(reach / step)))
        beyond = np.maximum(radius - rim_radius, 0.0)
        tilt = np.minimum(radius, rim_radius) / self.ball_radius_m * np.exp(-beyond / self.decay_m)
        slope = tilt / np.sqrt(1.0 - tilt**2)
        rise = 0.5 * (slope[1:] + slope[:-1]) * np.diff(radius)
        height = np.concatenate([[0.0], np.cumsum(rise)])
        depth = height[-1] - height
        return RadialProfile(radius_m=radius, tilt=tilt, indentation_m=depth, outward_m=0.1 * depth)


HeightFunction = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
APEX_M = 0.004


def camera(width: int = 128, height: int = 96, pixel_m: float = 1e-4) -> CameraGeometry:
    """Give a camera that sees the pad's middle, 12.8 x 9.6 mm of it unless told otherwise."""
    return CameraGeometry.centred(width, height, scale_x_m=pixel_m, scale_y_m=pixel_m)


def surface_tilt(height: NDArray[np.floating], geometry: CameraGeometry) -> FloatArray:
    """Return slope / sqrt(1 + |slope|^2) along columns and rows, shape [2, height, width]."""
    down, along = np.gradient(height, geometry.scale_y_m, geometry.scale_x_m)
    return np.stack([along, down]) / np.sqrt(1.0 + along**2 + down**2)


def irregular_mesh(edge_m: float, *, seed: int = 0) -> tuple[FloatArray, IntArray]:
    """Triangulate a 16 x 13 mm rectangle with jittered nodes; returns x, y [n, 2] and facets."""
    rng = np.random.default_rng(seed)
    columns, rows = round(16e-3 / edge_m) + 1, round(13e-3 / edge_m) + 1
    x, y = np.meshgrid(np.linspace(-8e-3, 8e-3, columns), np.linspace(-6.5e-3, 6.5e-3, rows))
    points = np.c_[x.ravel(), y.ravel()]
    points += rng.uniform(-0.2, 0.2, points.shape) * edge_m
    return points, Delaunay(points).simplices.astype(np.int32)


def pressed_surface(
    height: HeightFunction,
    *,
    indenter: Indenter | None = None,
    tip: tuple[float, float, float] = (0.0, 0.0, 1.0),
    rotation: FloatArray | None = None,
    edge_m: float = 5e-4,
    seed: int = 0,
) -> SurfaceState:
    """Sample a height function at mesh nodes; the gel at rest is flat at ``APEX_M``."""
    points, triangles = irregular_mesh(edge_m, seed=seed)
    rest = np.c_[points, np.full(len(points), APEX_M)]
    return SurfaceState(
        positions_rest=rest,
        positions=np.c_[points, height(points[:, 0], points[:, 1])],
        faces=triangles,
        indenter=indenter or Plane(),
        indenter_position=np.array(tip),
        indenter_rotation=np.eye(3) if rotation is None else rotation,
    )


def ball_press(
    x: FloatArray, y: FloatArray, *, ball_radius_m: float, contact_radius_m: float, tip_z_m: float
) -> FloatArray:
    """Give the gel under a ball: the ball inside the contact, a matching skirt outside [m].

    The skirt continues height and slope of the ball at the rim and decays exponentially.
    """
    r = np.hypot(x, y)
    inside = ball_radius_m - np.sqrt(ball_radius_m**2 - np.minimum(r, contact_radius_m) ** 2)
    rim = ball_radius_m - np.sqrt(ball_radius_m**2 - contact_radius_m**2)
    slope = contact_radius_m / np.sqrt(ball_radius_m**2 - contact_radius_m**2)
    decay = (APEX_M - tip_z_m - rim) / slope
    outside = rim + (APEX_M - tip_z_m - rim) * (1.0 - np.exp(-(r - contact_radius_m) / decay))
    return np.asarray(tip_z_m + np.where(r <= contact_radius_m, inside, outside))
