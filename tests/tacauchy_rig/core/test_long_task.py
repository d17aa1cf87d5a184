"""Long computations end in time and say what they do."""

from __future__ import annotations

import time
from threading import Event

import pytest

from tacauchy_rig.core.errors import TimeLimitError
from tacauchy_rig.core.long_task import check_time, doing, time_left_s, time_limit, told


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
