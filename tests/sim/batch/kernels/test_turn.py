"""What an environment does after an evaluation, by numbers set by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp

from sim.batch.environment import BatchOptions
from sim.batch.iteration import iteration_limits
from sim.batch.kernels.state import (
    ADVANCE_SEARCH,
    END_SEARCH,
    EVALUATE,
    FAILED,
    GIVE_UP,
    NEXT_FRAME,
    NOTHING,
    SEARCH,
    SHORTEN,
    START,
    START_ANEW,
    WAIT,
    Found,
    Progress,
    Vectors,
    zeroed,
)
from sim.batch.kernels.turn import turn
from sim.device import Device

CPU = Device("cpu")
RESIDUAL, PRECONDITIONED = np.array([3.0, -1.0, 2.0]), np.array([0.5, 0.25, -0.125])
# Residuals are handed to the preconditioner over their norm: what it gives is in these units.
NORM, UNIT = 4.0, 0.5
SIZE = NORM * UNIT
SCALED = SIZE * float(RESIDUAL @ PRECONDITIONED)
DEPTHS_M, TOUCH_M = np.array([1e-4, 3e-4]), 5e-3


class Turned:
    """One environment after one launch, from numbers that are given.

    Args:
        act: What was called for.
        progress: Numbers of ``Progress``.
    """

    def __init__(self, act: int, *, status: int, **progress: float) -> None:
        self.progress, self.vectors = zeroed(Progress, 1, CPU), zeroed(Vectors, (1, 3), CPU)
        self.found = zeroed(Found, (2, 1), CPU)
        given = {"act": act, "status": status, "norm": NORM, **progress}
        for name, value in given.items():
            getattr(self.progress, name).fill_(value)
        self.set("residuals", RESIDUAL)
        self.set("preconditioned", PRECONDITIONED)
        self.set("steps", [1.0, 2.0, 3.0])
        self.set("accepted", [10.0, 20.0, 30.0])
        self.set("directions", [1.0, 0.0, -1.0])
        self.tips, self.busy = CPU.zeros(1, wp.vec3d), CPU.zeros(1, wp.int32)

    def set(self, name: str, values: Any) -> None:
        """Set one of the vectors."""
        getattr(self.vectors, name).numpy()[0] = values

    def launch(self, *, segment_end: int = 2) -> Turned:
        """Turn, and return what came of it."""
        limits = iteration_limits(BatchOptions(forcing=0.1, search_max=5), floor_n=1e-9)
        touch = CPU.array([[0.0, 0.0, TOUCH_M]], wp.vec3d)
        depths = CPU.array(DEPTHS_M[:, None], wp.float64)
        end = CPU.array([segment_end], wp.int32)
        inputs = [limits, 3, UNIT, depths, touch, end]
        outputs = [self.progress, self.vectors, self.tips, self.found, self.busy]
        CPU.launch_blocks(turn, 1, inputs, outputs, threads=1)
        return self

    def vector(self, name: str) -> Any:
        """Return one of the vectors."""
        return getattr(self.vectors, name).numpy()[0]

    def __getattr__(self, name: str) -> Any:
        """Return one of the numbers of ``Progress``."""
        return getattr(self.progress, name).numpy()[0]


def test_a_search_starts_along_the_preconditioned_residual() -> None:
    """Its direction is z, what it goes by r . z."""
    found = Turned(START, status=EVALUATE, newton=1).launch()
    assert (found.status, found.newton, found.searches) == (SEARCH, 2, 0)
    np.testing.assert_allclose(found.vector("directions"), SIZE * PRECONDITIONED)
    assert found.scaled == found.first_scaled == pytest.approx(SCALED)
    assert found.busy.numpy()[0] == 1


@pytest.mark.parametrize(("changed", "beta"), [(0, SCALED / 8.0), (1, 0.0)])
def test_the_next_direction_is_conjugate_or_begins_anew(changed: int, beta: float) -> None:
    """Take z + beta d, beta = r . z now over before; another preconditioner forgets d."""
    found = Turned(
        ADVANCE_SEARCH, status=SEARCH, scaled=8.0, first_scaled=8.0, length=0.5, changed=changed
    ).launch()
    wanted = SIZE * PRECONDITIONED + beta * np.array([1.0, 0.0, -1.0])
    np.testing.assert_allclose(found.vector("directions"), wanted, rtol=1e-6)
    assert (found.status, found.searches, found.changed) == (SEARCH, 1, 0)
    assert found.slope == pytest.approx(0.5 * 8.0)


@pytest.mark.parametrize(
    "given",
    [{"first_scaled": 1.01 * SCALED / 0.1**2, "searches": 0}, {"first_scaled": 1.0, "searches": 4}],
    ids=["near enough", "too many"],
)
def test_a_search_ends_with_a_trial(given: dict[str, float]) -> None:
    """At the forcing's square of the first r . z, or after ``search_max``: a full step is tried."""
    found = Turned(ADVANCE_SEARCH, status=SEARCH, fraction=0.25, halvings=3, **given).launch()
    assert (found.status, found.trying, found.fraction, found.halvings) == (EVALUATE, 1, 1.0, 0)
    np.testing.assert_allclose(found.vector("trials"), [11.0, 22.0, 33.0])


