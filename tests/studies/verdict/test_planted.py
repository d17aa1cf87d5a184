"""What was planted is judged by the cause that a split ranks first."""

from __future__ import annotations

from reports.scores.residual_split import Cause
from tacauchy_rig.core.simulated import ResidualSplit
from tests.studies.residual.command import Ranked, planted_table


def _ranked(planted: Cause, first: Cause) -> Ranked:
    others = [cause for cause in Cause if cause not in (Cause.REST, first)]
    shares = {Cause.REST.value: 0.5, first.value: 0.4, **{each.value: 0.01 for each in others}}
    split = ResidualSplit(trials=(), shares=shares, found=())
    return Ranked(run="seed 7", cause=planted, planted="some", split=split)


def test_rest_and_noise_are_no_causes_and_a_miss_counts() -> None:
    """Two of three first is most, one of three is not; a run with nothing planted is not judged."""
    right, wrong = _ranked(Cause.TILT, Cause.TILT), _ranked(Cause.FORCE, Cause.MATERIAL)
    assert right.is_first
    assert not wrong.is_first
    nothing = _ranked(Cause.REST, Cause.POSE)
    table = planted_table([nothing, right, right, wrong])
    assert table.passed
    assert table.note == "first in 2 of 3; missed: seed 7, some (material)"
    assert not planted_table([nothing, right, wrong, wrong]).passed
    assert not planted_table([nothing]).passed
