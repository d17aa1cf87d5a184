"""Where a pixel looks: image size, scale, centre, rotation and crop of a tactile camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraGeometry:
    """Orthographic map between the image that is scored and the pad.

    The camera looks along +z from below the pad, so that rows grow with +y where columns grow
    with +x; ``mirrored`` is for cameras whose driver or mirror turns the rows over. Pixel (0, 0)
    is the centre of the first pixel.
    """

    width: int  # columns of the image after crop and resize
    height: int  # rows of the image after crop and resize
    scale_x_m: float  # pad length seen by one column [m/px]
    scale_y_m: float  # pad length seen by one row [m/px]
    centre_x_px: float  # column that sees the pad's centre
    centre_y_px: float  # row that sees the pad's centre
    rotation_rad: float = 0.0  # from the pad's x axis to the direction of growing columns [rad]
    mirrored: bool = False  # true where rows grow with -y
    crop_fraction: float = 0.0  # of the raw frame's sides, cut off at each border before resizing
    # Of the camera's pinhole from the gel [m]: what is pressed nearer to it is seen farther from
    # the image's middle. Infinite is a view by parallel rays.
    distance_m: float = math.inf

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise ConfigError(
                f"camera image {self.width} x {self.height} px has no pixels",
                remedy="give a width and a height of at least 1 px",
            )
        for name, value in (("scale_x", self.scale_x_m), ("scale_y", self.scale_y_m)):
            if not 0.0 < value < 0.01:
                raise ConfigError(
                    f"camera {name} {value * 1e3:g} mm/px is not between 0 and 10 mm/px",
                    remedy="give the length of pad that one pixel sees, such as 0.0634 mm",
                )
        if not 0.0 <= self.crop_fraction < 0.5:
            raise ConfigError(
                f"camera crop_fraction {self.crop_fraction:g} is not in [0, 0.5)",
                remedy="give the part cut off at each border, such as 0.15",
            )

    @classmethod
    def centred(
        cls, width: int, height: int, *, scale_x_m: float, scale_y_m: float
    ) -> CameraGeometry:
        """Return an upright view whose middle is the pad's centre."""
        return cls(
            width=width,
            height=height,
            scale_x_m=scale_x_m,
            scale_y_m=scale_y_m,
            centre_x_px=0.5 * (width - 1),
            centre_y_px=0.5 * (height - 1),
        )

    @property
    def mean_scale_m(self) -> float:
        """Geometric mean of the scales [m/px]."""
        return math.sqrt(self.scale_x_m * self.scale_y_m)

    @property
    def direction_matrix(self) -> FloatArray:
        """Columns: pad steps [m] of one image column and one image row, shape [2, 2]."""
        cosine, sine = math.cos(self.rotation_rad), math.sin(self.rotation_rad)
        turn = -1.0 if self.mirrored else 1.0
        directions = np.array([[cosine, -turn * sine], [sine, turn * cosine]])
        return directions * (self.scale_x_m, self.scale_y_m)

    def refined(self, samples: float) -> CameraGeometry:
        """Return the same view with every pixel divided into ``samples`` x ``samples``.

        Less than one takes pixels together; those that are left over at the end are cut off.
        """
        return replace(
            self,
            width=int(self.width * samples),
            height=int(self.height * samples),
            scale_x_m=self.scale_x_m / samples,
            scale_y_m=self.scale_y_m / samples,
            centre_x_px=(self.centre_x_px + 0.5) * samples - 0.5,
            centre_y_px=(self.centre_y_px + 0.5) * samples - 0.5,
        )

    @property
    def centre_from_middle_m(self) -> tuple[float, float]:
        """Where the pad's centre is seen, from the image's middle to the right and down [m]."""
        right_px = self.centre_x_px - 0.5 * (self.width - 1)
        down_px = self.centre_y_px - 0.5 * (self.height - 1)
        return right_px * self.scale_x_m, down_px * self.scale_y_m

    def to_pad(self, pixels: FloatArray) -> FloatArray:
        """Map (column, row) [px] to pad (x, y) [m], both of shape [..., 2]."""
        centred = np.asarray(pixels) - (self.centre_x_px, self.centre_y_px)
        return np.asarray(centred @ self.direction_matrix.T, dtype=np.float64)

    def to_pixels(self, points: FloatArray) -> FloatArray:
        """Map pad (x, y) [m] to (column, row) [px], both of shape [..., 2]."""
        centre = np.array([self.centre_x_px, self.centre_y_px])
        return np.asarray(np.asarray(points) @ np.linalg.inv(self.direction_matrix).T + centre)

    def pad_grid(self) -> tuple[FloatArray, FloatArray]:
        """Return pad x and y [m] of every pixel, each of shape [height, width]."""
        rows, columns = np.mgrid[: self.height, : self.width].astype(np.float64)
        grid = self.to_pad(np.stack([columns, rows], axis=-1))
        return grid[..., 0], grid[..., 1]