def test_a_step_that_was_too_long_is_halved() -> None:
    """And counted."""
    found = Turned(SHORTEN, status=EVALUATE, fraction=0.5, halvings=1).launch()
    assert (found.fraction, found.halvings, found.status) == (0.25, 2, EVALUATE)


def test_a_first_direction_without_curvature_is_tried_as_it_is() -> None:
    """Its slope is that of the direction."""
    found = Turned(END_SEARCH, status=SEARCH, scaled=7.0).launch()
    assert (found.status, found.trying, found.slope) == (EVALUATE, 1, 7.0)


def test_a_frame_in_balance_is_written_down_and_the_next_begun() -> None:
    """Residuals over the contact force; the indenter goes to the next depth below first touch."""
    begun = Turned(NEXT_FRAME, status=EVALUATE, newton=6, retries=1, vertical=2.0, gap=1e-6)
    begun.progress.push.fill_(wp.vec3d(0.0, 3.0, 4.0))
    found = begun.launch()
    assert (found.frame, found.newton, found.retries, found.status) == (1, 0, 0, EVALUATE)
    assert found.found.push.numpy()[0, 0].tolist() == [0.0, 3.0, 4.0]
    assert found.found.residual.numpy()[0, 0] == pytest.approx(NORM / 5.0)
    assert found.found.imbalance.numpy()[0, 0] == pytest.approx(2.0 / 5.0)
    assert found.found.gap.numpy()[0, 0] == 1e-6
    np.testing.assert_allclose(found.tips.numpy()[0], [0.0, 0.0, TOUCH_M - DEPTHS_M[1]])


def test_after_the_last_frame_it_waits() -> None:
    """And no longer keeps the segment going."""
    found = Turned(NEXT_FRAME, status=EVALUATE, frame=1).launch()
    assert (found.status, found.frame) == (WAIT, 2)
    assert found.busy.numpy()[0] == 0


def test_a_frame_begun_anew_is_counted_and_one_given_up_fails() -> None:
    """Failed, it keeps nothing going either."""
    anew = Turned(START_ANEW, status=EVALUATE, newton=40, trying=1).launch()
    assert (anew.newton, anew.trying, anew.retries, anew.busy.numpy()[0]) == (0, 0, 1, 1)
    failed = Turned(GIVE_UP, status=EVALUATE).launch()
    assert (failed.status, failed.busy.numpy()[0]) == (FAILED, 0)


def test_who_is_past_the_segments_end_keeps_nobody_waiting() -> None:
    """Nor does one that nothing was called for count as having spent anything."""
    assert Turned(SHORTEN, status=EVALUATE, frame=1).launch(segment_end=1).busy.numpy()[0] == 0
    assert Turned(NOTHING, status=WAIT).launch().spent == 0
    assert Turned(SHORTEN, status=EVALUATE).launch().spent == 1
