"""The judgement of a tolerance's promise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest

from sim.error import Tolerance, keeping, keeping_corrected
from sim.scene.indenter import describe
from sim.scene.scene import Preset
from sim.studies.accuracy.tolerance import (
    CHOICE,
    COLUMNS,
    COST,
    HELD_OUT,
    SEEN_BEFORE,
    HeldOut,
    check_tolerance,
    corrected_at,
    judged_depth,
    pressed,
    tolerance_table,
)
from tacauchy_rig.core.tables import Table

_KEPT = dict.fromkeys(COLUMNS) | {"kept": "yes", COST: 1.0, CHOICE: 0.0}


def test_the_scenes_are_held_out_and_each_gets_a_preset() -> None:
    """Two times ten, of indenters that the other ten have not."""
    one, other = (
        {describe(press.scene.indenter) for press in each} for each in (HELD_OUT, SEEN_BEFORE)
    )
    assert not one & other
    loose = [each for each in HELD_OUT if each.tolerance.relative == 0.06]
    for each in loose:
        assert keeping(each.scene, each.tolerance).preset is not Preset.PAPER


def test_a_scene_is_named_by_what_is_pressed_into_what() -> None:
    """A sensor's own pad is not named; a target is a depth or a force."""
    assert HELD_OUT[0].name == "4.4 mm punch, 0.18 mm fillet, nu 0.455, 0.33 mm deep"
    assert HELD_OUT[6].name == "8.2 mm ball, disc 4.8 mm, nu 0.445, to 0.4 N"
    assert len({each.name for each in (*HELD_OUT, *SEEN_BEFORE)}) == 20


def test_what_is_judged_is_corrected() -> None:
    """Where a tolerance chose two meshes; on one the force is the mesh's own."""
    scene = keeping_corrected(HELD_OUT[0].scene, Tolerance(relative=0.05))
    depth = judged_depth(scene)
    known = corrected_at(scene, depth)
    assert known is not None
    assert pressed(scene, depth)[0] == pytest.approx(known.force_n, rel=1e-9)
    raw, _ = pressed(replace(scene, path_refinement=None), depth)
    assert raw == pytest.approx((1.0 + known.bias_relative) * known.force_n, rel=3e-3)


def test_a_refusal_is_a_row_that_was_not_kept() -> None:
    """What no preset promises is shown with its reason, and counts as missed."""
    strict = HeldOut(SEEN_BEFORE[0].scene, Tolerance(relative=1e-6))
    refused = check_tolerance(strict)
    assert refused["kept"] == "no"
    assert "comes nearest" in refused["refusal"]
    assert _table([refused]).rows[0][4] == "refused"
    assert not _table([refused]).passed


def test_nine_of_ten_kept_and_all_thrifty_is_a_pass() -> None:
    """An error above the tolerance may happen once; a price above twice the cheapest may not."""
    broken, dear = _KEPT | {"kept": "no"}, _KEPT | {COST: 2.5}
    assert _table([_KEPT] * 9 + [broken]).passed
    assert not _table([_KEPT] * 8 + [broken] * 2).passed
    assert not _table([_KEPT] * 9 + [dear]).passed


def test_the_choices_own_time_counts() -> None:
    """What was cheap once chosen is dear where choosing it took long; the note has both."""
    slow = _KEPT | {COST: 2.4, CHOICE: 0.9}
    found = _table([_KEPT] * 9 + [slow])
    assert not found.passed
    assert "on 9, the choice's own time included; on 10 without it" in found.note


def _table(found: Sequence[dict[str, Any]]) -> Table:
    return tolerance_table(found, title="t")
