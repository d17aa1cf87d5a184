"""Scenes are chosen by a part of their names."""

from __future__ import annotations

import pytest

from sim.studies.bench.scenes import all_scenes, drawn_scenes
from tacauchy_rig.core.errors import ConfigError
from tests.studies.bench_scenes import select_scenes


def test_a_pattern_chooses_scenes() -> None:
    """A part of a name will do; none that fits is an error that names them all."""
    assert select_scenes([]) == select_scenes([""]) == all_scenes()
    several = select_scenes(["twisted", "shallow", "*shallow", "DIGIT*friction"])
    assert list(several) == ["ball, shallow", "punch, twisted", "DIGIT, friction"]
    drawn = select_scenes(["ball"], drawn=5)
    assert list(drawn) == [name for name in drawn_scenes(5) if name.startswith("ball")]
    with pytest.raises(ConfigError, match="no such scene") as refused:
        select_scenes(["ball", "cube"])
    assert "ball, sliding" in str(refused.value)
