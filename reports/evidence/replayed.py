"""What a replay keeps of a press: pressure, shear, and intermediate states with camera frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator

from reports.evidence.attempt import AttemptReading, crop_and_resize, decode_frame
from reports.evidence.evidence import Curve, IntermediateFrame, IntermediateState
from tacauchy_rig.core.arrays import AnyArray, FloatArray, ImageArray


def pressure_at(
    fields: Mapping[str, NDArray[Any]], x_m: FloatArray, y_m: FloatArray
) -> FloatArray | None:
    """Return a replayed trial's contact pressure at places of the pad [Pa]; None without one."""
    return _surface_values(fields, "contact_pressure_pa", x_m, y_m)


def shear_at(
    fields: Mapping[str, NDArray[Any]], x_m: FloatArray, y_m: FloatArray
) -> FloatArray | None:
    """Return the shear on the gel along x and y there [Pa], a last axis of 2; None likewise."""
    shear = _surface_values(fields, "contact_shear_pa", x_m, y_m)
    return None if shear is None else shear[..., :2]


def _surface_values(
    fields: Mapping[str, NDArray[Any]], name: str, x_m: FloatArray, y_m: FloatArray
) -> FloatArray | None:
    if not {"node_m", name} <= fields.keys():
        return None
    at = LinearNDInterpolator(fields["node_m"][:, :2], fields[name], fill_value=0.0)
    return np.asarray(at(x_m, y_m), dtype=np.float64)


NEAR = 0.05
"""Of a press's force: a frame that was taken at a force farther off is not shown."""
_KEYS = {"force_n", "depth_m", "image", "dent_m", "pressure_pa"}


def intermediate_states(
    passed: Mapping[str, AnyArray], attempt: AttemptReading | None
) -> tuple[IntermediateState, ...]:
    """Return the states that a replay kept, the smallest force first; the last is the press's own.

    Args:
        passed: Arrays of ``passed.npz``; empty of a replay from before it was kept.
        attempt: What was recorded; None where that cannot be read.
    """
    if not passed.keys() >= _KEYS:
        return ()
    frames = _frames(passed["force_n"], attempt)
    return tuple(
        IntermediateState(
            force_n=float(passed["force_n"][k]),
            depth_m=float(passed["depth_m"][k]),
            image=passed["image"][k],
            dent_m=passed["dent_m"][k],
            pressure_pa=passed["pressure_pa"][k],
            frame=frame,
        )
        for k, frame in enumerate(frames)
    )


def _frames(force_n: FloatArray, attempt: AttemptReading | None) -> list[IntermediateFrame | None]:
    """Return the recorded frame nearest in force to each; of the last, what the dwell shows."""
    if attempt is None:
        return [None] * len(force_n)
    rising = _Rising(attempt)
    near_n = NEAR * float(force_n[-1])
    return [*(rising.nearest(float(each), near_n) for each in force_n[:-1]), _held(attempt)]


def _held(attempt: AttemptReading) -> IntermediateFrame | None:
    record = attempt.record
    if attempt.images is None:
        return None
    return IntermediateFrame(
        image=attempt.images.real,
        force_n=record.force_measured_n,
        depth_m=record.depth_measured_m,
    )


@dataclass(frozen=True, slots=True)
class _Rising:
    """The frames of an attempt from the no-contact ones to the dwell."""

    attempt: AttemptReading

    def nearest(self, force_n: float, near_n: float) -> IntermediateFrame | None:
        """Return the frame that was taken nearest to a force; None if that is not near."""
        curve, stamps = self.attempt.force_curve, self.attempt.frame_stamps
        # The curves' time begins with the dwell.
        before = stamps.time_s < 0.0
        start_ns = self.attempt.record.reference_end_ns
        if start_ns is not None:
            before &= stamps.value > start_ns
        if curve is None or not len(curve.time_s) or not before.any():
            return None
        time_s, stamp_ns = stamps.time_s[before], stamps.value[before]
        carried_n = np.interp(time_s, curve.time_s, curve.value)
        k = int(np.argmin(np.abs(carried_n - force_n)))
        if not abs(carried_n[k] - force_n) <= near_n:
            return None
        image = self._image(int(stamp_ns[k]))
        if image is None:
            return None
        depth = self.attempt.depth_curve
        return IntermediateFrame(
            image=image,
            force_n=float(carried_n[k]),
            depth_m=_at(depth, float(time_s[k])) if depth and len(depth.time_s) else None,
        )

    def _image(self, stamp_ns: int) -> ImageArray | None:
        # Stamps went through a float: a microsecond is more than what that rounds.
        for frame in self.attempt.recording.frames(stamp_ns - 1000, stamp_ns + 1000):
            image = decode_frame(frame)
            if image is not None:
                return crop_and_resize(image, self.attempt.geometry)
        return None


def _at(curve: Curve, time_s: float) -> float:
    return float(np.interp(time_s, curve.time_s, curve.value))
