"""The paper's numbers are read as they stand, and held to what they can be at all."""

from __future__ import annotations

import pytest

from sim.studies.paper.claims import claims, claims_of
from tacauchy_rig.core.errors import ConfigError

ROW = '[scores.ssim]\nwhere = "IV"\nsays = "SSIM"\nvalue = {}\nrule = "score"\n'


def test_every_claim_says_where_it_stands() -> None:
    """Each has a section, a text and a unique name of its own."""
    found = claims()
    assert len({claim.name for claim in found.values()}) == len(found)
    assert all(claim.where and claim.says for claim in found.values())


@pytest.mark.parametrize("value", ["1.2", "nan", "-2.0"])
def test_an_impossible_score_is_refused_by_name(value: str) -> None:
    """An SSIM lies between -1 and 1."""
    with pytest.raises(ConfigError, match=r"scores\.ssim"):
        claims_of(ROW.format(value))


def test_a_possible_score_is_taken() -> None:
    """What is within the bounds is read with its section."""
    assert claims_of(ROW.format(0.9))["scores.ssim"].value == 0.9
