"""The count of what a calibration holds: met only where enough gels and left-out presses are."""

from __future__ import annotations

from tests.studies.gel.command import Fitted, gel_table


def _fitted(*, young: bool = True, left_out: tuple[int, int] = (5, 5)) -> Fitted:
    return Fitted(
        indenters=("sphere:diameter=6mm",),
        held=(young, True, True),
        told=(True, False, False),
        uncertainty=0.08,
        left_out=left_out,
    )


def test_eight_gels_of_ten_are_enough_and_seven_are_not() -> None:
    """And nine of ten presses left out."""
    right, wrong = _fitted(), _fitted(young=False)
    enough = gel_table([right] * 8 + [wrong] * 2)
    assert enough.passed
    ((_, held, told, doubt, out),) = enough.rows
    assert (held, told, out) == ("8, 10, 10 of 10", "0, 0", "50 of 50")
    assert doubt == 8.0
    assert not gel_table([right] * 7 + [wrong] * 3).passed
    assert gel_table([right] * 9 + [_fitted(left_out=(0, 5))]).passed
    assert not gel_table([_fitted(left_out=(4, 5))] * 10).passed
    assert not gel_table([]).passed
