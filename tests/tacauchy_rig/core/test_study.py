"""Some of many, by the shell patterns of ``--only``."""

from __future__ import annotations

import pytest

from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.study import selected

TREES = ("ash", "elm", "oak", "holm oak")


def chosen(*patterns: str) -> tuple[str, ...]:
    """Trees by name, or by its first letter."""
    return selected(TREES, patterns, names=lambda tree: (tree, tree[0]), kind="tree")


def test_patterns_choose_in_the_items_order() -> None:
    """Any name will do, what two patterns name is there once, and no pattern is all."""
    assert chosen("*oak", "a", "ash") == ("ash", "oak", "holm oak")
    assert chosen() == TREES


def test_a_pattern_that_matches_nothing_is_refused() -> None:
    """A misspelt one is not left out, not even beside one that matches; what there is is told."""
    with pytest.raises(ConfigError, match="--only 'oka': no such tree") as refused:
        chosen("ash", "oka")
    assert "choose among ash; elm; oak; holm oak" in refused.value.remedy
