"""Runs that nobody touched are never accused, whatever cut them off."""

import json
from pathlib import Path

import pytest

from tacauchy_rig.app.session.record_run_and_weight_check import note_changes
from tacauchy_rig.core.config.load import resumed_config
from tacauchy_rig.core.run import Outcome
from tacauchy_rig.core.store.check.run_and_press_check import check_run
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.recovery import recover_run
from tacauchy_rig.core.store.run_store import RunStore
from tests.recorded_run import new_run, press_run, pressed_run
from tests.studies.tampering.command import missed_names

ONE = 'protocol.force_targets=["1.2 N"]'


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(100, 104))]
)
def test_an_untouched_run_is_not_accused(tmp_path: Path, seed: int) -> None:
    """Each with its own noise and time: all criteria are there and met, nothing is to be noted."""
    model = ("cb3", "e-series")[seed % 2]
    store = new_run(tmp_path, f"emulation.seed={seed}", f'robot.model="{model}"')
    assert press_run(store, seed=seed, start_ns=10**9 * (seed + 1)).outcome is Outcome.PASSED
    check = check_run(store)
    assert list(check.missed()) == []
    assert check.notes == ()
    assert {len(criteria) for criteria in check.attempts.values()} == {18}


def test_a_run_that_was_cut_off_is_recovered_and_not_accused(tmp_path: Path) -> None:
    """Torn recording, no result, no end: what a loss of power in the second trial leaves."""
    store = _cut_off(pressed_run(tmp_path), share=0.6)
    assert missed_names(check_run(store)) == ["journal_end"]
    recovery = recover_run(store)
    assert recovery.is_whole
    assert recovery.was_cut_off
    assert "cut off" in recovery.check.notes[0]
    assert "repacked" in recovery.check.notes[1]
    assert press_run(store, seed=2, start_ns=10**12).outcome is Outcome.PASSED
    check = check_run(store)
    assert list(check.missed()) == []
    assert [record.attempt for record in map(store.accepted, (1, 2)) if record] == [1, 2]


def _cut_off(store: RunStore, *, share: float) -> RunStore:
    paths = store.paths
    recorded = paths.recording(2, 1).read_bytes()
    paths.recording(2, 1).write_bytes(recorded[: int(share * len(recorded))])
    paths.result(2, 1).unlink()
    events = Recording.open(paths.recording(2, 1)).events()
    lines = paths.journal.read_bytes().splitlines(keepends=True)
    stamps = [json.loads(line)["stamp_ns"] for line in lines]
    last = max(index for index, stamp in enumerate(stamps) if stamp == events[-1].stamp_ns)
    paths.journal.write_bytes(b"".join(lines[: last + 1]) + lines[last + 1][:20])
    return store


def test_a_result_that_was_not_sealed_in_time_is_sealed_by_recover(tmp_path: Path) -> None:
    """Power lost between the result and its line: recover writes the line."""
    store = pressed_run(tmp_path)
    lines = store.paths.journal.read_bytes().splitlines(keepends=True)
    last = max(i for i, line in enumerate(lines) if b'"sealed"' in line)
    store.paths.journal.write_bytes(b"".join(lines[:last]))
    assert missed_names(check_run(store)) == ["journal_end"]
    assert recover_run(store).is_whole
    assert list(check_run(store).missed()) == []


def test_a_trial_that_is_pressed_again_leaves_the_first_attempt_out(tmp_path: Path) -> None:
    """What is wrong with an attempt that no longer counts stays told, with its number."""
    store = pressed_run(tmp_path)
    with store.paths.recording(1, 1).open("r+b") as file:
        file.truncate(50_000)
    assert {"recorded_force", "recording_hash"} <= set(missed_names(check_run(store)))
    press_run(store, seed=3, start_ns=10**12, again={1})
    check = check_run(store)
    assert all("trial 1, attempt 1" in line for line in check.missed())
    record = store.accepted(1)
    assert record is not None
    assert record.attempt == 2


