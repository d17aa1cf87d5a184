"""What a twin is to follow: the latest, with what was left out counted."""

from __future__ import annotations

import pytest

from protocols.processes.feed import Shown
from tacauchy_rig.app.twin.following import LatestValue
from tacauchy_rig.app.twin.twin import Follows


def _force(stamp_ns: int, *forces_n: float) -> Shown:
    return Shown(stream="force", stamp_ns=stamp_ns, numbers={"force_n": list(forces_n)})


def _arm(stamp_ns: int, height_m: float) -> Shown:
    return Shown(stream="arm", stamp_ns=stamp_ns, numbers={"position_m": (0.0, 0.0, height_m)})


def test_the_latest_force_wins_and_the_others_are_counted() -> None:
    """Of three that came, the last sample of the last is followed, once."""
    latest = LatestValue(Follows.FORCE)
    for number in (1, 2, 3):
        latest.take(_force(number * 10**9, 0.0, 0.1 * number))
    goal = latest.goal()
    assert goal is not None
    assert (goal.force_n, goal.stamp_s, goal.depth_m) == (pytest.approx(0.3), 3.0, None)
    assert latest.dropped_count == 2
    assert latest.goal() is None


def test_depth_counts_from_where_the_press_begins() -> None:
    """Before, the force is followed; then the way down is added to what is pressed in already."""
    latest = LatestValue(Follows.DEPTH)
    latest.take(_force(1, 0.2))
    latest.take(_arm(2, 0.1))
    found = latest.goal()
    assert found is not None
    assert found.force_n == 0.2
    latest.begin_press(0.1, 20e-6)
    latest.take(_force(3, 0.4))
    latest.take(_arm(4, 0.0997))
    found = latest.goal()
    assert found is not None
    assert found.force_n is None
    assert found.depth_m == pytest.approx(320e-6)
    latest.end_press()
    latest.take(_force(5, 0.5))
    found = latest.goal()
    assert found is not None
    assert found.force_n == 0.5


def test_the_picture_nearest_in_time_is_found() -> None:
    """Of the last few; without any there is none."""
    latest = LatestValue(Follows.FORCE)
    assert latest.picture(1.0) is None
    for number in range(20):
        stamp = number * 40_000_000
        latest.take(Shown(stream="camera", stamp_ns=stamp, numbers={}, picture=b"%d" % number))
    assert latest.picture(0.681) == b"17"
    assert latest.picture(0.0) == b"12"
    assert latest.pictures()[-1] == b"19"
