"""Intermediate states of a press: what a replay keeps of it, and the frames nearest in force."""

from collections.abc import Mapping

import numpy as np

from reports.evidence.evidence_types import IntermediateFrame, IntermediateState
from reports.evidence.frames_and_curves import AttemptReading, crop_and_resize, decode_frame
from tacauchy_rig.core.arrays import AnyArray, FloatArray

NEAR = 0.05  # of a press's force: a frame that was taken at a force farther off is not shown
_KEYS = {"force_n", "depth_m", "image", "dent_m", "pressure_pa"}


def intermediate_states(
    passed: Mapping[str, AnyArray], attempt: AttemptReading | None
) -> tuple[IntermediateState, ...]:
    """Return the states that a replay kept, the smallest force first; the last is the press's own.

    ``passed``, the arrays of ``passed.npz``, is empty of a replay from before it was kept.
    """
    if not passed.keys() >= _KEYS:
        return ()
    frames = _frames(passed["force_n"], attempt)
    return tuple(
        IntermediateState(**{name: passed[name][k] for name in _KEYS}, frame=frame)
        for k, frame in enumerate(frames)
    )


def _frames(force_n: FloatArray, attempt: AttemptReading | None) -> list[IntermediateFrame | None]:
    """Return the recorded frame nearest in force to each; of the last, what the dwell shows."""
    if attempt is None:
        return [None] * len(force_n)
    near_n = NEAR * float(force_n[-1])
    rising = [_nearest(attempt, float(each), near_n) for each in force_n[:-1]]
    record, held = attempt.record, None
    if attempt.images is not None:
        held = IntermediateFrame(
            image=attempt.images.real,
            force_n=record.force_measured_n,
            depth_m=record.depth_measured_m,
        )
    return [*rising, held]


def _nearest(attempt: AttemptReading, force_n: float, near_n: float) -> IntermediateFrame | None:
    """Return the frame before the dwell taken nearest to a force; None if that is not near."""
    curve, stamps, depth = attempt.force_curve, attempt.frame_stamps, attempt.depth_curve
    before = stamps.time_s < 0.0  # the curves' time begins with the dwell
    start_ns = attempt.record.reference_end_ns
    if start_ns is not None:
        before &= stamps.value > start_ns
    if curve is None or not len(curve.time_s) or not before.any():
        return None
    time_s, stamp_ns = stamps.time_s[before], stamps.value[before]
    carried_n = np.interp(time_s, curve.time_s, curve.value)
    k = int(np.argmin(np.abs(carried_n - force_n)))
    if not abs(carried_n[k] - force_n) <= near_n:
        return None
    # Stamps went through a float: a microsecond is more than what that rounds.
    around = attempt.recording.frames(int(stamp_ns[k]) - 1000, int(stamp_ns[k]) + 1000)
    image = next((seen for seen in map(decode_frame, around) if seen is not None), None)
    if image is None:
        return None
    return IntermediateFrame(
        image=crop_and_resize(image, attempt.geometry),
        force_n=float(carried_n[k]),
        depth_m=float(np.interp(time_s[k], depth.time_s, depth.value))
        if depth and len(depth.time_s)
        else None,
    )
