"""Printed markers: found in images, taken from the no-contact frame and moved with the gel.

Ink takes a share of the light, whatever the light. What each marker takes is read off the
no-contact frame, so that a rendered image has the markers of this very unit, blurred as its camera
blurs them.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.sensor import MarkerGrid
from tacauchy_rig.core.arrays import BoolArray, Float32Array, FloatArray, ImageArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.rgb import to_grey

_FAINTEST = 0.25  # of what the gel around a marker reflects
_WINDOW_RADII = 1.6
_ROUNDS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerTracks:
    """Markers of a frame at rest that were found again.

    Attributes:
        places_m: Centres at rest on the pad [m], shape [n, 2].
        displacement_m: Along the pad's x and y [m], shape [n, 2].
        lost: Markers at rest with no partner.
    """

    places_m: FloatArray
    displacement_m: FloatArray
    lost: int


def track_markers(
    rest: ImageArray, loaded: ImageArray, geometry: CameraGeometry, *, radius_m: float
) -> MarkerTracks:
    """Find the markers of a radius [m] in both frames and pair each with its nearest, both ways.

    Raises:
        ConfigError: The frame at rest shows no marker.
    """
    radius_px = radius_m / geometry.mean_scale_m
    first = dark_markers(to_grey(rest), radius_px=radius_px)
    second = dark_markers(to_grey(loaded), radius_px=radius_px)
    if len(first) == 0:
        raise ConfigError(
            "the frame at rest shows no marker",
            remedy="check the sensor file's [markers] radius and pixel size against the image",
        )
    if len(second) == 0:
        second = np.full((1, 2), np.inf)
    there, back = cKDTree(second).query(first)[1], cKDTree(first).query(second)[1]
    paired = back[np.minimum(there, len(second) - 1)] == np.arange(len(first))
    places = geometry.to_pad(first[paired])
    return MarkerTracks(
        places_m=places,
        displacement_m=geometry.to_pad(second[there[paired]]) - places,
        lost=int(np.sum(~paired)),
    )


def dark_markers(image: ImageArray, *, radius_px: float) -> FloatArray:
    """Find dots of a radius that are darker than the gel around them: column and row [px], [n, 2].

    Ink takes a share of the light, whatever the light: the share is what is weighed, against the
    median of a window that is wider than a marker.
    """
    window = 2 * round(2.5 * radius_px) + 1
    around = cv2.medianBlur(image, window).astype(np.float64)
    share = 1.0 - image / np.maximum(around, 1.0)
    smooth = ndimage.gaussian_filter(share, 0.5 * radius_px)
    peak = smooth == ndimage.maximum_filter(smooth, size=window)
    places = np.argwhere(peak & (smooth > _FAINTEST)).astype(np.float64).tolist()
    found = [_centre(share, column, row, radius_px) for row, column in places]
    return np.array([centre for centre in found if centre is not None]).reshape(-1, 2)


def _centre(
    share: FloatArray, column: float, row: float, radius_px: float
) -> tuple[float, float] | None:
    """Move a soft round window to the centre of what it holds; None at the image's border."""
    height, width = share.shape
    reach = _WINDOW_RADII * radius_px
    for _ in range(_ROUNDS):
        if not (reach <= column <= width - 1 - reach and reach <= row <= height - 1 - reach):
            return None
        left, top = int(column - reach), int(row - reach)
        size = int(2 * reach) + 3
        part = share[top : top + size, left : left + size]
        j, i = np.mgrid[: part.shape[0], : part.shape[1]]
        distance = np.hypot(i + left - column, j + top - row)
        weight = np.maximum(part, 0.0) * np.clip(reach - distance + 0.5, 0.0, 1.0)
        total = max(float(weight.sum()), 1e-9)
        column = left + float((weight * i).sum()) / total
        row = top + float((weight * j).sum()) / total
    return column, row


