"""From a trial's raw streams to images, curves and timing; pure functions of what was recorded."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from reports.arrays import ColorImage, FloatArray
from reports.evidence.evidence import Curve, ImageGeometry, StreamTiming, TrialImages
from tacauchy_rig.errors import RecordError
from tacauchy_rig.run import ImageFrame

IntArray = NDArray[np.int64]
FZ, Z = 2, 2
MIN_FRAMES_TO_SPLIT = 4

logger = logging.getLogger(__name__)


def decode_frame(frame: ImageFrame) -> ColorImage | None:
    """Decode a JPEG frame to RGB, shape [height, width, 3]; None when it is no whole image."""
    data = np.frombuffer(frame.jpeg, dtype=np.uint8)
    image = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    if image is None:
        logger.warning("frame %d (%d bytes) is no image; left out", frame.counter, data.size)
        return None
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def crop_and_resize(image: ColorImage, geometry: ImageGeometry) -> ColorImage:
    """Cut the borders off and average down to the scored size.

    Raises:
        RecordError: The crop leaves fewer pixels than the scored image has.
    """
    height, width = image.shape[:2]
    top, left = (
        math.floor(height * geometry.crop_fraction),
        math.floor(width * geometry.crop_fraction),
    )
    cropped = image[top : height - top, left : width - left]
    if cropped.shape[0] < geometry.height_px or cropped.shape[1] < geometry.width_px:
        raise RecordError(
            f"a {width}x{height} px frame is smaller after the crop than the scored"
            f" {geometry.width_px}x{geometry.height_px} px",
            remedy="choose a larger camera mode, or a smaller image in the sensor's file",
        )
    size = (geometry.width_px, geometry.height_px)
    resized = cv2.resize(np.ascontiguousarray(cropped), size, interpolation=cv2.INTER_AREA)
    return np.asarray(resized, dtype=np.uint8)


def scored_frames(frames: Iterable[ImageFrame], geometry: ImageGeometry) -> list[ColorImage]:
    """Decode, crop and resize frames; those that are no image are left out."""
    decoded = (decode_frame(frame) for frame in frames)
    return [crop_and_resize(image, geometry) for image in decoded if image is not None]


def median_image(images: Sequence[ColorImage]) -> ColorImage:
    """Return the pixelwise median of at least one image, rounded to 8 bits."""
    middle = np.rint(np.median(np.stack(images), axis=0))
    return np.asarray(middle, dtype=np.uint8)


def trial_images(
    dwell: Iterable[ImageFrame], reference: Iterable[ImageFrame], geometry: ImageGeometry
) -> TrialImages | None:
    """Make the images of a trial from the frames of its dwell and of its no-contact window.

    Returns:
        None when either window has no readable frame.
    """
    pressed, unloaded = scored_frames(dwell, geometry), scored_frames(reference, geometry)
    if not pressed or not unloaded:
        return None
    half = len(pressed) // 2
    split = len(pressed) >= MIN_FRAMES_TO_SPLIT
    return TrialImages(
        real=median_image(pressed),
        reference=median_image(unloaded),
        first_half=median_image(pressed[:half]) if split else None,
        second_half=median_image(pressed[half:]) if split else None,
        frame_count=len(pressed),
    )


def force_curve(
    stamp_ns: IntArray, wrench: FloatArray, *, tare_fz_n: float, sign: int, zero_ns: int
) -> Curve:
    """Return the tared pressing force [N], positive in compression.

    Args:
        stamp_ns: Arrival stamps [ns], shape [n].
        wrench: Raw force and moment [N, N m], shape [n, 6].
        tare_fz_n: Raw Fz of the unloaded sensor [N].
        sign: ``force_sensor.compression_sign``.
        zero_ns: Stamp that becomes time zero.
    """
    return Curve(time_s=_seconds(stamp_ns - zero_ns), value=sign * (wrench[:, FZ] - tare_fz_n))


def depth_curve(stamp_ns: IntArray, pose: FloatArray, *, contact_z_m: float, zero_ns: int) -> Curve:
    """Return the travel below the height of first contact [m].

    Args:
        stamp_ns: Arrival stamps [ns], shape [n].
        pose: Pose of the tip in the base frame [m, rad], shape [n, 6].
        contact_z_m: Height of the tip at first contact [m].
        zero_ns: Stamp that becomes time zero.
    """
    return Curve(time_s=_seconds(stamp_ns - zero_ns), value=contact_z_m - pose[:, Z])


def _seconds(duration_ns: IntArray) -> FloatArray:
    return np.asarray(duration_ns * 1e-9, dtype=np.float64)


def stream_timing(
    name: str,
    stamp_ns: IntArray,
    *,
    counter: IntArray | None = None,
    nominal_rate_hz: float | None = None,
) -> StreamTiming:
    """Return the arrival intervals of a stream, and its losses where it has a counter."""
    lost = None
    if counter is not None and len(counter):
        lost = int(counter[-1] - counter[0] + 1 - len(counter))
    return StreamTiming(
        name=name,
        nominal_rate_hz=nominal_rate_hz,
        intervals_s=_seconds(np.diff(stamp_ns)),
        lost_count=lost,
    )
