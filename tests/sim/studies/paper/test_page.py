"""The page of the paper's claims, of made-up measurements."""

from typing import Any
from unittest.mock import patch

from sim.studies.paper.claims import Verdict, claims
from sim.studies.paper.presses import ACCURATE
from sim.studies.paper.study import Ours, Paper, compared, model_ours
from tacauchy_rig.core.study import About, Result
from tests.sim.studies.paper.made_up import model, presses, report, speeds


def page(measured: dict[str, Ours], *, emulated: bool = False, ours: bool = False) -> str:
    """Return the page of some measurements, and one report."""
    study = Paper.__new__(Paper)
    study.speeds, study.reports = speeds(), [report(emulated=emulated, ours=ours)]
    found: dict[str, Any] = {**presses(), ACCURATE: model("reference")}
    found |= {"its mesh's table": {"mesh.tets": 1369}, "its law at rest": 1e5}
    found["contact modes"] = {}
    results = [Result(name=name, found=each) for name, each in found.items()]
    with patch.object(Paper, "comparison", return_value=compared(measured)):
        return study.page(results, About("x"), [])


def test_every_claim_is_a_row_with_its_verdict_and_reason() -> None:
    """With nothing measured, and with everything far off, each has a reason beside it."""
    nothing = page({})
    far = page({name: Ours(1e6, "made up") for name in claims()})
    for text in (nothing, far):
        rows = text.splitlines()
        for claim in claims().values():
            (row,) = [line for line in rows if line.startswith(f"| {claim.says} | {claim.where} |")]
            *_, verdict, why = row.removesuffix(" |").split(" | ")
            assert verdict.strip("*") in set(Verdict)
            assert why.strip()
    assert "**not reproduced**" in nothing
    assert "made up" in far


def test_a_changed_measurement_changes_the_page() -> None:
    """The force of the paper's model is a number of the page, not of the template."""
    texts = [
        page(model_ours(presses(paper_force_n=force), model("r"), rest_stress_pa=1e5))
        for force in (6.0, 4.5)
    ]
    assert "| 100 % | **different** |" in texts[0]
    assert "| 50 % | **different** |" in texts[1]


def test_the_floor_is_said_of_real_sensors_alone() -> None:
    """An emulated no-contact frame beats nothing."""
    said = "no contact at all reaches or exceeds"
    assert said in page({}, emulated=False)
    assert said not in page({}, emulated=True)
    assert "a sensor, **emulated**" in page({}, emulated=True, ours=True)