_REACH = 1.6  # radii around a marker that its blurred edge reaches
_FOUND_SHARE = 0.6  # of the markers that the sensor's file puts into the image
_EDGE_PX = 1.0
_INK = 0.15


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintedMarkers:
    """The markers of one no-contact frame.

    Attributes:
        bare: The frame without its markers, RGB, uint8, shape [height, width, 3].
        ink: Share of the light that the markers leave, same shape.
        mask: True on the markers and a little beyond, shape [height, width].
        centres_px: Column and row of each marker at rest [px], shape [n, 2].
        places_m: The same on the pad [m], shape [n, 2].
        reach_px: Distance from a centre within which a marker dims the image [px].
    """

    bare: ImageArray
    ink: Float32Array
    mask: BoolArray
    centres_px: FloatArray
    places_m: FloatArray
    reach_px: float

    def over(
        self, image: ImageArray, displacement_m: FloatArray, geometry: CameraGeometry
    ) -> ImageArray:
        """Print the markers over an image of the bare gel.

        Args:
            image: RGB, uint8, shape [height, width, 3].
            displacement_m: Of each marker along the pad's x and y [m], shape [n, 2].
        """
        moved = geometry.to_pixels(self.places_m + displacement_m)
        size = 2 * int(np.ceil(self.reach_px)) + 3
        height, width = self.ink.shape[:2]
        # With room for windows that reach beyond the border.
        cover = np.ones((height + 2 * size, width + 2 * size, 3), dtype=np.float32)
        for start, end in zip(self.centres_px, moved, strict=True):
            left, top = (int(value) - size // 2 for value in np.rint(end))
            if -size < left < width and -size < top < height:
                middle = start - end + (left, top) + 0.5 * (size - 1)
                patch = cv2.getRectSubPix(self.ink, (size, size), middle.tolist())
                cover[top + size : top + 2 * size, left + size : left + 2 * size] *= patch
        seen = cover[size:-size, size:-size]
        return np.asarray(np.clip(np.rint(image * seen), 0.0, 255.0), dtype=np.uint8)


def printed_markers(
    frame: ImageArray, grid: MarkerGrid | None, geometry: CameraGeometry
) -> PrintedMarkers | None:
    """Read the markers off a no-contact frame; None where it shows none.

    A make of sensor is sold with and without them, so the frame decides.

    Args:
        frame: RGB, uint8, shape [height, width, 3].
        grid: The markers of the sensor's file; None where it has none.

    Raises:
        ConfigError: Markers are there, but not where the file says.
    """
    if grid is None:
        return None
    radius_px = grid.radius_m / geometry.mean_scale_m
    expected = geometry.to_pixels(marker_places(grid))
    border = _REACH * radius_px + 1.0
    size = np.array([geometry.width, geometry.height]) - 1.0
    whole = expected[np.all((expected > border) & (expected < size - border), axis=1)]
    found = dark_markers(to_grey(frame), radius_px=radius_px)
    if len(whole) == 0 or len(found) < _FOUND_SHARE * len(whole):
        return None
    pitch_px = min(grid.pitch_m) / geometry.mean_scale_m
    off = cKDTree(expected).query(found)[0]
    kept = found[off < 0.5 * pitch_px]
    if len(kept) < _FOUND_SHARE * len(whole):
        raise ConfigError(
            f"{len(found)} markers are in the no-contact frame, {len(kept)} of them near one of "
            f"the {len(whole)} places of the sensor's file",
            remedy="correct columns, rows and pitch in the sensor's [markers], or its pixel size",
        )
    reach_px = _REACH * radius_px
    kept = np.concatenate([kept, _cut_off(expected, kept, reach_px, size)])
    rows, columns = np.indices(frame.shape[:2])
    mask = cKDTree(kept).query(np.stack([columns, rows], axis=-1))[0] <= reach_px
    bare = cv2.inpaint(frame, mask.astype(np.uint8), 3.0, cv2.INPAINT_TELEA)
    share = frame.astype(np.float32) / np.maximum(bare.astype(np.float32), 1.0)
    return PrintedMarkers(
        bare=np.asarray(bare, dtype=np.uint8),
        ink=np.asarray(share, dtype=np.float32),
        mask=mask,
        centres_px=kept,
        places_m=geometry.to_pad(kept),
        reach_px=reach_px,
    )


def _cut_off(
    expected: FloatArray, found: FloatArray, reach_px: float, size: FloatArray
) -> FloatArray:
    """Return where the markers lie that the image's border cuts, from all the others [px]."""
    grid = expected[cKDTree(expected).query(found)[1]]
    terms = np.column_stack([grid, np.ones(len(grid))])
    map_to_image = np.linalg.lstsq(terms, found, rcond=None)[0]
    predicted = np.column_stack([expected, np.ones(len(expected))]) @ map_to_image
    missing = cKDTree(found).query(predicted)[0] > reach_px
    shown = np.all((predicted > -reach_px) & (predicted < size + reach_px), axis=1)
    return np.asarray(predicted[missing & shown])


def marker_places(grid: MarkerGrid) -> FloatArray:
    """Return the markers' centres at rest from the pad's centre [m], row by row, shape [n, 2]."""
    x = (np.arange(grid.columns) - 0.5 * (grid.columns - 1)) * grid.pitch_m[0]
    y = (np.arange(grid.rows) - 0.5 * (grid.rows - 1)) * grid.pitch_m[1]
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def draw_markers(
    image: ImageArray, places: FloatArray, radius_m: float, geometry: CameraGeometry
) -> ImageArray:
    """Print dots over an image, RGB, uint8, with edges softened over one pixel.

    Their centres on the pad are of shape [n, 2] [m].
    """
    away = cKDTree(places).query(np.stack(geometry.pad_grid(), axis=-1))[0]
    inside = (radius_m - away) / geometry.mean_scale_m
    cover = np.clip(inside / _EDGE_PX + 0.5, 0.0, 1.0)
    dimmed = image * (1.0 - (1.0 - _INK) * cover[..., None])
    return np.asarray(np.rint(dimmed), dtype=np.uint8)
