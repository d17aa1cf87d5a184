"""A run's folder and its journal: what is written comes back, and what is damaged is named."""

import fcntl
import hashlib
import json
import multiprocessing
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tacauchy_rig.core.config.load import default_text, load_config
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.run import JournalEvent, Outcome, TrialRecord
from tacauchy_rig.core.simulated import Replay
from tacauchy_rig.core.store.atomic_write import bytes_sha256
from tacauchy_rig.core.store.check.run_and_press_check import check_run
from tacauchy_rig.core.store.journal import Journal, append_event
from tacauchy_rig.core.store.run_store import ReplayFields, RunStore
from tests.made_model import made_model
from tests.recorded_run import empty_run
from tests.tacauchy_rig.core.store.made_replay import made_trial


def _create(parent: Path, *overrides: str) -> RunStore:
    return empty_run(parent, load_config(overrides=overrides))


@pytest.fixture
def store(tmp_path: Path) -> RunStore:
    """Return a fresh run."""
    return _create(tmp_path / "runs")


def _record(attempt: int, outcome: Outcome, *, trial: int = 1) -> TrialRecord:
    return TrialRecord(index=trial, attempt=attempt, outcome=outcome, force_target_n=1.2556)


REPLAY = Replay(
    name="balanced", trials=(made_trial(1, 1.25),), model=made_model(young_pa=3e5), versions={}
)


def test_a_run_is_opened_as_it_was_created(tmp_path: Path) -> None:
    """Configuration, hash, seed, versions and clock come back from the folder."""
    created = _create(tmp_path, "emulation.seed=11", 'robot.press_speed="0.2 mm/s"')
    opened = RunStore.open(created.paths.root)
    assert opened.config == created.config
    assert opened.config.robot.press_speed == pytest.approx(2e-4)
    assert opened.config_hash == created.config_hash
    assert opened.simulated
    description = opened.description
    assert description["seed"] == 11
    assert description["versions"] == {"tacauchy-rig": "0"}
    assert description["sources"]["robot.press_speed"] == "--set"
    assert description["clock"]["epoch_ns"] > description["clock"]["monotonic_ns"] > 0
    assert created.paths.rig_toml.read_text() == default_text()


def test_names_are_unique(tmp_path: Path) -> None:
    """Runs created within one second get folders of their own."""
    roots = {_create(tmp_path).paths.root for _ in range(3)}
    assert len(roots) == 3
    assert all("-dry-run" in root.name for root in roots)


def test_a_new_field_takes_its_default(store: RunStore) -> None:
    """A run recorded before a field existed still opens, with the hash it was recorded with."""
    description = json.loads(store.paths.run_json.read_text())
    del description["written"]["limits.max_depth"]
    store.paths.run_json.write_text(json.dumps({**description, "config_hash": "old"}))
    opened = RunStore.open(store.paths.root)
    assert opened.config == store.config
    assert opened.config_hash == "old"


def test_attempts_are_counted_and_never_overwritten(store: RunStore) -> None:
    """Each attempt keeps its result; the latest that passed is the one that counts."""
    assert store.next_attempt(1) == 1
    assert store.latest(1) is None
    outcomes = (Outcome.FAULT, Outcome.PASSED, Outcome.FAILED)
    for number, outcome in enumerate(outcomes, start=1):
        assert store.next_attempt(1) == number
        store.save_result(_record(number, outcome))
    store.paths.attempt(1, 10).mkdir()
    assert store.paths.attempt_indices(1) == [1, 2, 3, 10]
    assert store.next_attempt(1) == 11
    assert store.load_result(1, 10) is None
    assert store.accepted(1) == _record(2, Outcome.PASSED)
    assert store.latest(1) == _record(3, Outcome.FAILED)
    assert store.accepted(2) is None
    store.save_result(_record(2, Outcome.PASSED))
    with pytest.raises(RecordError, match="attempt 2 at trial 1 has ended already: passed"):
        store.save_result(_record(2, Outcome.FAILED))
    assert store.accepted(1) == _record(2, Outcome.PASSED)


