"""What the benchmark says of start-up and of a factor's threads."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import pytest

from sim.press_command import scene_from
from sim.studies.bench import parts
from tacauchy_rig.core.errors import RigError

WASTE = "sum(range(3_000_000)); print(42)"


def test_a_process_is_charged_with_its_own_time() -> None:
    """Time that it computes counts, time that this process computes does not."""
    cpu_s, wall_s, told = parts.process_spent([sys.executable, "-c", WASTE])
    assert told == "42\n"
    assert 0.0 < cpu_s < 10.0 * wall_s


def test_a_command_that_fails_gives_no_number() -> None:
    """Its error is told instead."""
    with pytest.raises(RigError, match="no_such_module"):
        parts.process_spent([sys.executable, "-c", "import no_such_module"])


def test_threads_are_measured_by_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each size has a row for one thread and for two."""
    monkeypatch.setattr(parts, "_BUDGET_S", 0.0)
    scene = scene_from(
        "--pad box:10x10x3mm --young 0.1MPa --poisson 0.48 --indenter plane --depth 0.1mm"
    )
    rows = list(parts.measure_threads(scene, refinements=(0.5,)))
    assert {row["threads"] for row in rows} >= {1, 2}
    assert len({row["unknowns"] for row in rows}) == 1
    assert all(row["factor [ms]"] > 0.0 and row["solution [ms]"] > 0.0 for row in rows)


def test_processor_time_is_told_by_a_clock_of_ticks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Work shorter than the clock's tick is charged with its share of the ticks, not with none."""
    monkeypatch.setattr(parts, "_BUDGET_S", 1.0)
    spent_ms = [0]

    def work() -> None:
        spent_ms[0] += 3

    clock = SimpleNamespace(
        perf_counter=lambda: 1e-3 * spent_ms[0], process_time=lambda: 1e-2 * (spent_ms[0] // 10)
    )
    monkeypatch.setattr(parts, "time", clock)
    wall_s, cpu_s = parts.work_spent(work)
    assert wall_s == pytest.approx(0.003)
    assert cpu_s == pytest.approx(0.003, rel=0.02)