@pytest.mark.parametrize(
    ("fault", "outcome"),
    [("camera:repeat-image", Outcome.FAILED), ("camera:freeze-image", Outcome.FAULT)],
)
def test_what_an_attempt_failed_by_is_no_contradiction(
    tmp_path: Path, fault: str, outcome: Outcome
) -> None:
    """Old images fail a press, or stop it in its dwell; a run that is resumed then is whole."""
    store = new_run(tmp_path, "limits.repeat_count=30", ONE, "protocol.attempts=1")
    assert press_run(store, silent_fault=("dwell", fault)).outcome is outcome
    first = store.load_result(1, 1)
    assert first is not None
    assert first.dwell_end_ns is not None
    assert not first.passed
    recovery = recover_run(store)
    assert list(recovery.check.missed()) == []
    assert recovery.is_whole
    assert press_run(store, seed=2, start_ns=10**12).outcome is Outcome.PASSED
    assert list(check_run(store).missed()) == []


def test_an_attempt_may_fail_before_the_arm_is_recorded(tmp_path: Path) -> None:
    """A busy computer ends it in its first turn; the run can be resumed."""
    store = new_run(tmp_path, ONE, "protocol.attempts=1")
    assert press_run(store, silent_fault=("home", "robot:freeze")).outcome is Outcome.FAULT
    assert not len(Recording.open(store.paths.recording(1, 1)).arm.stamp_ns)
    assert list(recover_run(store).check.missed()) == []
    assert press_run(store, seed=2, start_ns=10**12).outcome is Outcome.PASSED


def test_a_failed_result_that_denies_old_images_is_contradicted(tmp_path: Path) -> None:
    """Its criterion made a met one, it says otherwise than its recording."""
    store = new_run(tmp_path, ONE, "protocol.attempts=1")
    press_run(store, silent_fault=("dwell", "camera:repeat-image"))
    path = store.paths.result(1, 1)
    content = json.loads(path.read_text())
    (told,) = (c for c in content["criteria"] if c["name"] == "repeated_frames")
    assert not told["passed"]
    told.update(passed=True, measured=0.0)
    path.write_text(json.dumps(content))
    assert {"recorded_images", "result_hash"} <= set(missed_names(check_run(store)))


@pytest.mark.parametrize(("model", "more_n"), [("e-series", 0.6), ("cb3", 3.0)])
def test_what_the_arm_felt_is_computed_again(tmp_path: Path, model: str, more_n: float) -> None:
    """Of an arm that counts a push as negative; a force that it never felt is found."""
    store = new_run(tmp_path, ONE, f'robot.model="{model}"', "robot.force_sign=-1")
    press_run(store)
    assert list(check_run(store).missed()) == []
    _edit(store.paths.result(1, 1), "arm_force_n", more_n)
    assert missed_names(check_run(store)) == ["result_hash", "recorded_arm_force"]


def test_a_session_may_count_a_push_the_other_way(tmp_path: Path) -> None:
    """What the arm felt is computed again by the sign that was changed for the session."""
    store = pressed_run(tmp_path)
    config, changes = resumed_config(store.description["written"], ["robot.force_sign=-1"])
    note_changes(store, changes)
    press_run(store, config=config, start_ns=10**12, again={1})
    check = check_run(store)
    assert list(check.missed()) == []
    assert any("changed robot.force_sign from 1 to -1" in note for note in check.notes)


def test_an_edited_truth_is_found(tmp_path: Path) -> None:
    """What the emulated world was is sealed as the run's other files are."""
    store = new_run(tmp_path, ONE)
    store.truth.write(b'{"young_pa": 440000.0}\n')
    press_run(store)
    assert list(check_run(store).missed()) == []
    _edit(store.paths.truth, "young_pa", 1e3)
    (line,) = check_run(store).missed()
    assert "run_description" in line
    assert "truth.json has the sha256" in line


def test_what_was_changed_for_a_session_is_noted(tmp_path: Path) -> None:
    """Each field with both values, and which attempts were pressed before."""
    store = pressed_run(tmp_path)
    _, changes = resumed_config(
        store.description["written"], ["limits.stale_image=300 ms", "camera.device=another"]
    )
    note_changes(store, changes)
    press_run(store, seed=2, start_ns=10**12, again={1})
    check = check_run(store)
    assert list(check.missed()) == []
    ending = "for one session, after trial 2, attempt 1."
    assert check.notes == (
        f"`resume --set` changed limits.stale_image from 500 ms to 300 ms {ending}",
        f"`resume --set` changed camera.device from nothing to another {ending}",
    )


def _edit(path: Path, field: str, more: float) -> None:
    content = json.loads(path.read_text())
    content[field] += more
    path.write_text(json.dumps(content))