def test_a_damaged_result_is_named(store: RunStore) -> None:
    """A result that was edited is refused with file and field, and does not count."""
    store.save_result(_record(1, Outcome.PASSED))
    store.save_result(_record(2, Outcome.PASSED))
    path = store.paths.result(1, 2)
    path.write_text(path.read_text().replace('"passed"', '"good"'))
    with pytest.raises(RecordError, match=r"result\.json: outcome: 'good': Input should be"):
        store.load_result(1, 2)
    assert store.counting(1) == _record(1, Outcome.PASSED)
    assert store.next_attempt(1) == 3


def test_a_replay_comes_back(store: RunStore) -> None:
    """Numbers, arrays and the image survive, the image to the last bit."""
    rng = np.random.default_rng(3)
    fields = ReplayFields(
        fields={"displacement": rng.normal(size=(5, 3)), "triangles": np.arange(6)},
        height={"height_m": rng.normal(size=(4, 4))},
        image=rng.integers(0, 255, size=(24, 32, 3), dtype=np.uint8),
        surface_vtu=b"<VTKFile/>",
        passed={"force_n": np.arange(3.0)},
    )
    store.save_replay(REPLAY, {1: fields})
    opened = RunStore.open(store.paths.root)
    assert opened.replays() == ["balanced"]
    loaded = opened.load_replay("balanced")
    assert replace(loaded, made_from={}, files={}) == REPLAY
    names = ("fields.npz", "height.npz", "image.png", "passed.npz", "surface.vtu")
    assert sorted(loaded.files) == [f"trials/01/{name}" for name in names]
    back = opened.load_replay_fields("balanced", 1)
    for kept, found in ((fields.fields, back.fields), (fields.height, back.height)):
        assert list(kept) == list(found)
        assert all(np.array_equal(kept[name], found[name]) for name in kept)
    assert np.array_equal(back.image, fields.image)
    assert back.surface_vtu == b"<VTKFile/>"
    assert np.array_equal(back.passed["force_n"], fields.passed["force_n"])


def test_a_replay_that_is_not_there(store: RunStore) -> None:
    """A missing replay is named beside those that exist, a missing trial by its folder."""
    with pytest.raises(RecordError, match="no finished replay 'fine'; it has: none") as caught:
        store.load_replay("fine")
    assert "tacauchy-rig replay" in caught.value.remedy
    store.save_replay(REPLAY, {})
    with pytest.raises(RecordError, match="this trial was not replayed"):
        store.load_replay_fields("balanced", 1)


def test_a_sensor_file_that_changed_after_the_replay_is_named(tmp_path: Path) -> None:
    """A report crops and scales images as this file says, so its images are others than before."""
    (sensor := tmp_path / "own.toml").write_text("crop = 0.15")
    store = _create(tmp_path, f'sensor.name="{sensor}"')
    store.save_replay(REPLAY, {})
    before = set(check_run(store).missed())
    sensor.write_text("crop = 0.1")
    (told,) = set(check_run(store).missed()) - before
    assert f"sensor {sensor} has the sha256" in told


@pytest.mark.parametrize("name", ["fields.npz", "image.png"])
def test_a_damaged_replay_is_named(store: RunStore, name: str) -> None:
    """A file that does not decode is named with what to do."""
    fields = ReplayFields(fields={"a": np.ones(9)}, image=np.ones((8, 8, 3), dtype=np.uint8))
    store.save_replay(REPLAY, {1: fields})
    path = store.paths.replay_trial("balanced", 1) / name
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 3])
    with pytest.raises(RecordError, match=name) as caught:
        store.load_replay_fields("balanced", 1)
    assert "replay the run again" in caught.value.remedy


def test_truth_is_there_in_dry_runs_only(store: RunStore) -> None:
    """A real run has no truth; a damaged one is named."""
    assert store.truth.load() is None
    store.paths.truth.write_text('{"young_pa": 300000.0}')
    assert store.truth.load() == {"young_pa": 3e5}
    store.paths.truth.write_text("[1]")
    with pytest.raises(RecordError, match=r"truth\.json: the whole of it: \[1\]: Input should be"):
        store.truth.load()


