"""What a twin's lines say of how it kept up."""

from __future__ import annotations

from typing import Any

from tests.studies.twin_bench.command import keeps_up, row_of, twin_table


def _line(stamp_s: float, *, force_n: float = 1.0, lag_ms: float = 50.0) -> dict[str, Any]:
    return {
        "stamp_ns": round(stamp_s * 1e9),
        "force_n": force_n,
        "force_error_n": 0.1 * force_n,
        "lag_ms": lag_ms,
        "processor_ms": 20.0,
        "note": "",
    }


def test_what_is_slow_late_or_lossy_does_not_keep_up() -> None:
    """Each alone misses the criterion, and so does a twin that was never ready."""
    good = row_of("ball", [_line(k / 16) for k in range(9)], [], busy=0.5)
    assert twin_table([good], rate_wanted_hz=10.0).passed
    for change in ({"frames/s": 9.0}, {"lag, median [ms]": 250.0}, {"lost images": 1}):
        assert not twin_table([good, good | change], rate_wanted_hz=10.0).passed
    assert not keeps_up(row_of("ball", [], [], busy=0.5), 10.0)
