"""``modes``: what it refuses before any work is done, and its page."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from typer.testing import CliRunner

from sim.scene.scene import Preset
from sim.sensor.sensor import load_sensor
from sim.studies.modes.runs import BALL, PUNCH, ModeCriterion, ModeRun
from sim.studies.modes.signatures import ContactSignature
from tacauchy_rig.app.cli.app import app
from tacauchy_rig.app.cli.studies.modes import modes_page


def test_a_folder_for_the_figures_is_asked_for() -> None:
    """Nothing is pressed without a place for the figures."""
    done = CliRunner().invoke(app, ["study", "modes"])
    assert done.exit_code == 2
    assert "--out" in done.output


def test_only_round_bodies_are_moved() -> None:
    """A plane has no axis to turn about."""
    done = CliRunner().invoke(app, ["study", "modes", "--out", "nowhere", "--indenter", "plane"])
    assert done.exit_code != 0
    assert "only round bodies" in str(done.exception)


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


def test_a_page_says_what_made_it_and_what_was_found() -> None:
    """Command, figures, criteria and signatures; every table row has its cells."""
    page = modes_page(
        [run(MET)], [run(MET, indenter=BALL)], command="tacauchy-rig modes", preset=Preset.FAST
    )
    assert page.splitlines()[2] == "Made by `tacauchy-rig modes`."
    assert "every criterion is met" in page
    assert "(images/contact_modes.png)" in page
    assert "(images/three_sensors.png)" in page
    rows = [line for line in page.splitlines() if line.startswith("| GelSight Mini, slide |")]
    assert [row.count("|") for row in rows] == [12, 12]
    assert "| 2.0000 | 0.9000 | 0.9500 |" in rows[0]


def test_a_page_names_what_was_missed_and_what_was_not_judged() -> None:
    """A number that was never come to is no pass."""
    unjudged = replace(MET, passed=False, judged=False)
    page = modes_page([run(unjudged)], [run(MET)], command="x", preset=Preset.FAST)
    assert "missed: GelSight Mini, cylinder" in page
    assert "**not judged**" in page
    assert not run(unjudged).passed
