"""What the protocol may ask of a force sensor; real, emulated and mock ones all answer to it."""

from __future__ import annotations

from typing import Protocol

from drivers.device.interface import StreamingDevice
from tacauchy_rig.core.run import ForceSample


class ForceTorqueSensor(StreamingDevice[ForceSample], Protocol):
    """A six-axis force/torque sensor that streams by itself."""
