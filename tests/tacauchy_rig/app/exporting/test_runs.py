"""A run in others' formats: what was recorded, opened by their own readers, and imported again."""

import csv
import json
import logging
import tarfile
from pathlib import Path
from typing import Any

import av
import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from tacauchy_rig.app.exporting.formats import Format, export
from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.app.importing.ros_bag import TYPES
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.image_codec import decode_rgb
from tacauchy_rig.core.run import JournalEvent, Outcome, Tare, TrialRecord
from tacauchy_rig.core.store.check.run_and_press_check import check_run
from tacauchy_rig.core.store.journal import append_event
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.recording.mcap_writer import RecordingWriter
from tacauchy_rig.core.store.run_store import RunStore
from tests.recorded_run import empty_run
from tests.tacauchy_rig.core.store.test_trusted_force import weigh

LOSS = 2.0  # grey levels that the codec takes, on average


def exported(store: RunStore, out: Path, form: Format) -> Path:
    """Return the folder of a run's export."""
    export(store.paths.root, out, form)
    return out


def recording_of(store: RunStore, trial: int) -> Recording:
    """Return the recording of the attempt that counts."""
    record = store.counting(trial)
    assert record is not None
    return store.recording(trial, record.attempt)


@pytest.mark.parametrize(
    ("form", "held_off", "rate_hz"),
    [(Format.CSV, 1e-9, 100), (Format.ROSBAG2, 5e-3, 100), (Format.LEROBOT, 0.03, 25)],
)
def test_it_imports_again(
    ours: RunStore, form: Format, held_off: float, rate_hz: int, tmp_path: Path
) -> None:
    """Every sample that comes back is one that was recorded; windows are told by the CSV alone."""
    store = import_run(exported(ours, tmp_path / "out", form), parent=tmp_path / "runs")
    assert check_run(store).passed, list(check_run(store).missed())
    for trial in (1, 2):
        theirs, own = store.counting(trial), ours.counting(trial)
        assert theirs is not None
        assert own is not None
        assert theirs.force_measured_n == pytest.approx(own.force_measured_n, rel=held_off)
        # Contact is found to a row of the search at 1 mm/s; LeRobot's rows are the camera's.
        near_m = 1e-3 / rate_hz
        assert theirs.depth_measured_m == pytest.approx(own.depth_measured_m, rel=0.0, abs=near_m)
        back, sent = recording_of(store, trial), recording_of(ours, trial)
        zero = 0.0
        if form is Format.LEROBOT:
            assert own.tare_before is not None
            zero = sent.force.between(own.tare_before.start_ns, own.tare_before.end_ns).mean(0)
        known = {row.tobytes() for row in (sent.force.wrench - zero).astype(np.float32)}
        assert all(row.tobytes() in known for row in back.force.wrench.astype(np.float32))


def test_lerobot_is_read_by_others(ours: RunStore, tmp_path: Path) -> None:
    """Parquet and video agree row by row with what was newest in the recording."""
    out = exported(ours, tmp_path / "out", Format.LEROBOT)
    info = json.loads((out / "meta/info.json").read_text())
    rows = pq.read_table(out / "data/chunk-000/file-000.parquet").to_pydict()
    places = pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert len(rows["index"]) == info["total_frames"] == places[-1]["dataset_to_index"]
    with av.open(str(next(out.glob("videos/*/*/*.mp4")))) as video:
        shown = [each.to_ndarray(format="rgb24") for each in video.decode(video=0)]
    assert len(shown) == info["total_frames"]
    recording, record = recording_of(ours, 2), ours.counting(2)
    assert record is not None
    assert record.tare_before is not None
    force, (stamps_ns, _) = recording.force, recording.frame_stamps()
    zero = force.between(record.tare_before.start_ns, record.tare_before.end_ns).mean(axis=0)
    frames = [decode_rgb(frame.jpeg) for frame in recording.frames()]
    start_ns = max(stamps_ns[0], force.stamp_ns[np.shape(rows["observation.wrench_window"])[1] - 1])
    start_ns = max(start_ns, recording.arm.stamp_ns[0])
    for row in range(places[1]["dataset_from_index"], info["total_frames"], 17):
        now_ns = start_ns + round(rows["frame_index"][row] / info["fps"] * 1e9)
        newest = np.flatnonzero(force.stamp_ns <= now_ns)[-1]
        felt, window = rows["observation.wrench"][row], rows["observation.wrench_window"][row]
        assert felt == pytest.approx(force.wrench[newest] - zero, abs=1e-6)
        assert window[-1] == felt
        assert window[0] == pytest.approx(force.wrench[newest + 1 - len(window)] - zero, abs=1e-6)
        image = frames[int(np.flatnonzero(stamps_ns <= now_ns)[-1])]
        assert image is not None
        assert np.abs(shown[row].astype(float) - image).mean() < LOSS