def test_a_folder_that_is_no_run(tmp_path: Path) -> None:
    """Any other folder, or none, is refused with an example of what is wanted."""
    for root in (tmp_path, tmp_path / "absent"):
        with pytest.raises(RecordError, match=r"not a run folder: it has no run\.json") as caught:
            RunStore.open(root)
        assert "runs/" in caught.value.remedy


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"written": 3}, "run.json: written: 3: Input should be an object"),
        ({"format": 2}, "run.json: written in format 2; this program reads 1"),
        ({"config_hash": None}, "run.json: config_hash: None: Input should be a valid string"),
        ({"written": {"robot.host": 3}}, "run.json: written: robot.host: 3 is not text"),
    ],
)
def test_a_damaged_description(store: RunStore, change: dict[str, Any], message: str) -> None:
    """A description that was edited is refused with the field."""
    description = json.loads(store.paths.run_json.read_text())
    store.paths.run_json.write_text(json.dumps({**description, **change}))
    with pytest.raises((RecordError, ConfigError)) as caught:
        RunStore.open(store.paths.root)
    assert message in caught.value.message


@pytest.mark.parametrize("depths_m", [(0.0, 1e-3), (0.0, 1e-3, 900.0)])
def test_a_curve_that_no_press_has(store: RunStore, depths_m: tuple[float, ...]) -> None:
    """Nothing is computed of one: its file and field are named."""
    store.save_result(replace(_record(1, Outcome.PASSED), press_force_n=(0.0, 1.0, 2.0)))
    path = store.paths.result(1, 1)
    text = path.read_text().replace('"press_depth_m": []', f'"press_depth_m": {list(depths_m)}')
    path.write_text(text)
    with pytest.raises(RecordError, match=r"result\.json: press_depth_m: \d depths, to"):
        store.load_result(1, 1)


def test_one_program_at_a_time(store: RunStore) -> None:
    """A second program is told which process works on the run; the lock dies with its holder."""
    code = (
        "import sys, time; from pathlib import Path; "
        "from tacauchy_rig.core.store.atomic_write import run_lock; "
        "lock = run_lock(Path(sys.argv[1])); "
        "lock.__enter__(); print('locked', flush=True); time.sleep(60)"
    )
    command = [sys.executable, "-c", code, str(store.paths.lock)]
    root = str(Path(__file__).parents[4])
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=root) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"locked\n"
        with pytest.raises(RecordError, match=f"process {process.pid} is working"), store.lock():
            pass
        process.kill()
    with store.lock(), pytest.raises(RecordError, match="is working on this run"), store.lock():
        pass


def test_a_result_is_sealed_in_the_journal_once(store: RunStore) -> None:
    """Its own hash and its recording's stand there, whoever writes it again."""
    record = TrialRecord(
        index=1, attempt=1, outcome=Outcome.PASSED, force_target_n=2.0, recording_sha256="ab"
    )
    store.save_result(record)
    store.save_result(replace(record, recording_sha256=None))
    (sealed,) = Journal.read(store.paths.journal).events
    content = store.paths.result(1, 1).read_bytes()
    assert (sealed.name, sealed.trial, sealed.attempt) == ("sealed", 1, 1)
    assert sealed.detail == {
        "result_sha256": hashlib.sha256(content).hexdigest(),
        "recording_sha256": "ab",
    }


def test_the_description_is_sealed_with_its_devices(store: RunStore) -> None:
    """Whoever answered is in run.json, and in the journal by its hash."""
    identity = {"driver": "ur5", "serial": "2019300001", "simulated": False}
    store.set_devices({"robot": identity})
    assert RunStore.open(store.paths.root).description["devices"] == {"robot": identity}
    (written,) = Journal.read(store.paths.journal).events
    content = store.paths.run_json.read_bytes()
    assert written.detail == {"file": "run.json", "sha256": hashlib.sha256(content).hexdigest()}


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=5,
)


def _event(number: int) -> JournalEvent:
    return JournalEvent(stamp_ns=number, name="phase", trial=1, attempt=1, detail={"n": number})


