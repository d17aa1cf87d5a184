"""Where pixels look, from points at known places: presses of the robot, or a printed target."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim.optics.calibrate.presses.ball_press import read_image_table
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

_APART_M = 1e-4
_FEWEST = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaleFit:
    """A camera's geometry and how well it fits.

    Attributes:
        residual_px: Root mean square distance of the fitted from the labelled centres [px].
        shear_rad: Departure of the pixel axes from a right angle that the geometry cannot express.
        scale_error_m: Standard error of the scales in x and y, from the residuals [m/px].
        rotation_error_rad: Standard error of the rotation, likewise [rad].
        centre_error_px: Standard error of the centre, likewise [px].
    """

    geometry: CameraGeometry
    residual_px: float
    shear_rad: float
    scale_error_m: tuple[float, float]
    rotation_error_rad: float
    centre_error_px: float


def read_positions(path: Path) -> dict[str, tuple[float, float]]:
    """Read commanded positions, x and y from the gel's centre [m], by the names of images.

    Raises:
        ConfigError: The CSV with the columns image, x_m, y_m is missing, or a line without name or
            numbers; the message names the line.
    """
    lines = read_image_table(path, what="positions", numbers=("x_m", "y_m"))
    return {name: (x, y) for _, name, (x, y) in lines}


def fit_scale(positions_m: FloatArray, pixels: FloatArray, *, width: int, height: int) -> ScaleFit:
    """Fit mm per pixel in x and y, rotation, centre and mirroring.

    The pad's frame becomes the robot's, shifted to where the robot believes the gel's centre to be:
    that is the frame in which the presses of a run are commanded, so that a constant error between
    robot and sensor drops out.

    Args:
        positions_m: Commanded x, y of each press from the gel's centre, or of each point from the
            target's middle [m], shape [n, 2].
        pixels: Column, row of each contact's centre or point [px], shape [n, 2].
        width: Columns of the image [px].
        height: Rows of the image [px].

    Raises:
        ConfigError: Fewer than four presses, or all of them on one line.
    """
    if len(pixels) < _FEWEST:
        raise ConfigError(
            f"{len(pixels)} presses or points cannot fix scale, rotation and centre of a camera",
            remedy=f"press at {_FEWEST} or more places that are not on one line",
        )
    features = np.column_stack([pixels, np.ones(len(pixels))])
    if np.linalg.matrix_rank(features - [*features.mean(axis=0)[:2], 0.0], tol=1.0) < 3:
        raise ConfigError(
            "all presses lie on one line in the image", remedy="press also beside that line"
        )
    if np.linalg.matrix_rank(positions_m - positions_m.mean(axis=0), tol=_APART_M) < 2:
        raise ConfigError(
            "all places lie on one line on the gel",
            remedy="give the places of the presses in metres, and press also beside that line",
        )
    solution = np.asarray(np.linalg.lstsq(features, positions_m, rcond=None)[0], dtype=np.float64)
    direction, offset = solution[:2].T, solution[2]
    centre = np.linalg.solve(direction, -offset)
    scale = np.linalg.norm(direction, axis=0)
    angles = np.arctan2(direction[1], direction[0])
    mirrored = bool(np.linalg.det(direction) < 0.0)
    right_angle = -math.pi / 2 if mirrored else math.pi / 2
    shear = math.remainder(angles[1] - angles[0] - right_angle, 2 * math.pi)
    geometry = CameraGeometry(
        width=width,
        height=height,
        scale_x_m=float(scale[0]),
        scale_y_m=float(scale[1]),
        centre_x_px=float(centre[0]),
        centre_y_px=float(centre[1]),
        rotation_rad=float(angles[0] + 0.5 * shear),
        mirrored=mirrored,
    )
    return _with_errors(geometry, float(shear), features, solution, positions_m)


def _with_errors(
    geometry: CameraGeometry,
    shear_rad: float,
    features: FloatArray,
    solution: FloatArray,
    positions_m: FloatArray,
) -> ScaleFit:
    """State the standard errors of a fit of positions to features, pixels and a one, [n, 3]."""
    pixels = features[:, :2]
    centre = np.array([geometry.centre_x_px, geometry.centre_y_px])
    scale = np.array([geometry.scale_x_m, geometry.scale_y_m])
    off = geometry.to_pixels(positions_m) - pixels
    spread = np.sqrt(np.sum((features @ solution - positions_m) ** 2) / (2 * len(pixels) - 6))
    errors = spread * np.sqrt(np.diag(np.linalg.inv(features.T @ features)))
    middle = float(np.hypot(*(centre - pixels.mean(axis=0))))
    at_centre = math.hypot(spread / math.sqrt(len(pixels)), float(errors[:2].max()) * middle)
    return ScaleFit(
        geometry=geometry,
        residual_px=float(np.sqrt(np.mean(np.sum(off**2, axis=1)))),
        shear_rad=shear_rad,
        scale_error_m=(float(errors[0]), float(errors[1])),
        rotation_error_rad=float(np.max(errors[:2] / scale)),
        centre_error_px=at_centre / geometry.mean_scale_m,
    )
