"""A run in others' formats: opened by their own readers, and imported again."""

from __future__ import annotations

import json
import tarfile
from pathlib import Path

import av
import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from tacauchy_rig.app.exporting.formats import export
from tacauchy_rig.app.exporting.names import Format
from tacauchy_rig.app.importing.bag import TYPES
from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.core.rgb import decode_rgb
from tacauchy_rig.core.store.check.run import check_run
from tacauchy_rig.core.store.recording.reading import Recording
from tacauchy_rig.core.store.run_store import RunStore

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
    ("form", "held_off"), [(Format.CSV, 1e-9), (Format.ROSBAG2, 5e-3), (Format.LEROBOT, 0.03)]
)
def test_it_imports_again(ours: RunStore, form: Format, held_off: float, tmp_path: Path) -> None:
    """Every sample that comes back is one that was recorded; windows are told by the CSV alone."""
    store = import_run(exported(ours, tmp_path / "out", form), parent=tmp_path / "runs")
    assert check_run(store).passed, list(check_run(store).missed())
    for trial in (1, 2):
        theirs, own = store.counting(trial), ours.counting(trial)
        assert theirs is not None
        assert own is not None
        assert theirs.force_measured_n == pytest.approx(own.force_measured_n, rel=held_off)
        assert theirs.depth_measured_m == pytest.approx(own.depth_measured_m, rel=held_off + 1e-3)
        back, sent = recording_of(store, trial), recording_of(ours, trial)
        zero = 0.0
        if form is Format.LEROBOT:
            assert own.tare_before is not None
            zero = sent.force().between(own.tare_before.start_ns, own.tare_before.end_ns).mean(0)
        known = {row.tobytes() for row in (sent.force().wrench - zero).astype(np.float32)}
        assert all(row.tobytes() in known for row in back.force().wrench.astype(np.float32))


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
    force, (stamps_ns, _) = recording.force(), recording.frame_stamps()
    zero = force.between(record.tare_before.start_ns, record.tare_before.end_ns).mean(axis=0)
    frames = [decode_rgb(frame.jpeg) for frame in recording.frames()]
    start_ns = max(stamps_ns[0], force.stamp_ns[np.shape(rows["observation.wrench_window"])[1] - 1])
    start_ns = max(start_ns, recording.arm().stamp_ns[0])
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
    assert first.position.tolist() == sent[0].arm().pose[0].tolist()
    frame = next(sent[0].frames())
    image = TYPES.deserialize_cdr(shown[0][1], "sensor_msgs/msg/CompressedImage")
    assert (shown[0][0], image.data.tobytes()) == (frame.stamp_ns, frame.jpeg)
    with next(bag.glob("*.mcap")).open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    counts = {
        summary.channels[k].topic: n for k, n in summary.statistics.channel_message_counts.items()
    }
    assert counts["/tip/pose"] == sum(len(each.arm().stamp_ns) for each in sent)
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
        assert np.array_equal(demo["samples/force"], recording.force().wrench)
        assert np.array_equal(demo["samples/pose"], recording.arm().pose)
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
