"""Long computations end in time and say what they do."""

from __future__ import annotations

import time
from threading import Event

import pytest

from tacauchy_rig.core import long_task
from tacauchy_rig.core.errors import TimeLimitError
from tacauchy_rig.core.long_task import Remaining, check_time, doing, time_left_s, time_limit, told


def test_the_nearest_limit_counts_and_is_named() -> None:
    """Of two limits the shorter, also before something new is begun; none is left outside."""
    with time_limit(60.0), time_limit(1e-9):
        assert time_left_s() <= 1e-9
        with pytest.raises(TimeLimitError, match="limit of 1e-09 s") as caught, doing("pressing"):
            pass
    assert caught.value.remedy
    check_time()


def test_the_error_names_the_step_and_how_far_it_was() -> None:
    """Both, from the outermost on."""
    with doing("press"), doing("pressing to 1 N") as at:
        at("0.2 mm, 0.5 N")
        with time_limit(0.0), pytest.raises(TimeLimitError, match="press: pressing to 1 N: 0"):
            check_time()


def test_what_takes_long_is_told_and_idle_time_is_not() -> None:
    """Another thread tells of a step; between steps it says nothing."""
    said, heard = [], Event()

    def say(text: str) -> None:
        said.append(text)
        heard.set()

    with told(say, silent_s=0.02):
        time.sleep(0.06)
        assert said == []
        with doing("meshing"):
            assert heard.wait(30.0)
    assert said[0].endswith("s: meshing")


def test_what_is_left_follows_how_fast_it_went(monkeypatch: pytest.MonkeyPatch) -> None:
    """At first by what others leave of the processors, then by what was seen."""
    now = [0.0]
    monkeypatch.setattr(long_task.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(long_task.os, "getloadavg", lambda: (2.0, 0.0, 0.0))
    monkeypatch.setattr(long_task.os, "cpu_count", lambda: 2)
    left = Remaining(200.0, jobs=2)
    assert left.seconds() == pytest.approx(200.0)  # four programs on two processors
    for _ in range(10):
        now[0] += 30.0
        left.spend(10.0)
    assert left.seconds() == pytest.approx(300.0, rel=0.15)
    assert str(left) == "about 5 min left"
