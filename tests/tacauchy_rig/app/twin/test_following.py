"""A twin beside a run: its phases, the no-contact frame, and what it says of each frame."""

from __future__ import annotations

import time

import cv2
import numpy as np
import pytest

from protocols.processes.messages import Shown
from tacauchy_rig.app.twin.twin import MAPS_EVERY, STALE_NS, Follows, RunFollower, Twin, twin_of
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.run import JournalEvent, Phase


@pytest.fixture(scope="module")
def simulator() -> Twin:
    """Return the twin of the default configuration."""
    return twin_of(load_config(None).config)


@pytest.fixture
def twin(simulator: Twin) -> RunFollower:
    """Return a twin whose run has just shown its no-contact frames."""
    made = RunFollower(simulator, Follows.FORCE)
    made.note(_phase(Phase.REFERENCE))
    frame = np.full((480, 640, 3), 120, np.uint8)
    picture = bytes(cv2.imencode(".jpg", frame)[1])
    made.take(Shown(stream="camera", stamp_ns=1, numbers={}, picture=picture))
    return made


def _phase(phase: Phase) -> JournalEvent:
    return JournalEvent(stamp_ns=1, name="phase", detail={"phase": phase.value}, trial=2)


def _force(*forces_n: float, age_ns: int = 0) -> Shown:
    numbers = {"force_n": list(forces_n)}
    return Shown(stream="force", stamp_ns=time.monotonic_ns() - age_ns, numbers=numbers)


def _arm(height_m: float) -> Shown:
    return Shown(stream="arm", stamp_ns=2, numbers={"position_m": (0.0, 0.0, height_m)})


def test_a_press_is_followed_over_the_runs_own_frame(twin: RunFollower) -> None:
    """The force is met, maps come with some frames, and no contact is the frame without one."""
    twin.note(_phase(Phase.APPROACH))
    twin.take(_force(0.0))
    made = twin.step()
    assert made is not None
    line, shown = made
    assert [each.stream for each in shown] == ["twin", "twin pressure", "twin shear"]
    image = cv2.imdecode(np.frombuffer(shown[0].picture or b"", np.uint8), cv2.IMREAD_COLOR)
    assert np.abs(image.astype(int) - 120).max() <= 3
    assert (line.force_n, line.trial, line.residual) == (0.0, 2, None)
    twin.note(_phase(Phase.PRESS))
    for number in range(MAPS_EVERY):
        twin.take(_force(1.0))
        made = twin.step()
        assert made is not None
        assert len(made[1]) == (3 if number == MAPS_EVERY - 1 else 1)
    line = made[0]
    assert line.asked_n == 1.0
    assert line.force_n == pytest.approx(1.0, rel=1e-4)
    assert line.force_error_n is not None
    assert 0.0 < line.force_error_n < 0.3
    assert line.lag_ms > 0.0


def test_between_presses_nothing_is_followed(twin: RunFollower) -> None:
    """While the arm goes home, the cell drifts and nothing is touched."""
    twin.note(_phase(Phase.DRIFT_CHECK))
    twin.take(_force(1.0))
    assert twin.step() is None


def test_what_is_old_is_left_out_and_counted(twin: RunFollower) -> None:
    """A force that waited in a full feed is of another moment."""
    twin.note(_phase(Phase.PRESS))
    before = twin.dropped_count
    twin.take(_force(1.0, age_ns=2 * STALE_NS))
    assert twin.step() is None
    assert twin.dropped_count == before + 1


def test_the_latest_force_wins_and_the_others_are_counted(twin: RunFollower) -> None:
    """Of three that came, the last sample of the last is followed, once."""
    for number in (1, 2, 3):
        twin.take(_force(0.0, 0.1 * number))
    goal = twin.goal()
    assert goal is not None
    assert (goal.force_n, goal.depth_m) == (pytest.approx(0.3), None)
    assert twin.dropped_count == 2
    assert twin.goal() is None


def test_depth_counts_from_where_the_press_begins(simulator: Twin) -> None:
    """Before and after, the force is followed; then the way down is added to what is pressed in."""
    twin = RunFollower(simulator, Follows.DEPTH)
    twin._depth_m = 20e-6
    goals = []
    for phase, force_n, height_m in (
        (Phase.APPROACH, 0.2, 0.1),
        (Phase.PRESS, 0.4, 0.0997),
        (Phase.DRIFT_CHECK, 0.5, 0.1),
    ):
        twin.note(_phase(phase))
        twin.take(_force(force_n))
        twin.take(_arm(height_m))
        goal = twin.goal()
        assert goal is not None
        goals.append((goal.force_n, goal.depth_m))
    assert goals == [(0.2, None), (None, pytest.approx(320e-6)), (0.5, None)]


def test_the_picture_nearest_in_time_is_found(simulator: Twin) -> None:
    """Of the last few; without any there is none."""
    twin = RunFollower(simulator, Follows.FORCE)
    assert twin.picture(1.0) is None
    for number in range(20):
        stamp = number * 40_000_000
        twin.take(Shown(stream="camera", stamp_ns=stamp, numbers={}, picture=b"%d" % number))
    assert twin.picture(0.681) == b"17"
    assert twin.picture(0.0) == b"12"
