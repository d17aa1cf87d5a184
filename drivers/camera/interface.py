"""What the protocol may ask of a camera; real, emulated and mock ones all answer to it."""

from __future__ import annotations

from typing import Protocol

from drivers.device.interface import StreamingDevice
from tacauchy_rig.core.run import ImageFrame


class Camera(StreamingDevice[ImageFrame], Protocol):
    """A camera that delivers JPEG frames as they come."""
