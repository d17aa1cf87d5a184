"""The page of contact modes, of made-up runs."""

from dataclasses import replace
from typing import Any

from sim.scene.scene import Preset
from sim.sensor.sensor import load_sensor
from sim.studies.modes.contact_signature import ContactSignature
from sim.studies.modes.runs import BALL, PUNCH, ModeCriterion, ModeRun
from sim.studies.modes.study import Modes
from tacauchy_rig.core.study import About, Result

SIGNATURE = ContactSignature(
    normal_n=(0.0, 0.0, -2.0),
    normal_sum_n=2.1,
    tangential_n=(0.9, 0.0, 0.0),
    tangential_sum_n=0.95,
    centre_m=(1e-5, 0.0),
    circumferential_share=0.5,
    radial_share=0.6,
    inward_share=0.1,
    radial_share_points=0.55,
)
MET = ModeCriterion(name="cosine", measured=-0.99, limit="< -0.98", passed=True)


def run(criterion: ModeCriterion, **changes: Any) -> ModeRun:
    """Return a run that was never made."""
    nothing: Any = None
    made = ModeRun(
        name="slide",
        sensor=load_sensor("gelsight-mini"),
        indenter=PUNCH,
        travel="2.0 mm along x",
        path=nothing,
        point=nothing,
        signature=SIGNATURE,
        criteria=(criterion,),
        processor_s=12.0,
    )
    return replace(made, **changes)


def page(moved: ModeRun, pressed: ModeRun) -> str:
    """Return the page of a mode and a ball's press."""
    results = [Result(name="slide", found=moved), Result(name="ball on digit", found=pressed)]
    study = Modes("cylinder:diameter=5mm,fillet=0.5mm", Preset.FAST)
    assert study.has_passed(results) is (moved.passed and pressed.passed)
    return study.page(results, About("tacauchy-rig study modes"), [])


def test_a_page_says_what_made_it_and_what_was_found() -> None:
    """Command, figures, criteria and signatures; every table row has its cells."""
    text = page(run(MET), run(MET, indenter=BALL))
    assert text.splitlines()[2] == "Made by `tacauchy-rig study modes`."
    assert "every criterion is met" in text
    assert "(images/contact_modes.png)" in text
    assert "(images/three_sensors.png)" in text
    rows = [line for line in text.splitlines() if line.startswith("| GelSight Mini, slide |")]
    assert [row.count("|") for row in rows] == [12, 12]
    assert "| 2.0000 | 0.9000 | 0.9500 |" in rows[0]


def test_a_page_names_what_was_missed_and_what_was_not_judged() -> None:
    """A number that was never come to is no pass."""
    unjudged = replace(MET, passed=False, judged=False)
    text = page(run(unjudged), run(MET))
    assert "missed: GelSight Mini, cylinder" in text
    assert "**not judged**" in text
    assert not run(unjudged).passed
