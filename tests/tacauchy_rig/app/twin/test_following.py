"""A twin beside a run: its phases, the no-contact frame, and what it says of each frame."""

from __future__ import annotations

import time

import cv2
import numpy as np
import pytest

from protocols.processes.feed import Shown
from tacauchy_rig.app.twin.following import MAPS_EVERY, STALE_NS, RunFollower
from tacauchy_rig.app.twin.twin import Follows, Twin, twin_of
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.run import JournalEvent, Phase


@pytest.fixture(scope="module")
def simulator() -> Twin:
    """Return the twin of the default configuration."""
    return twin_of(load_config(None).config)


@pytest.fixture
def twin(simulator: Twin) -> RunFollower:
    """Return a twin whose run has just shown its no-contact frames."""
    made = RunFollower(simulator, Follows.FORCE, frame_width_px=640)
    made.note(_phase(Phase.REFERENCE))
    frame = np.full((480, 640, 3), 120, np.uint8)
    picture = bytes(cv2.imencode(".jpg", frame)[1])
    made.take(Shown(stream="camera", stamp_ns=1, numbers={}, picture=picture))
    return made


def _phase(phase: Phase) -> JournalEvent:
    return JournalEvent(stamp_ns=1, name="phase", detail={"phase": phase.value}, trial=2)


def _force(force_n: float, *, age_ns: int = 0) -> Shown:
    numbers = {"force_n": [force_n]}
    return Shown(stream="force", stamp_ns=time.monotonic_ns() - age_ns, numbers=numbers)


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
    before = twin.latest.dropped_count
    twin.take(_force(1.0, age_ns=2 * STALE_NS))
    assert twin.step() is None
    assert twin.latest.dropped_count == before + 1
