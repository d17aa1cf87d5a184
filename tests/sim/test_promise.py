"""The judgement of a tolerance's promise."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.accuracy.force_limit import extrapolated
from sim.accuracy.preset_errors import training
from sim.accuracy.promise import Settled, section, settle
from sim.accuracy.promise_scenes import HELD_OUT, Promise
from sim.indenter import describe
from sim.scene import Preset
from sim.settings import FAST, Setting
from sim.tolerance import Tolerance, keeping

_KEPT = Settled(
    promise=HELD_OUT[0],
    allowed=0.02,
    setting=Setting(Preset.BALANCED),
    force_n=1.0,
    depth_m=1e-4,
    believed=0.018,
    true_error=0.01,
    doubt=0.001,
    cheapest=Setting(Preset.BALANCED),
    cost_ratio=1.0,
)


@given(limit=st.floats(0.1, 10.0), constant=st.floats(-0.1, 0.1), order=st.sampled_from([1, 2]))
def test_an_error_of_known_order_is_extrapolated_away(
    limit: float, constant: float, order: int
) -> None:
    """F(h) = limit (1 + c h^p) on h and 1.5 h gives the limit exactly; half the way is doubted."""
    fine, coarse = (limit * (1.0 + constant * h**order) for h in (1.0, 1.5))
    found = extrapolated(fine, coarse, share=1.0 / (1.5**order - 1.0))
    assert found.force_n == pytest.approx(limit, rel=1e-9)
    assert found.error(fine) == pytest.approx(constant, abs=1e-9)
    assert found.doubt == pytest.approx(0.5 * abs(constant), abs=1e-9)


def test_the_scenes_are_held_out_and_each_gets_a_preset() -> None:
    """Ten, of indenters that the table does not have."""
    known = {describe(press.scene.indenter) for press in training()}
    assert len(HELD_OUT) == 10
    assert not known & {describe(each.scene.indenter) for each in HELD_OUT}
    for each in HELD_OUT:
        assert keeping(each.scene, each.tolerance).preset is not Preset.PAPER


def test_a_refusal_is_a_row_that_was_not_kept() -> None:
    """What no preset promises is shown with its reason, and counts as missed."""
    strict = Promise(name="strict", scene=HELD_OUT[0].scene, tolerance=Tolerance(relative=1e-6))
    refused = settle(strict)
    assert not refused.is_kept
    assert "comes nearest" in refused.refusal
    assert section([refused], command="c").rows[0][4] == "refused"


def test_nine_of_ten_kept_and_all_thrifty_is_a_pass() -> None:
    """An error above the tolerance may happen once; a price above twice the cheapest may not."""
    broken = Settled(**{**_as_dict(_KEPT), "true_error": -0.021})
    dear = Settled(**{**_as_dict(_KEPT), "cheapest": FAST, "cost_ratio": 2.5})
    assert section([_KEPT] * 9 + [broken], command="c").passed
    assert not section([_KEPT] * 8 + [broken] * 2, command="c").passed
    assert not section([_KEPT] * 9 + [dear], command="c").passed


def _as_dict(settled: Settled) -> dict[str, Any]:
    return {name: getattr(settled, name) for name in settled.__dataclass_fields__}
