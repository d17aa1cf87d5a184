"""Tables of studies on made-up rows: what meets a criterion, and what misses it."""

from types import SimpleNamespace
from typing import Any

import pytest

from reports.scores.residual_causes import Cause
from tacauchy_rig.core.simulated import ResidualSplit
from tests.studies.acceptance.command import truth_table
from tests.studies.gel.command import gel_table
from tests.studies.mounting.command import FOUND, SMOOTH, UPRIGHT, Residuals, residual_table
from tests.studies.page.command import Pairs, rate_table, reaction_table
from tests.studies.residual.command import Ranked, planted_table
from tests.studies.twin_bench.command import keeps_up, row_of, twin_table


@pytest.mark.parametrize(
    ("margin", "young_pa", "passes"),
    [(0.1, 3.0e5, True), (-0.02, 3.0e5, True), (-0.1, 3.0e5, False), (0.1, 2.5e5, False)],
)
def test_a_clear_defeat_or_a_wrong_modulus_misses(
    margin: float, young_pa: float, passes: bool
) -> None:
    """A defeat within three spreads is noise."""
    written: Any = SimpleNamespace(truth=SimpleNamespace(young_pa=3.0e5))
    model = {"young_pa": young_pa, "modulus_factor": 1.0, "modulus_factor_deviation": 0.03}
    trials = [{"force_margin": {"value": margin, "spread": 0.01}}]
    summary = {"model": model, "trials": trials, "headline": []}
    assert truth_table(written, summary, command="").passed is passes


def _gel(*, young: bool = True, off: float = 1.0, caught: bool = True) -> dict[str, Any]:
    return {
        "told": [(0.5, 1.0, 2.0), (None, 0.45, None), (None, 0.5, None)],
        "held": [young, True, True],
        "closed": [True, False, False],
        "law": [-0.01, 0.02],
        "left_out": [0.0] * 5 + [off],
        "written": [0.0],
        "accused": [],
        "caught": {"gram-force": caught},
    }


def test_ninety_two_gels_of_a_hundred_are_enough_and_ninety_one_are_not() -> None:
    """And nineteen of twenty forces left out, and all wrong data."""
    tools, right, wrong = ("sphere:diameter=6mm",), _gel(), _gel(young=False)
    enough = gel_table({tools: [right] * 92 + [wrong] * 8})
    assert enough.passed
    assert enough.rows[0][1:6] == ("92 of 100; 1.5", "-", "-", "-1.0% to +2.0%", "600 of 600")
    assert not gel_table({tools: [right] * 91 + [wrong] * 9}).passed
    assert not gel_table({tools: [_gel(off=-2.0)] * 10}).passed
    assert not gel_table({tools: [right] * 9 + [_gel(caught=False)]}).passed


@pytest.mark.parametrize(("more_ms", "passed"), [(1.9, True), (-1.9, True), (2.1, False)])
def test_the_guard_has_to_be_as_quick(more_ms: float, passed: bool) -> None:
    """Within two milliseconds."""
    pairs = Pairs((5.0 + more_ms,) * 2, (5.0,) * 2)
    assert reaction_table(pairs, "with", "without").passed is passed


@pytest.mark.parametrize(
    ("change", "passed"),
    [
        ({}, True),
        ({"lost force": 1}, False),
        ({"lost images": 1}, False),
        ({"force [Hz]": 98.0}, False),
    ],
)
def test_nothing_may_be_lost(change: dict[str, float], passed: bool) -> None:
    """Not one sample, at the rates that were asked."""
    rates = {"force [Hz]": 100.02, "lost force": 0, "images [Hz]": 18.74, "lost images": 0}
    assert rate_table([rates, rates | change]).passed is passed


@pytest.mark.parametrize(
    ("left", "passed"),
    [
        ([(0.1, 0.2)] * 6, True),
        ([(0.3, 0.2)] + [(0.1, 0.2)] * 5, True),
        ([(0.3, 0.2)] * 2 + [(0.1, 0.2)] * 4, False),
        ([(None, 0.2)], False),
        ([(0.1, None)], False),
        ([], False),
    ],
)
def test_five_presses_of_six_have_to_be_better(
    left: list[tuple[float | None, float | None]], passed: bool
) -> None:
    """One may come out the other way by noise, two not, and none without its value."""
    trials = [
        Residuals(trial=k, force_n=1.0, left={FOUND: found, UPRIGHT: 0.2, SMOOTH: smooth})
        for k, (found, smooth) in enumerate(left)
    ]
    assert residual_table(trials).passed is passed


def _ranked(planted: Cause, first: Cause) -> Ranked:
    others = [cause for cause in Cause if cause not in (Cause.REST, first)]
    shares = {Cause.REST.value: 0.5, first.value: 0.4, **{each.value: 0.01 for each in others}}
    split = ResidualSplit(trials=(), shares=shares, found=())
    return Ranked(run="seed 7", cause=planted, planted="some", split=split)


def test_rest_and_noise_are_no_causes_and_a_miss_counts() -> None:
    """Two of three first is most, one of three is not; a run with nothing planted is not judged."""
    right, wrong = _ranked(Cause.TILT, Cause.TILT), _ranked(Cause.FORCE, Cause.MATERIAL)
    nothing = _ranked(Cause.REST, Cause.POSE)
    table = planted_table([nothing, right, right, wrong])
    assert table.passed
    assert table.note == "first in 2 of 3; missed: seed 7, some (material)"
    assert not planted_table([nothing, right, wrong, wrong]).passed
    assert not planted_table([nothing]).passed


def test_a_twin_that_is_slow_late_or_lossy_does_not_keep_up() -> None:
    """Each alone misses the criterion, and so does a twin that was never ready."""
    line = {"force_n": 1.0, "force_error_n": 0.1, "lag_ms": 50.0, "processor_ms": 20.0, "note": ""}
    lines = [line | {"stamp_ns": round(k / 16 * 1e9)} for k in range(9)]
    good = row_of("ball", lines, [], busy=0.5)
    assert twin_table([good], rate_wanted_hz=10.0).passed
    for change in ({"frames/s": 9.0}, {"lag, median [ms]": 250.0}, {"lost images": 1}):
        assert not twin_table([good, good | change], rate_wanted_hz=10.0).passed
    assert not keeps_up(row_of("ball", [], [], busy=0.5), 10.0)
