"""Camera frames at a twin's size, the residual of its images, and its pictures as JPEG."""

from __future__ import annotations

import math

import cv2
import numpy as np

from reports.evidence.attempt import crop_and_resize
from reports.evidence.evidence import ImageGeometry
from reports.scores.contact import (
    contact_footprint,
    contact_region,
    image_change,
    relative_residual,
)
from sim.sensor.camera_geometry import CameraGeometry
from sim.twin.follower import TwinFrame
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.rgb import decode_rgb, encode_jpeg, reduction_to

_QUALITY = 85


class CameraImages:
    """Frames of a camera as images of a twin's size.

    Args:
        view: Where the pixels of the twin's images look.
        crop_fraction: Part of a frame's width and height cut off at each border.
        frame_width_px: Of the camera's frames.
    """

    def __init__(self, view: CameraGeometry, *, crop_fraction: float, frame_width_px: int) -> None:
        self._geometry = ImageGeometry(
            crop_fraction=crop_fraction, width_px=view.width, height_px=view.height
        )
        room = (1.0 - 2.0 * crop_fraction) * frame_width_px / view.width
        self._reduction = reduction_to(room)

    def of(self, jpeg: bytes) -> ImageArray | None:
        """Return the image of a frame, RGB; None where it is no whole image or too small."""
        image = decode_rgb(jpeg, reduction=self._reduction)
        if image is None:
            return None
        try:
            return crop_and_resize(image, self._geometry)
        except RecordError:
            return None


def contact_residual(real: ImageArray, simulated: ImageArray, unloaded: ImageArray) -> float | None:
    """Return |real - simulated| / |real| of the changes in the contact that the real image shows.

    0 is perfect, 1 is what no contact would leave; None where the real image shows no contact.
    """
    change = image_change(real, unloaded)
    footprint = contact_footprint(change)
    if footprint is None:
        return None
    found = relative_residual(change, image_change(simulated, unloaded), contact_region(footprint))
    return found if math.isfinite(found) else None


def jpeg_of(image: ImageArray) -> bytes:
    """Return an RGB image as JPEG."""
    return encode_jpeg(image, quality=_QUALITY)


def maps_of(frame: TwinFrame) -> dict[str, tuple[float, bytes]]:
    """Return the largest value [kPa] and a JPEG of the maps that a frame has, by name.

    Black is nothing, light yellow the largest value.
    """
    found = {}
    for name, values in (("pressure", frame.pressure_pa), ("shear", frame.shear_pa)):
        if values is None:
            continue
        most_pa = float(values.max())
        share = np.clip(values / max(most_pa, 1e-300), 0.0, 1.0)
        drawn = cv2.applyColorMap(np.rint(255.0 * share).astype(np.uint8), cv2.COLORMAP_INFERNO)
        image = np.asarray(cv2.cvtColor(drawn, cv2.COLOR_BGR2RGB), np.uint8)
        found[name] = 1e-3 * most_pa, jpeg_of(image)
    return found
