"""The count of what a calibration holds: met where enough intervals hold."""

from __future__ import annotations

from tacauchy_rig.app.calibration.material.fit import Interval
from tests.studies.gel.command import Gel, Judged, gel_table


def _judged(
    *, young: bool = True, left_out: tuple[int, int] = (6, 6), caught: bool = True
) -> Judged:
    closed, opened = (Interval(best=1.0, low=0.5, high=high) for high in (2.0, None))
    return Judged(
        seed=1,
        indenters=("sphere:diameter=6mm",),
        gel=Gel(young_pa=1.0, poisson=0.45, friction=0.5),
        told=(closed, opened, opened),
        held=(young, True, True),
        left_out=left_out,
        accused=False,
        caught={"gram-force": caught},
    )


def test_ninety_two_gels_of_a_hundred_are_enough_and_ninety_one_are_not() -> None:
    """And nineteen of twenty forces left out, and all wrong data."""
    right, wrong = _judged(), _judged(young=False)
    enough = gel_table([right] * 92 + [wrong] * 8)
    assert enough.passed
    assert enough.rows[0][1:4] == ("92, 100, 100", "92 of 100", "0 of 0")
    assert not gel_table([right] * 91 + [wrong] * 9).passed
    assert not gel_table([_judged(left_out=(5, 6))] * 10).passed
    assert not gel_table([right] * 9 + [_judged(caught=False)]).passed
    assert not gel_table([]).passed
