"""How far the zero wandered between the tares before and after a press."""

from __future__ import annotations

from tacauchy_rig.config.model import RigConfig
from tacauchy_rig.run import Tare

FZ = 2


def force_drift(before: Tare, after: Tare, *, config: RigConfig) -> float:
    """Return the unloaded pressing force after minus before [N]."""
    return config.force_sensor.compression_sign * (after.mean[FZ] - before.mean[FZ])
