"""A gap between images costs an attempt; whatever force or arm did ends the run."""

from dataclasses import replace

import pytest

from protocols.guard.breach_reaction import BreachError, Reaction
from protocols.trials import trial_sequence
from protocols.trials import trial_sequence as trials
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import Outcome


def gap(lab, *, phase: str, duration_s: float) -> None:
    """Let the camera fall silent in ``phase`` for a while."""
    lab.when_phase(phase, lambda: lab.world.begin("camera:stall"), delay_s=0.3)
    lab.when_phase(phase, lambda: lab.world.end("camera:stall"), delay_s=0.3 + duration_s)


@pytest.mark.parametrize("phase", ["reference", "search", "press", "dwell", "retract"])
def test_a_gap_between_images_is_tried_again(laboratory, phase):
    """The arm is made safe, goes home, and the second attempt passes."""
    more = phase == "press"  # one of them goes on to a second trial
    lab = laboratory(f"""protocol.force_targets=["2 N"{', "3 N"' * more}]""")
    gap(lab, phase=phase, duration_s=0.6)
    result = lab.run()
    assert result.outcome is Outcome.PASSED, result.reason
    assert lab.sink.begun == [(1, 1), (1, 2), *[(2, 1)] * more]
    assert [r.outcome for r in lab.sink.records] == [Outcome.FAULT, *[Outcome.PASSED] * (1 + more)]
    assert lab.sink.records[0].reason.startswith("limits.stale_image")
    (told,) = [event for event in lab.sink.events if event.name == "attempt-repeated"]
    assert (told.trial, told.attempt) == (0, 0)  # in no recording
    assert (told.detail["of_trial"], told.detail["of_attempt"]) == (1, 1)


@pytest.mark.parametrize("phase", ["preflight", "air-press"])
def test_a_gap_before_the_trials_is_tried_again(laboratory, phase):
    """The step is done anew, and no attempt at a trial is lost by it."""
    lab = laboratory('protocol.force_targets=["2 N"]')
    gap(lab, phase=phase, duration_s=0.6)
    result = lab.run()
    assert result.outcome is Outcome.PASSED, result.reason
    assert lab.sink.begun == [(1, 1)]
    assert lab.phases.count(phase) == 2
    (told,) = [event for event in lab.sink.events if event.name == "attempt-repeated"]
    assert told.detail["of_phase"] == phase


def test_an_air_press_is_not_repeated_for_ever_nor_for_another_cause(laboratory):
    """One attempt is one; an arm that stands still is for a person to see."""
    lab = laboratory("protocol.attempts=1")
    gap(lab, phase="air-press", duration_s=0.6)
    result = lab.run()
    assert result.outcome is Outcome.FAULT
    assert "during air-press" in result.reason
    assert "end other programs" in result.remedy
    lab = laboratory()
    lab.when_phase("air-press", lambda: lab.world.begin("robot:stall"))
    result = lab.run()
    assert result.outcome is Outcome.FAULT
    assert lab.phases.count("air-press") == 1


def test_attempts_are_not_endless(laboratory):
    """With every attempt cut off the run ends as it did before."""
    lab = laboratory('protocol.force_targets=["2 N"]', "protocol.attempts=2")

    def due() -> bool:
        presses = [e for e in lab.sink.events if e.detail.get("phase") == "press"]
        return bool(presses) and lab.world.now_ns > presses[-1].stamp_ns + 3e8

    def fall_silent() -> None:
        lab.world.begin("camera:stall")
        until_ns = lab.world.now_ns + 6e8
        lab.world.when(lambda: lab.world.now_ns > until_ns, lambda: lab.world.end("camera:stall"))
        lab.world.when(lambda: len(lab.sink.begun) == 2 and due(), fall_silent)

    lab.world.when(due, fall_silent)
    result = lab.run()
    assert result.outcome is Outcome.FAULT
    assert lab.sink.begun == [(1, 1), (1, 2)]
    assert result.reason.startswith("limits.stale_image")
    assert "end other programs" in result.remedy


@pytest.mark.parametrize(
    ("name", "ends_s"),
    [
        ("camera:stall", 30.0),  # ten seconds without images are no gap
        ("force_sensor:stall", 0.6),  # also where the device is well again at once
        ("force_sensor:freeze", 0.6),
        ("robot:stall", 0.6),
    ],
)
def test_a_long_silence_and_whatever_force_or_arm_did_end_the_run(laboratory, name, ends_s):
    """Only images that come late are tried again."""
    lab = laboratory('protocol.force_targets=["2 N"]')
    lab.when_phase("press", lambda: lab.world.begin(name), delay_s=0.3)
    lab.when_phase("press", lambda: lab.world.end(name), delay_s=0.3 + ends_s)
    assert lab.run().outcome is Outcome.FAULT
    assert lab.sink.begun == [(1, 1)]


def test_a_cell_that_fails_in_the_gap_is_not_waited_out(laboratory):
    """While images are waited for, every other limit holds."""
    lab = laboratory('protocol.force_targets=["2 N"]')
    gap(lab, phase="press", duration_s=6.0)
    lab.when_phase("fault", lambda: lab.world.begin("force_sensor:stall"), delay_s=1.0)
    assert lab.run().outcome is Outcome.FAULT
    assert lab.sink.begun == [(1, 1)]


def test_an_abort_while_waiting_is_heeded(laboratory):
    """A person who asks to stop is not answered by another press."""
    lab = laboratory('protocol.force_targets=["2 N"]')
    gap(lab, phase="press", duration_s=6.0)
    lab.when_phase("fault", lambda: lab.abort.request("Ctrl-C"), delay_s=1.0)
    result = lab.run()
    assert result.outcome is Outcome.ABORTED
    assert "while waiting for images. The arm stands clear of the gel." in result.reason
    assert lab.sink.begun == [(1, 1)]


def test_an_arm_in_the_gel_does_not_go_on(laboratory):
    """One that was told to hold waits for a person, whatever the cause."""
    lab = laboratory('protocol.force_targets=["2 N"]')
    lab.run()
    late = BreachError(
        "late", limit=trial_sequence.LATE_IMAGE, reaction=Reaction.RETRACT, remedy=""
    )
    assert trial_sequence.may_repeat(lab.cycle, late)
    low = lab.world.pose.shifted(z=0.1995 - lab.world.pose.position[2])
    lab.cycle.last_state = replace(lab.cycle.last_state, pose=low)
    assert not trial_sequence.may_repeat(lab.cycle, late)


def test_a_broken_device_says_how_the_run_goes_on():
    """Unless the force sensor is in doubt, or the remedy says it itself."""
    cable = DeviceError("gone", remedy="check the cable")
    assert trials._remedy(cable, doubted=False) == f"check the cable; {trials._RESUME}"
    assert trials._remedy(cable, doubted=True) == "check the cable"
    assert trials._remedy(DeviceError("", remedy="`resume`"), doubted=False) == "`resume`"
