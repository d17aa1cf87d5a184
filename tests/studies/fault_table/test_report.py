"""What must not be is called by its name, in the table and in its first line."""

from dataclasses import replace

import pytest

from tacauchy_rig.core.config.load import load_config
from tests.studies.fault_table.cases import all_cases
from tests.studies.fault_table.command import fault_page, summary_line
from tests.studies.fault_table.observation import ArmOutcome, CommandEnd, KeptMessages, Observation

ARM = ArmOutcome(
    speed_before_m_s=0.0003,
    stopped_after_s=0.335,
    descended_m=1e-4,
    lowered_after_m=0.0,
    raised_after_m=0.002,
    rest_ns=1,
    at_rest=True,
    end_z_m=0.2,
)
KEPT = KeptMessages(
    acknowledged={"control": 100, "camera": 10},
    readable={"control": 101, "camera": 10},
    force_gap_count=0,
    frame_gap_count=0,
)
GOOD = Observation(
    name="robot:drop@press",
    tries=1,
    arm=ARM,
    force_at_fault_n=1.0,
    force_rise_n=0.25,
    exit_code=2,
    ended_after_s=2.0,
    hung=(),
    told="error: robot: the connection | broke\n  -> check the network",
    measured={},
    kept=KEPT,
    kept_after_resume=KEPT,
    resumed=(CommandEnd(exit_code=0, told=""),),
)
LOST = replace(KEPT, readable={"control": 98, "camera": 10})
MOVING = replace(ARM, at_rest=False, stopped_after_s=None)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"arm": MOVING}, "the arm still moves"),
        ({"arm": replace(ARM, stopped_after_s=None)}, "never stood still"),
        ({"arm": replace(ARM, lowered_after_m=3e-5)}, "went down again by 0.030 mm"),
        ({"hung": ("control",)}, "had to be ended: control"),
        ({"kept": LOST}, "2 acknowledged messages cannot be read"),
        ({"kept_after_resume": LOST}, "cannot be read after resume"),
        ({"kept": replace(KEPT, force_gap_count=4)}, "4 samples are missing"),
        ({"told": ""}, "told nothing"),
        ({"resumed": ()}, "resume did not finish"),
        ({"resumed": (CommandEnd(exit_code=2, told="error: x"),)}, "resume did not finish"),
        ({"exit_code": -11}, "exit status -11"),
        ({"force_rise_n": 2.6}, "the gel felt 3.60 N; at most 3.50 N is allowed"),
        ({"name": "robot:wrong-pose@press", "exit_code": 0}, "the run passed"),
    ],
)
def test_what_must_not_be_is_a_problem(changes, problem):
    """Each is found, and marked in the table."""
    seen = replace(GOOD, **changes)
    assert any(problem in text for text in seen.problems)
    assert f"**{seen.problems[0]}**" in table(seen)
    assert summary_line([seen]).endswith("or too much force: 1.")


def test_a_fault_that_is_handled_has_no_problem():
    """Stopped, told, kept, resumed."""
    assert GOOD.problems == ()
    row = next(line for line in table(GOOD).splitlines() if line.startswith("| press"))
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells == [
        "press",
        "stood still after 335 ms, 0.100 mm further down, then went up 2.00 mm",
        "+0.25 N (from 1.00 N)",
        "110 / 111, none lost",
        "robot: the connection / broke",
        "2",
        "finished",
    ]


def test_a_loss_on_the_wire_is_no_loss_of_ours():
    """Frames that an emulated cable swallowed were never there to be kept."""
    gappy = replace(KEPT, force_gap_count=40)
    dropped = replace(
        GOOD, name="force_sensor:drop@press", kept=gappy, kept_after_resume=replace(gappy)
    )
    assert dropped.problems == ()


def test_every_fault_is_explained():
    """Whatever an emulator can break, and every process, has a line that says what happens."""
    text = table(*(replace(GOOD, name=case.name) for case in all_cases()))
    for cause in {case.cause_name for case in all_cases()}:
        assert f"**{cause}**: " in text


def table(*seen):
    """Return the document of observations."""
    return fault_page(
        seen,
        command="python -m tests.studies fault-table",
        config=load_config().config,
        case_count=72,
    )
