"""Where frames of a batch begin, and which of Newton's steps it takes."""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from sim.batch.environment import BatchOptions, extrapolation
from sim.batch.iteration import iteration_limits
from sim.batch.kernels.evaluate import judged
from sim.batch.kernels.state import (
    NEXT_FRAME,
    SHORTEN,
    START,
    Limits,
    Progress,
    zeroed,
)
from sim.device import Device

_OPTIONS = BatchOptions(residual_relative=1e-5)


@wp.kernel(enable_backward=False)
def _judge(
    sums: wp.vec3d,
    pushed: wp.vec3d,
    limits: Limits,
    progress: Progress,
    found_out: wp.array(dtype=wp.int32),
):
    found_out[0] = judged(0, sums, pushed, limits, progress)


def _judged(residual: float, *, slope: float, started: float = 1.0, trying: bool = True) -> int:
    """Judge a step from a residual of ``started`` along which the energy falls by one."""
    device = Device("cpu")
    progress = zeroed(Progress, 1, device)
    progress.started.fill_(started)
    progress.slope.fill_(1.0)
    progress.trying.fill_(int(trying))
    found = device.zeros(1, wp.int32)
    wp.launch(
        _judge,
        dim=1,
        inputs=[
            wp.vec3d(residual**2, slope, 0.0),
            wp.vec3d(0.0, 0.0, 1.0),
            iteration_limits(_OPTIONS, floor_n=1e-12),
            progress,
        ],
        outputs=[found],
        device="cpu",
    )
    return int(found.numpy()[0])


@pytest.mark.parametrize(
    ("residual", "slope", "wanted"),
    [
        (0.1, 0.0, START),
        (0.1, 0.95, SHORTEN),
        (3.9, -5.0, START),
        (4.1, -5.0, SHORTEN),
        (float("nan"), 0.0, SHORTEN),
        (1e-6, 0.0, NEXT_FRAME),
    ],
)
def test_a_step_is_taken_unless_it_goes_too_far(residual: float, slope: float, wanted: int) -> None:
    """Uphill at its end, or a residual of more than four times, shortens it; balance ends all."""
    assert _judged(residual, slope=slope) == int(wanted)


def test_where_a_frame_begins_is_not_a_step() -> None:
    """What a residual was before says nothing of a new frame's first."""
    assert _judged(1e3, slope=0.0, trying=False) == int(START)


def test_frames_begin_where_those_before_lead() -> None:
    """A line from the untouched gel, one through two frames, then a parabola through three."""
    depths = np.array([[1.0], [2.0], [4.0], [7.0], [8.0]])
    shares = extrapolation(depths)[:, 0]
    for frame, power in ((0, 1), (1, 1), (2, 2), (3, 2)):
        known = [depths[k, 0] if k >= 0 else 0.0 for k in (frame, frame - 1, frame - 2)]
        ahead = shares[frame] @ np.array(known) ** power
        assert ahead == pytest.approx(depths[frame + 1, 0] ** power)
