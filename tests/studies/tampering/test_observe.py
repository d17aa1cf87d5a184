"""Every way to tamper with a run is noticed, by name, or said to be beyond noticing."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from tacauchy_rig.core.store.check.run_and_press_check import check_run
from tacauchy_rig.core.store.run_store import RunStore
from tests.recorded_run import new_run, press_run
from tests.studies.tampering.cases import TamperCase, all_cases
from tests.studies.tampering.command import missed_names
from tests.studies.tampering.copy import Care, RunCopy

RECORDED = tuple(case for case in all_cases() if not case.name.startswith("replay"))
BEYOND_NOTICE = {"run.json: a device's serial number edited", "truth.json: a softer gel"}
"""What contradicts nothing once every hash is right again."""
SEEN = {
    "recording: F_z ten times as large": "recorded_force",
    "recording: sign of F_z flipped": "recorded_sign",
    "recording: arm 1 mm off": "recorded_depth",
    "recording: one frozen image": "recorded_images",
    "recording: every tenth force sample twice": "recorded_streams",
    "recording: events deleted": "recorded_events",
    "recording: exchanged with another trial's": "recording_place",
    "recording: another trial's, with this one's metadata": "recorded_force",
    "result: forces halved": "recorded_force",
    "result: another zero": "recorded_tare",
    "result: drift made none": "recorded_drift",
    "result: the arm's own force 3 N larger": "recorded_arm_force",
    "result: another target": "recorded_result",
    "journal: a line deleted": "recorded_events",
    "journal: two lines exchanged": "recorded_events",
    "journal: force at an attempt's end edited": "recorded_result",
    "run.json: sign of the cell flipped": "recorded_sign",
}
"""What is named from the content alone, after every hash was made right again."""


Missed = Callable[[TamperCase, Care], set[str]]
"""Returns the criteria that a copy misses after it was tampered with."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two presses that nobody touched."""
    store = new_run(tmp_path_factory.mktemp("runs"))
    store.truth.write(b'{"young_pa": 440000.0}\n')
    press_run(store)
    assert check_run(store).passed
    return store.paths.root


@pytest.fixture(scope="module")
def missed(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Missed:
    """Try each case once."""

    @cache
    def tampered(case: TamperCase, care: Care) -> set[str]:
        copy = RunCopy.of(run, tmp_path_factory.mktemp("tampered") / "runs", care)
        case.change(copy)
        if care is Care.RESEALED:
            copy.reseal()
        return set(missed_names(check_run(RunStore.open(copy.root))))

    return tampered


@pytest.mark.parametrize("name", SEEN)
def test_the_content_contradicts_what_was_resealed(missed: Missed, name: str) -> None:
    """Right hashes do not help against raw samples, counters and events."""
    case = next(case for case in RECORDED if case.name == name)
    assert SEEN[name] in missed(case, Care.RESEALED)


@pytest.mark.timeout(900)
def test_nothing_goes_unnoticed(missed: Missed) -> None:
    """Every case and care, but what is said to be beyond notice."""
    unseen = {
        (case.name, care) for case in RECORDED for care in case.cares if not missed(case, care)
    }
    assert unseen == {(name, Care.RESEALED) for name in BEYOND_NOTICE}
