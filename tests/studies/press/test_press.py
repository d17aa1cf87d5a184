"""Emulated sensors that aged, and that did not."""

import pytest

from tests.studies.press.command import judged


@pytest.mark.parametrize("aged", [False, True])
def test_one_sensor_is_judged_rightly(aged):
    """The page has ten of each."""
    assert judged(3, aged=aged).is_right
