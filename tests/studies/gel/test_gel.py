"""The count of what a calibration holds: met where enough intervals hold."""

from __future__ import annotations

from typing import Any

from tests.studies.gel.command import gel_table

TOOLS = ("sphere:diameter=6mm",)


def _judged(*, young: bool = True, off: float = 1.0, caught: bool = True) -> dict[str, Any]:
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
    right, wrong = _judged(), _judged(young=False)
    enough = gel_table({TOOLS: [right] * 92 + [wrong] * 8})
    assert enough.passed
    assert enough.rows[0][1:6] == ("92 of 100; 1.5", "-", "-", "-1.0% to +2.0%", "600 of 600")
    assert not gel_table({TOOLS: [right] * 91 + [wrong] * 9}).passed
    assert not gel_table({TOOLS: [_judged(off=-2.0)] * 10}).passed
    assert not gel_table({TOOLS: [right] * 9 + [_judged(caught=False)]}).passed
