"""What a twin's lines say of how it kept up."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from tests.studies.twin_bench.command import row_of, twin_table


def _line(stamp_s: float, *, force_n: float = 1.0, lag_ms: float = 50.0) -> dict[str, Any]:
    return {
        "stamp_ns": round(stamp_s * 1e9),
        "force_n": force_n,
        "force_error_n": 0.1 * force_n,
        "lag_ms": lag_ms,
        "solve_ms": 10.0,
        "draw_ms": 5.0,
        "processor_ms": 20.0,
        "note": "",
    }


def test_what_is_slow_late_or_lossy_does_not_keep_up() -> None:
    """Each alone misses the criterion, and so does a twin that was never ready."""
    good = row_of("ball", [_line(k / 16) for k in range(9)], [], busy=0.5)
    assert twin_table([good], rate_wanted_hz=10.0).passed
    for change in ({"rate_hz": 9.0}, {"lag_median_ms": 250.0}, {"lost_images": 1}):
        assert not twin_table([good, replace(good, **change)], rate_wanted_hz=10.0).passed
    assert not row_of("ball", [], [], busy=0.5).keeps_up(10.0)
