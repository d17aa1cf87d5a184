"""Export: what another tool gets is what was recorded."""

from __future__ import annotations

import csv
import logging
from pathlib import Path
from typing import Any

import pytest

from tacauchy_rig.app.exporting.formats import export
from tacauchy_rig.app.exporting.names import Format
from tacauchy_rig.core.config.load import default_text, load_config
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import JournalEvent, Outcome, Tare, TrialRecord
from tacauchy_rig.core.store.journal import append_event
from tacauchy_rig.core.store.recording.writing import RecordingWriter
from tacauchy_rig.core.store.run_store import RunStore
from tests.tacauchy_rig.core.store.test_force_series import weigh

TARE = Tare(
    start_ns=0, end_ns=1, mean=(0.1, 0.2, 0.5, 0.0, 0.0, 0.0), deviation=(0.0,) * 6, sample_count=9
)


@pytest.fixture
def store(tmp_path: Path, samples: Any) -> RunStore:
    """Return a run whose trial 1 was cut off once and passed then."""
    loaded = load_config(overrides=["force_sensor.compression_sign=-1"])
    store = RunStore.create(
        tmp_path / "runs", loaded, config_text=default_text(), simulated=True, versions={}
    )
    for attempt in (1, 2):
        with RecordingWriter(store.paths.recording(1, attempt), metadata={}) as writer:
            samples.write(writer, 5)
    store.save_result(
        TrialRecord(
            index=1,
            attempt=2,
            outcome=Outcome.PASSED,
            force_target_n=1.2556,
            force_measured_n=1.25,
            tare_before=TARE,
        )
    )
    return store


def test_an_attempt_that_is_doubted_is_not_accepted(store: RunStore, tmp_path: Path) -> None:
    """It passed, and a weight showed afterwards that its forces are wrong."""
    start = JournalEvent(stamp_ns=1, name="attempt-start", trial=1, attempt=2)
    append_event(store.paths.journal, start)
    for scale, accepted in ((1.0, "1"), (0.8, "0")):
        weigh(store, scale)
        export(store.paths.root, tmp_path / accepted, Format.CSV)
        assert _table(tmp_path / accepted / "trials.csv")[1]["accepted"] == accepted


def _table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_csv_holds_raw_and_tared_force(store: RunStore, tmp_path: Path, samples: Any) -> None:
    """Every sample is there, raw to the last bit, tared, and signed as a pressing force."""
    export(store.paths.root, tmp_path / "out", Format.CSV)
    rows = _table(tmp_path / "out" / "trial-01-attempt-2" / "force.csv")
    assert len(rows) == 20
    for index, row in enumerate(rows):
        sample = samples.force(index)
        assert int(row["stamp_ns"]) == sample.stamp_ns
        assert int(row["counter"]) == index
        assert float(row["time_s"]) == pytest.approx(index * 0.01, abs=1e-12)
        assert float(row["fz_n"]) == sample.wrench[2]
        assert float(row["fx_n_tared"]) == pytest.approx(0.0, abs=1e-12)
        assert float(row["pressing_force_n"]) == pytest.approx(0.5 - sample.wrench[2])
    arm = _table(tmp_path / "out" / "trial-01-attempt-2" / "arm.csv")
    assert float(arm[3]["z_m"]) == samples.arm(3).pose.position[2]
    assert arm[3]["robot_mode"] == "7"
    assert float(arm[4]["tcp_fz_n"]) == samples.arm(4).tcp_force[2]
    assert arm[3]["tcp_fz_n"] == "", "this state came without one"


def test_what_is_not_known_stays_empty(store: RunStore, tmp_path: Path) -> None:
    """An attempt without a result has raw force and no tared one, and is not accepted."""
    export(store.paths.root, tmp_path / "out", Format.CSV)
    row = _table(tmp_path / "out" / "trial-01-attempt-1" / "force.csv")[3]
    assert row["fz_n"] != ""
    assert (row["fz_n_tared"], row["pressing_force_n"]) == ("", "")
    trials = _table(tmp_path / "out" / "trials.csv")
    assert [(row["attempt"], row["accepted"], row["outcome"]) for row in trials] == [
        ("1", "0", ""),
        ("2", "1", "passed"),
    ]
    assert trials[1]["force_measured_n"] == "1.25"


def test_images_are_the_recorded_bytes(store: RunStore, tmp_path: Path, samples: Any) -> None:
    """Each frame is a file of its own, untouched, listed with its stamps."""
    export(store.paths.root, tmp_path / "out", Format.CSV)
    folder = tmp_path / "out" / "trial-01-attempt-2"
    rows = _table(folder / "frames.csv")
    assert len(rows) == 5
    for index, row in enumerate(rows):
        frame = samples.frame(index)
        assert (folder / row["file"]).read_bytes() == frame.jpeg
        assert int(row["stamp_ns"]) == frame.stamp_ns
        assert row["device_stamp_s"] == ("" if index % 2 else str(frame.device_stamp_s))


def test_a_torn_recording_is_exported_with_a_warning(
    store: RunStore, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """What is readable is exported, and the log says that it is not all."""
    path = store.paths.recording(1, 1)
    path.write_bytes(path.read_bytes()[:-9_000])
    with caplog.at_level(logging.WARNING):
        export(store.paths.root, tmp_path / "out", Format.CSV)
    assert "unfinished" in caplog.text
    assert _table(tmp_path / "out" / "trial-01-attempt-1" / "force.csv")


def test_nothing_is_overwritten(store: RunStore, tmp_path: Path) -> None:
    """A second export to the same folder is refused."""
    export(store.paths.root, tmp_path / "out", Format.CSV)
    with pytest.raises(RecordError, match="out: exists already") as caught:
        export(store.paths.root, tmp_path / "out", Format.CSV)
    assert "new folder" in caught.value.remedy


def test_a_run_without_recordings(tmp_path: Path) -> None:
    """A run that never pressed has nothing to export, and the remedy is to press."""
    store = RunStore.create(
        tmp_path, load_config(), config_text=default_text(), simulated=True, versions={}
    )
    with pytest.raises(RecordError, match="holds no recording to export") as caught:
        export(store.paths.root, tmp_path / "out", Format.CSV)
    assert "tacauchy-rig resume" in caught.value.remedy
    assert not list(tmp_path.glob("*out*")), "what fails leaves nothing behind"
