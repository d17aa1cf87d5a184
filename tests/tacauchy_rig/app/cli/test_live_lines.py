"""The lines that follow a press on a terminal."""

from __future__ import annotations

import io

from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from tacauchy_rig.app.cli.progress import (
    EMPTY,
    FULL,
    HOW_TO_STOP,
    MARK,
    PHASES,
    force_bar,
    live_lines,
)
from tacauchy_rig.core.run import Phase

FACTS = {
    "step": "pressing to the target",
    "trial": "trial 2 of 6",
    "force_n": 1.5,
    "target_n": 2.0,
    "tolerance_n": 0.03,
    "limit_n": 6.0,
    "height_m": 0.1997,
    "left_s": 75.4,
}


def shown(width, **changes):
    """Return the lines as a terminal of that width shows them."""
    out = io.StringIO()
    Console(file=out, width=width, force_terminal=False).print(
        live_lines(**{**FACTS, **changes}, width=width)
    )
    return out.getvalue().splitlines()


def test_force_target_time_and_the_way_to_stop_are_told():
    """Four lines of a usual terminal."""
    step, force, when, how = shown(100)
    assert step == "  pressing to the target   trial 2 of 6"
    assert force.startswith("   1.500 N " + FULL)
    assert force.endswith(" of 2.000 ± 0.03 N, limit 6 N")
    assert when == "  about 1 min 15 s left   z 199.700 mm"
    assert how.strip() == HOW_TO_STOP


def test_nothing_is_wrapped_on_a_narrow_terminal():
    """A line that wraps would push the others away: ends are cut off."""
    lines = shown(30)
    assert len(lines) == 4
    assert lines[-1].startswith("  any key stops")


def test_before_the_first_force_nothing_is_made_up():
    """No target, no height, no time: those parts are left out."""
    lines = shown(80, force_n=None, target_n=None, height_m=None, left_s=None)
    assert MARK not in lines[1]
    assert lines[2].strip() == ""


@given(force_n=st.floats(-20.0, 20.0), target_n=st.floats(0.0, 8.0), width=st.integers(10, 200))
def test_a_bar_is_as_wide_as_asked(force_n, target_n, width):
    """Whatever the force: beyond the limit the bar is full, below nothing it is empty."""
    bar = force_bar(force_n, target_n, limit_n=6.0, width=width)
    assert len(bar) == width
    assert set(bar) <= {FULL, EMPTY, MARK}
    assert (MARK in bar) == (target_n <= 6.0)


def test_every_phase_has_words() -> None:
    """An operator reads no name of the program's."""
    assert set(PHASES) == {phase.value for phase in Phase}
    assert all(" " in words or words == "judging" for words in PHASES.values())
