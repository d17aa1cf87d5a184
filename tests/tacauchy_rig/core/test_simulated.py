"""What was replayed: alternatives in words."""

from __future__ import annotations

from tacauchy_rig.core.simulated import Alternative


def test_long_times_are_whole_numbers() -> None:
    """Two digits below a hundred, none after the point from there on, never 1e+02."""
    slow = Alternative(
        role="better", setting="accurate", error_relative=0.012, time_ratio=3.14159, wall_s=123.4
    )
    text = "preset accurate: about 3.1 times the time (123 s), force error 1.2%"
    assert str(slow) == text
