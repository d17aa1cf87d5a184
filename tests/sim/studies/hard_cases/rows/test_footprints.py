"""Case 16 in its fast form: linear elements, one sharp rim."""

from __future__ import annotations

import pytest

from sim.scene.scene import Effect
from sim.studies.hard_cases.rows.footprints import CASES, INDENTERS, pressed_off

LINEAR = ((Effect.LOCKING_FREE_ELEMENT, False),)


@pytest.mark.slow
def test_sharp_rim_off_the_pad() -> None:
    """Half off and on a corner it balances and rises; beside the pad the message says where."""
    indenters = {"cylinder": INDENTERS["sharp_cylinder"]}
    found = pressed_off(indenters, effects=LINEAR)
    assert found.passed, found.measured
    forces = [float(found.measured[f"cylinder_{p}_force_n"]) for p in ("middle", "edge", "corner")]
    # Half and a quarter of the face touch, on gel that has less around it.
    assert 0.2 < forces[1] / forces[0] < 0.5
    assert 0.05 < forces[2] / forces[0] < 0.25
    assert "beside the pad" in str(found.measured["cylinder_beside"])


def test_row_of_the_table() -> None:
    """One case, with its number and a criterion."""
    assert [case.number for case in CASES] == [16]
    assert "fully off" in CASES[0].criterion
