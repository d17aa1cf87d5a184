"""The paper's numbers: read, judged, and held against each other."""

import tomllib

import pytest

from sim.studies.paper.claims import Verdict, checks, claims, claims_of, verdict
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
        claims_of(tomllib.loads(ROW.format(value)))


def test_a_closed_surface_has_the_faces_that_its_vertices_ask_for() -> None:
    """Euler's formula, which the paper's 712 faces and 358 vertices meet."""
    faces = checks()[0]
    assert faces.agrees
    assert not faces._replace(stated=faces.stated + 1.0).agrees


def test_physics_does_not_fit_in_one_environments_frame() -> None:
    """88.92 ms are more than a frame at 33.40 frames/s, and less than one at 9.25."""
    alone, sixty = checks()[-2:]
    assert not alone.agrees
    assert sixty.agrees


@pytest.mark.parametrize(
    ("rule", "paper", "ours", "expected"),
    [
        ("count", 1920.0, 1900.0, Verdict.REPRODUCED),
        ("count", 1920.0, 1369.0, Verdict.DIFFERENT),
        ("count", 1920.0, 2500.0, Verdict.DIFFERENT),
        ("at most", 5.0, 5.0, Verdict.REPRODUCED),
        ("at most", 5.0, 0.0, Verdict.REPRODUCED),
        ("at most", 5.0, 5.1, Verdict.DIFFERENT),
        ("at least", 555.0, 500.0, Verdict.DIFFERENT),
        ("at least", 555.0, 1600.0, Verdict.REPRODUCED),
        ("at least", 555.0, 1700.0, Verdict.BETTER),
        ("time", 1.0, 1.1, Verdict.DIFFERENT),
        ("time", 1.0, 0.5, Verdict.REPRODUCED),
        ("time", 1.0, 0.2, Verdict.BETTER),
        ("score", 0.93, 0.925, Verdict.REPRODUCED),
        ("score", 0.93, 0.95, Verdict.BETTER),
        ("score", 0.93, 0.91, Verdict.DIFFERENT),
        ("decibel", 22.0, 20.0, Verdict.DIFFERENT),
        ("squares", 400.0, 200.0, Verdict.BETTER),
        ("squares", 400.0, 450.0, Verdict.REPRODUCED),
        ("squares", 400.0, 600.0, Verdict.DIFFERENT),
        ("criteria", 1.0, 1.0, Verdict.REPRODUCED),
        ("criteria", 1.0, 0.75, Verdict.DIFFERENT),
        ("score", 0.93, None, Verdict.NOT_REPRODUCED),
        ("score", 0.93, float("nan"), Verdict.NOT_REPRODUCED),
    ],
)
def test_rule(rule: str, paper: float, ours: float | None, expected: Verdict) -> None:
    """Within the tolerance, beyond it on either side, and without a number of ours."""
    assert verdict(rule, paper, ours) is expected