def test_a_bag_is_read_by_ros_and_mcap(ours: RunStore, tmp_path: Path) -> None:
    """Four topics of ROS 2's own types, every message stamped as it was recorded."""
    bag = exported(ours, tmp_path / "out", Format.ROSBAG2) / "recorded"
    sent = [recording_of(ours, trial) for trial in (1, 2)]
    with Reader(bag) as reader:
        kinds = {each.topic: each.msgtype for each in reader.connections}
        joints = [c for c in reader.connections if c.topic == "/tip/joints"]
        raw = [message for _, _, message in reader.messages(joints)]
        images = [c for c in reader.connections if c.topic == "/tactile/image"]
        shown = [(stamp, message) for _, stamp, message in reader.messages(images)]
    assert sorted(kinds.values()) == [
        "geometry_msgs/msg/PoseStamped",
        "geometry_msgs/msg/WrenchStamped",
        "sensor_msgs/msg/CompressedImage",
        "sensor_msgs/msg/JointState",
    ]
    first = TYPES.deserialize_cdr(raw[0], "sensor_msgs/msg/JointState")
    assert first.name[2] == "tip_z_m"
    assert first.position.tolist() == sent[0].arm.pose[0].tolist()
    frame = next(sent[0].frames())
    image = TYPES.deserialize_cdr(shown[0][1], "sensor_msgs/msg/CompressedImage")
    assert (shown[0][0], image.data.tobytes()) == (frame.stamp_ns, frame.jpeg)
    with next(bag.glob("*.mcap")).open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    counts = {
        summary.channels[k].topic: n for k, n in summary.statistics.channel_message_counts.items()
    }
    assert counts["/tip/pose"] == sum(len(each.arm.stamp_ns) for each in sent)
    assert counts["/tactile/image"] == sum(len(each.frame_stamps()[0]) for each in sent)


def test_hdf5_has_robomimic_s_layout_and_units(ours: RunStore, tmp_path: Path) -> None:
    """Observations and actions of one length, and all samples beside them."""
    out = exported(ours, tmp_path / "out", Format.HDF5)
    with h5py.File(out / "presses.hdf5") as file:
        demos = [file[f"data/demo_{k}"] for k in range(2)]
        assert file["data"].attrs["total"] == sum(each.attrs["num_samples"] for each in demos)
        demo, recording = demos[1], recording_of(ours, 2)
        count = demo.attrs["num_samples"]
        assert {len(demo[f"obs/{name}"]) for name in demo["obs"]} == {count, len(demo["actions"])}
        assert demo["obs/wrench"].attrs["unit"] == "N, N, N, N m, N m, N m"
        assert np.array_equal(demo["samples/force"], recording.force.wrench)
        assert np.array_equal(demo["samples/pose"], recording.arm.pose)
        assert np.array_equal(demo["actions"][:-1], demo["obs/state"][1:])
        assert demo.attrs["force_measured_n"] == ours.counting(2).force_measured_n
        assert demo["obs/tactile"].shape == (count, 48, 64, 3)


def test_webdataset_has_a_sample_a_press(ours: RunStore, tmp_path: Path) -> None:
    """The image without contact is there; images are the recorded bytes."""
    out = exported(ours, tmp_path / "out", Format.WEBDATASET)
    with tarfile.open(next(out.glob("*.tar"))) as tar:
        members = {each.name.partition(".")[::2]: tar.extractfile(each) for each in tar}
        content = {name: file.read() for name, file in members.items() if file is not None}
    keys = sorted({key for key, _ in content})
    assert len(keys) == 2
    recorded = [frame.jpeg for frame in recording_of(ours, 2).frames()]
    rest, pressed = (recorded.index(content[keys[1], f"{n}.jpg"]) for n in ("rest", "pressed"))
    assert rest < pressed
    about = json.loads(content[keys[1], "json"])
    assert about["force_measured_n"] == ours.counting(2).force_measured_n


TARE = Tare(
    start_ns=0, end_ns=1, mean=(0.1, 0.2, 0.5, 0.0, 0.0, 0.0), deviation=(0.0,) * 6, sample_count=9
)


@pytest.fixture
def store(tmp_path: Path, samples: Any) -> RunStore:
    """Return a run whose trial 1 was cut off once and passed then."""
    loaded = load_config(overrides=["force_sensor.compression_sign=-1"])
    store = empty_run(tmp_path / "runs", loaded)
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
    store = empty_run(tmp_path)
    with pytest.raises(RecordError, match="holds no recording to export") as caught:
        export(store.paths.root, tmp_path / "out", Format.CSV)
    assert "tacauchy-rig resume" in caught.value.remedy
    assert not list(tmp_path.glob("*out*")), "what fails leaves nothing behind"
