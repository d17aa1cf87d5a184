"""Printed markers: found in a no-contact frame, followed into other frames, and what they hide."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from tacauchy_rig.core.arrays import BoolArray, Float32Array, FloatArray, ImageArray, RealArray
from tacauchy_rig.core.image_codec import to_grey

_WIDEST = 1.0 / 8.0  # of the image's height: what is wider is no marker
_EDGE_SHARE, _DARK_SHARE = 0.15, 0.3  # of the light that ink takes at its edge, and within
_LEAST_PX, _FEWEST = 8, 4
_BLURRED_PX = 3  # around a marker, which the lens spreads its ink over
_SMOOTHING_PX = 0.7
# Tracking: the pyramid's windows and levels, the way there and back, and what neighbours allow.
_WINDOW_PX, _LEVELS = 15, 3
_THERE_AND_BACK_PX, _OFF_NEIGHBOURS, _NEIGHBOURS = 0.5, 3.0, 6
_LEAST_OFF_PX, _OFF_SHARE = 1.5, 0.25  # the share is of the distance of the nearest marker
_UNLIKE_LEVELS = 40.0  # mean difference of two windows of one marker
FINE = 2  # samples a pixel of what is printed


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintedMarkers:
    """The markers of one no-contact frame."""

    frame: ImageArray  # the frame as it is, RGB, uint8, shape [height, width, 3]
    bare: ImageArray  # the frame without its markers, likewise
    dark: Float32Array  # colour of the ink [grey levels], shape [3]
    # How much of the gel is seen, 0 under ink and 1 beside it, then what red, green and blue differ
    # from ink and gel mixed so [grey levels]; also between pixels, by cubic interpolation: drawn
    # anywhere, it is hardly blurred, shape [2 height - 1, 2 width - 1, 4]
    fine: Float32Array
    mask: BoolArray  # true on the markers and a little beyond, shape [height, width]
    centres_px: FloatArray  # column and row of each marker at rest [px], shape [n, 2]

    def over(self, image: RealArray, motion_px: RealArray | None = None) -> FloatArray:
        """Return RGB of the bare gel [grey levels], [height, width, 3], with the markers over it.

        The gel that each pixel sees has moved along columns and rows by ``motion_px`` [px], shape
        [2, height, width]; None is gel at rest.
        """
        printed: Any = self.fine[::FINE, ::FINE]
        if motion_px is not None:
            rows, columns = np.indices(self.mask.shape, dtype=np.float32)
            x = (FINE * (columns - motion_px[0])).astype(np.float32)
            y = (FINE * (rows - motion_px[1])).astype(np.float32)
            border = cv2.BORDER_REPLICATE
            printed = cv2.remap(self.fine, x, y, cv2.INTER_LINEAR, borderMode=border)
        cover = printed[..., :1]
        return np.asarray(self.dark + cover * (image - self.dark) + printed[..., 1:], np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerTracks:
    """Markers of a frame at rest that were found again."""

    rest_px: FloatArray  # column and row of their centres at rest [px], shape [n, 2]
    motion_px: FloatArray  # along columns and rows [px], shape [n, 2]
    error_px: FloatArray  # standard error of each component, by how two windows differ [px], [n]
    lost: int  # markers at rest that were not found again


def find_markers(frame: ImageArray) -> PrintedMarkers | None:
    """Find dark markers in a no-contact frame, RGB, and take them off; None where it shows none.

    A make of sensor is sold with and without them, so the frame decides.
    """
    taken = ink_taken(frame)
    inked = (taken > _EDGE_SHARE).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(inked)
    widest = _widest_px(frame)
    area, sides = stats[:, cv2.CC_STAT_AREA], stats[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]]
    darkest = ndimage.maximum(taken, labels, np.arange(count))
    kept = (darkest > _DARK_SHARE) & (area >= _LEAST_PX) & (sides.max(axis=1) < 4 * widest)
    kept[0] = False
    if kept.sum() < _FEWEST:
        return None
    size = 2 * _BLURRED_PX + 1
    around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    mask = cv2.dilate(kept[labels].astype(np.uint8), around)
    bare = np.asarray(cv2.inpaint(frame, mask, _BLURRED_PX, cv2.INPAINT_TELEA), dtype=np.uint8)
    seen, gel = frame.astype(np.float32), bare.astype(np.float32)
    ink = taken > np.quantile(taken[kept[labels]], 0.5)
    dark = np.median(seen[ink & kept[labels]], axis=0)
    contrast = gel - dark
    cover = np.sum((seen - dark) * contrast, axis=2) / np.maximum(np.sum(contrast**2, axis=2), 1.0)
    cover = np.where(mask > 0, np.clip(cover, 0.0, 1.0), 1.0)[..., None]
    centres = ndimage.center_of_mass(taken.astype(np.float64), labels, np.flatnonzero(kept))
    printed = np.concatenate([cover, seen - dark - cover * contrast], axis=2).astype(np.float32)
    y, x = np.indices([FINE * (n - 1) + 1 for n in mask.shape], dtype=np.float32) / FINE
    fine = cv2.remap(printed, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return PrintedMarkers(
        frame=frame,
        bare=bare,
        dark=dark.astype(np.float32),
        fine=np.asarray(fine, dtype=np.float32),
        mask=mask > 0,
        centres_px=np.array(centres)[:, ::-1],
    )


def ink_taken(image: ImageArray) -> Float32Array:
    """Return the share of light that pixels lack of the gel around them, shape [height, width]."""
    grey = cv2.GaussianBlur(to_grey(image).astype(np.float32), (0, 0), _SMOOTHING_PX)
    size = 2 * _widest_px(image) // 2 + 1
    window = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    around = cv2.morphologyEx(grey, cv2.MORPH_CLOSE, window)
    return np.asarray(1.0 - grey / np.maximum(around, 1.0), dtype=np.float32)


def _widest_px(image: ImageArray) -> int:
    return max(5, round(_WIDEST * float(image.shape[0])))


def follow_markers(printed: PrintedMarkers, loaded: ImageArray) -> MarkerTracks:
    """Follow markers into another frame, RGB, by pyramidal Lucas-Kanade, there and back.

    What disagrees with its neighbours, is hidden, or looks otherwise is lost.
    """
    rest, taken = printed.centres_px, [ink_taken(image) for image in (printed.frame, loaded)]
    before, after = (np.clip(each * 255.0, 0.0, 255.0).astype(np.uint8) for each in taken)
    moved, error = _flow(before, after, rest)
    found = ~_off_neighbours(rest, moved)
    return MarkerTracks(
        rest_px=rest[found], motion_px=moved[found], error_px=error[found], lost=int(np.sum(~found))
    )


def _flow(before: ImageArray, after: ImageArray, rest: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return motions [px] and their standard errors [px]; not a number where none was found."""
    flow: Any = partial(
        cv2.calcOpticalFlowPyrLK,
        winSize=(_WINDOW_PX, _WINDOW_PX),
        maxLevel=_LEVELS,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 0.01),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    here = rest.astype(np.float32)
    there, seen, unlike = flow(before, after, here, here.copy())
    back, seen_back, _ = flow(after, before, there, here.copy())
    apart = np.linalg.norm(back - here, axis=1)
    good = (seen.ravel() > 0) & (seen_back.ravel() > 0) & (apart < _THERE_AND_BACK_PX)
    good &= unlike.ravel() < _UNLIKE_LEVELS
    slopes = np.square(np.array(np.gradient(before.astype(np.float64))))
    energy = cv2.boxFilter(0.5 * slopes.sum(axis=0), -1, (_WINDOW_PX, _WINDOW_PX), normalize=False)
    column, row = np.rint(rest).astype(int).T
    strength = energy[row.clip(0, len(energy) - 1), column.clip(0, energy.shape[1] - 1)]
    error = unlike.ravel() / np.sqrt(np.maximum(strength, 1e-9))
    motion = np.where(good[:, None], there - here, np.nan).astype(np.float64)
    return motion, np.where(good, error, np.nan)