@given(name=st.text(), detail=st.dictionaries(st.text(), JSON), stamp=st.integers(0, 2**62))
def test_any_event_comes_back(
    tmp_path_factory: pytest.TempPathFactory, name: str, detail: dict[str, object], stamp: int
) -> None:
    """Names and details of any text, newlines included, survive; infinities become text."""
    path = tmp_path_factory.mktemp("journal") / "journal.jsonl"
    event = JournalEvent(stamp_ns=stamp, name=name, detail=detail)
    append_event(path, event)
    append_event(path, _event(1))
    first, second = Journal.read(path).events
    assert second == _event(1)
    assert (first.stamp_ns, first.name, len(first.detail)) == (stamp, name, len(detail))
    assert path.read_bytes().count(b"\n") == 2


@pytest.mark.parametrize("cut", [1, 2, 20, 60])
def test_half_a_line_is_passed_over_and_the_next_is_whole(tmp_path: Path, cut: int) -> None:
    """A crash in the middle of a line costs that line only, also after the run was resumed."""
    path = tmp_path / "journal.jsonl"
    for number in range(3):
        append_event(path, _event(number))
    path.write_bytes(path.read_bytes()[:-cut])
    kept = Journal.read(path).events
    assert kept == [_event(number) for number in range(3 if cut == 1 else 2)]
    append_event(path, _event(3))
    assert Journal.read(path).events == [*kept, _event(3)]


def test_empty_lines_that_a_power_cut_left_are_not_counted(tmp_path: Path) -> None:
    """Stale bytes may hold line breaks; the lines after them are numbered as they are read."""
    path = tmp_path / "journal.jsonl"
    append_event(path, _event(0))
    path.write_bytes(path.read_bytes() + b"\xff\n\n\xfe")
    append_event(path, _event(1))
    assert [line.number for line in Journal.read(path).lines] == [1, None, None, 4]


def _append_many(path: Path, first: int) -> None:
    for number in range(first, first + 50):
        append_event(path, _event(number))


def test_lines_of_several_processes_do_not_mix(tmp_path: Path) -> None:
    """Two processes that append at once lose and mix nothing."""
    path = tmp_path / "journal.jsonl"
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=_append_many, args=(path, n)) for n in (0, 1000)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    stamps = [event.stamp_ns for event in Journal.read(path).events]
    assert sorted(stamps) == [*range(50), *range(1000, 1050)]
    assert [stamp for stamp in stamps if stamp < 1000] == list(range(50))


def test_a_full_disk_is_said() -> None:
    """The device that is always full gives the message of a full disk."""
    with pytest.raises(RecordError, match="/dev/full: no space left to write") as caught:
        append_event(Path("/dev/full"), _event(0))
    assert "free some space" in caught.value.remedy


def test_a_line_that_is_no_event(tmp_path: Path) -> None:
    """A whole line that is something else is named with its number and field."""
    path = tmp_path / "journal.jsonl"
    append_event(path, _event(0))
    with path.open("a") as file:
        file.write('{"stamp_ns": 1, "nome": "phase"}\n')
    with pytest.raises(RecordError, match=r"journal\.jsonl line 2: nome: unknown field"):
        Journal.read(path)


def test_each_line_is_numbered_and_holds_the_hash_of_the_one_before(tmp_path: Path) -> None:
    """The chain goes through half a line that a crash left, too."""
    path = tmp_path / "journal.jsonl"
    for number in range(3):
        append_event(path, _event(number))
    path.write_bytes(path.read_bytes()[:-20])
    append_event(path, _event(3))
    lines = Journal.read(path).lines
    assert [line.number for line in lines] == [1, 2, None, 4]
    hashes = [bytes_sha256(line.raw) for line in lines]
    assert [line.previous for line in lines] == ["", hashes[0], None, hashes[2]]


def test_a_journal_that_another_process_holds_is_said(tmp_path: Path) -> None:
    """A writer that never lets go holds nobody up for long."""
    path = tmp_path / "journal.jsonl"
    append_event(path, _event(0))
    with path.open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(RecordError, match=r"another process has held it for 1 s"):
            append_event(path, _event(1))
    append_event(path, _event(1))
    assert len(Journal.read(path).events) == 2
