"""The judgement of a tolerance's promise."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.error.settings import FAST, Setting
from sim.error.tolerance import Tolerance, keeping
from sim.scene.indenter import describe
from sim.scene.scene import Preset
from sim.studies.accuracy.force_limit import extrapolated
from sim.studies.accuracy.press_store import PressStore
from sim.studies.accuracy.promise import Settled, section, settle
from sim.studies.accuracy.promise_scenes import FRESH, JUDGED_BEFORE, Promise
from sim.studies.accuracy.training_scenes import TRAINING

_KEPT = Settled(
    promise=JUDGED_BEFORE[0],
    allowed=0.02,
    setting=Setting(Preset.BALANCED),
    force_n=1.0,
    depth_m=1e-4,
    believed=0.018,
    true_error=0.01,
    doubt=0.001,
    cheapest=Setting(Preset.BALANCED),
    cost_ratio=1.0,
    choice_ratio=0.0,
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
    """Four times ten, of indenters that neither the table nor the other tens have."""
    sets = [
        {describe(press.scene.indenter) for press in TRAINING},
        *(
            {describe(each.scene.indenter) for each in ten}
            for ten in (FRESH, JUDGED_BEFORE[:10], JUDGED_BEFORE[10:20], JUDGED_BEFORE[20:])
        ),
    ]
    assert (len(FRESH), len(JUDGED_BEFORE)) == (10, 30)
    assert not any(one & other for one, other in combinations(sets, 2))
    loose = [each for each in FRESH if each.tolerance.relative == 0.06]
    for each in loose:
        assert keeping(each.scene, each.tolerance).preset is not Preset.PAPER


def test_a_refusal_is_a_row_that_was_not_kept(tmp_path: Path) -> None:
    """What no preset promises is shown with its reason, and counts as missed."""
    strict = Promise(
        name="strict", scene=JUDGED_BEFORE[0].scene, tolerance=Tolerance(relative=1e-6)
    )
    refused = settle(strict, PressStore(folder=tmp_path))
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


def test_the_choices_own_time_counts() -> None:
    """What was cheap once chosen is dear where choosing it took long; the note has both."""
    slow = Settled(**{**_as_dict(_KEPT), "cost_ratio": 2.4, "choice_ratio": 0.9})
    found = section([_KEPT] * 9 + [slow], command="c")
    assert not found.passed
    assert "on 9, the choice's own time included; on 10 without it" in found.note


def _as_dict(settled: Settled) -> dict[str, Any]:
    return {name: getattr(settled, name) for name in settled.__dataclass_fields__}