def _off_neighbours(rest: FloatArray, moved: FloatArray) -> BoolArray:
    """Return True where a motion is unknown, or far from that of most neighbours."""
    known = np.isfinite(moved[:, 0])
    if known.sum() <= _NEIGHBOURS:
        return np.asarray(~known)
    places, motion = rest[known], moved[known]
    distance, which = cKDTree(places).query(places, k=_NEIGHBOURS + 1)
    near = motion[which[:, 1:]]
    middle = np.median(near, axis=1)
    spread = np.median(np.linalg.norm(near - middle[:, None], axis=2), axis=1)
    apart = np.linalg.norm(motion - middle, axis=1)
    off = np.array(~known)
    # A ball may take along a single marker of a wide grid; but none goes as far as the next one.
    least = np.maximum(_OFF_SHARE * distance[:, 1], _LEAST_OFF_PX)
    off[known] = apart > _OFF_NEIGHBOURS * spread + least
    return np.asarray(off, dtype=np.bool_)


def hidden_by(printed: PrintedMarkers, tracks: MarkerTracks) -> BoolArray:
    """Return True where markers hide the gel at rest or moved as they were tracked."""
    if len(tracks.rest_px) == 0:
        return printed.mask
    height, width = printed.mask.shape
    rows, columns = np.mgrid[:height, :width]
    places = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    nearest = cKDTree(tracks.rest_px + tracks.motion_px).query(places)[1]
    source = np.rint(places - tracks.motion_px[nearest]).astype(int)
    x, y = source[:, 0].clip(0, width - 1), source[:, 1].clip(0, height - 1)
    return np.asarray(printed.mask | printed.mask[y, x].reshape(height, width))
