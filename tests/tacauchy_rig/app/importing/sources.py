"""Sources of every kind, made of presses that are known."""

import csv
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from scipy.spatial.transform import Rotation

from tacauchy_rig.app.importing.ros_bag import POSE, TYPES, WRENCH
from tacauchy_rig.core.run import TrialRecord
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.run_store import RunStore

CSV_SPEC = """
kind = "csv"
name = "from-csv"
[data]
contact_force = "0.05 N"
[data.columns]
image = "image"
press = "press"
state = "state"
time = { column = "time", unit = "s" }
force_x = { column = "fx", unit = "N" }
force_y = { column = "fy", unit = "N" }
force = { column = "fz", unit = "N" }
moment_x = { column = "mx", unit = "N m" }
moment_y = { column = "my", unit = "N m" }
moment_z = { column = "mz", unit = "N m" }
depth = { column = "depth", unit = "mm" }
[rig.sensor]
name = "gelsight-mini"
[rig.replay]
indenter = "cylinder:diameter=5mm,fillet=0.1mm"
"""
_HEAD = ("press", "state", "time", "image", "fx", "fy", "fz", "mx", "my", "mz", "depth")


def counting(store: RunStore) -> list[TrialRecord]:
    """Return the results of a run's trials."""
    found = [store.counting(index) for index in store.trial_indices()]
    return [record for record in found if record is not None]


def write_csv(store: RunStore, folder: Path, *, spec: str = CSV_SPEC) -> Path:
    """Write images and a CSV of the windows that count, and how to import them."""
    folder.mkdir(parents=True)
    rows: list[dict[str, object]] = []
    for record in counting(store):
        recording = Recording.open(store.paths.recording(record.index, record.attempt))
        tare = record.tare_before
        assert tare is not None
        force = recording.force
        for state, start, end in (
            ("unloaded", tare.start_ns, tare.end_ns),
            ("pressed", record.dwell_start_ns or 0, record.dwell_end_ns or 0),
        ):
            held = (force.stamp_ns >= start) & (force.stamp_ns <= end)
            for stamp, wrench in zip(force.stamp_ns[held], force.wrench[held], strict=True):
                row = dict(zip(_HEAD[4:10], (repr(float(v)) for v in wrench), strict=True))
                rows.append(
                    {"press": record.index, "state": state, "time": f"{stamp / 1e9:.9f}", **row}
                )
        depth = record.depth_measured_m
        for state, start, end in (
            ("unloaded", record.reference_start_ns, record.reference_end_ns),
            ("pressed", record.dwell_start_ns, record.dwell_end_ns),
        ):
            for frame in recording.frames(start, end):
                name = f"{record.index:02d}-{frame.counter}.jpg"
                (folder / name).write_bytes(frame.jpeg)
                row = {"press": record.index, "state": state, "image": name}
                row["time"] = f"{frame.stamp_ns / 1e9:.9f}"
                if state == "pressed" and depth is not None:
                    row["depth"] = repr(depth * 1e3)
                rows.append(row)
    with (folder / "presses.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, _HEAD, restval="")
        writer.writeheader()
        writer.writerows(rows)
    (folder / "import.toml").write_text(spec, encoding="utf-8")
    return folder


BAG_SPEC = """
kind = "bag"
name = "from-bag"
[data]
file = "recorded"
[rig.sensor]
name = "gelsight-mini"
[rig.replay]
indenter = "cylinder:diameter=5mm,fillet=0.1mm"
"""
IMAGE = "sensor_msgs/msg/CompressedImage"


def write_bag(
    store: RunStore,
    folder: Path,
    *,
    spec: str = BAG_SPEC,
    storage: StoragePlugin = StoragePlugin.MCAP,
    changed: Callable[[str, int, Any], Any] = lambda _name, _stamp_ns, message: message,
) -> Path:
    """Write all of a run as a ROS 2 bag by two publishers a topic, and how to import it."""
    folder.mkdir(parents=True)
    kinds = {"/gel/image": IMAGE, "/cell/wrench": WRENCH, "/tip/pose": POSE}
    with Writer(folder / "recorded", version=9, storage_plugin=storage) as writer:
        topics = {
            (name, depth): writer.add_connection(
                name, kind, typestore=TYPES, offered_qos_profiles=[_qos(depth)]
            )
            for name, kind in kinds.items()
            for depth in (1, 10)
        }
        for name, stamp_ns, message in sorted(_messages(store), key=lambda each: each[1]):
            raw = TYPES.serialize_cdr(changed(name, stamp_ns, message), kinds[name])
            writer.write(topics[name, 10 if stamp_ns % 2 else 1], stamp_ns, raw)
    (folder / "import.toml").write_text(spec, encoding="utf-8")
    return folder


def _qos(depth: int) -> Qos:
    """Return how a publisher offers a topic: with a queue of so many messages."""
    unlimited = QosTime(sec=2147483647, nsec=4294967295)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=depth,
        reliability=QosReliability.BEST_EFFORT,
        durability=QosDurability.VOLATILE,
        deadline=unlimited,
        lifespan=unlimited,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=unlimited,
        avoid_ros_namespace_conventions=False,
    )


def _messages(store: RunStore) -> Iterator[tuple[str, int, Any]]:
    kinds = TYPES.types
    vector, point = kinds["geometry_msgs/msg/Vector3"], kinds["geometry_msgs/msg/Point"]
    for record in counting(store):
        recording = Recording.open(store.paths.recording(record.index, record.attempt))
        force, arm = recording.force, recording.arm
        for stamp, wrench in zip(force.stamp_ns.tolist(), force.wrench.tolist(), strict=True):
            felt = kinds["geometry_msgs/msg/Wrench"](
                force=vector(*wrench[:3]), torque=vector(*wrench[3:])
            )
            yield "/cell/wrench", stamp, kinds[WRENCH](header=header(stamp), wrench=felt)
        for stamp, pose in zip(arm.stamp_ns.tolist(), arm.pose.tolist(), strict=True):
            turned = Rotation.from_rotvec(pose[3:]).as_quat().tolist()
            place = kinds["geometry_msgs/msg/Pose"](
                position=point(*pose[:3]),
                orientation=kinds["geometry_msgs/msg/Quaternion"](*turned),
            )
            yield "/tip/pose", stamp, kinds[POSE](header=header(stamp), pose=place)
        for frame in recording.frames():
            data = np.frombuffer(frame.jpeg, np.uint8)
            image = kinds[IMAGE](header=header(frame.stamp_ns), format="jpeg", data=data)
            yield "/gel/image", frame.stamp_ns, image


def header(stamp_ns: int) -> Any:
    """Return the header of a message with a stamp."""
    sec, nanosec = divmod(stamp_ns, 10**9)
    stamp = TYPES.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    return TYPES.types["std_msgs/msg/Header"](stamp=stamp, frame_id="")


VIDEO_SPEC = """
kind = "video"
name = "from-video"
[data]
video = "gel.avi"
complete = true
log = "force.csv"
[data.columns]
time = { column = "t", unit = "s" }
force_x = { column = "fx", unit = "N" }
force_y = { column = "fy", unit = "N" }
force = { column = "fz", unit = "N" }
moment_x = { column = "mx", unit = "N m" }
moment_y = { column = "my", unit = "N m" }
moment_z = { column = "mz", unit = "N m" }
x = { column = "x", unit = "m" }
y = { column = "y", unit = "m" }
z = { column = "z", unit = "m" }
[rig.sensor]
name = "gelsight-mini"
[rig.replay]
indenter = "cylinder:diameter=5mm,fillet=0.1mm"
"""
VIDEO_HZ = 25.0


def write_video(store: RunStore, folder: Path, *, later_s: float, spec: str = VIDEO_SPEC) -> Path:
    """Write a run as a video without loss and a force log, which begins so much later."""
    folder.mkdir(parents=True)
    stamps: list[int] = []
    frames: list[bytes] = []
    rows: list[tuple[float, ...]] = []
    for record in counting(store):
        recording = Recording.open(store.paths.recording(record.index, record.attempt))
        force, arm = recording.force, recording.arm
        pose = [np.interp(force.stamp_ns, arm.stamp_ns, arm.pose[:, axis]) for axis in range(3)]
        rows += zip(force.stamp_ns / 1e9, *force.wrench.T, *pose, strict=True)
        for frame in recording.frames():
            stamps.append(frame.stamp_ns)
            frames.append(frame.jpeg)
    begin_s = stamps[0] / 1e9
    grid = begin_s + np.arange(0.0, (stamps[-1] - stamps[0]) / 1e9, 1.0 / VIDEO_HZ)
    shown = np.clip(np.searchsorted(np.array(stamps) / 1e9, grid, side="right") - 1, 0, None)
    first = cv2.imdecode(np.frombuffer(frames[0], np.uint8), cv2.IMREAD_COLOR)
    code = cv2.VideoWriter.fourcc(*"FFV1")
    video = cv2.VideoWriter(str(folder / "gel.avi"), code, VIDEO_HZ, first.shape[1::-1])
    assert video.isOpened()
    for number in shown.tolist():
        video.write(cv2.imdecode(np.frombuffer(frames[number], np.uint8), cv2.IMREAD_COLOR))
    video.release()
    log_begins_s = begin_s + later_s
    with (folder / "force.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("t", *_HEAD[4:10], "x", "y", "z"))
        for row in sorted({row[0]: row for row in rows}.values()):  # trials share some samples
            if row[0] >= log_begins_s:
                writer.writerow(repr(float(v)) for v in (row[0] - log_begins_s, *row[1:]))
    (folder / "import.toml").write_text(spec, encoding="utf-8")
    return folder


HZ = 50
REST_S, HELD_S = 2.0, 1.0
LEROBOT_SPEC = """
kind = "lerobot"
[data]
force = { feature = "observation.wrench", unit = "N" }
pose = { feature = "observation.state", unit = "mm" }
[rig.sensor]
name = "gelsight-mini"
[rig.replay]
indenter = "sphere:diameter=4mm"
"""
RECORDS_SPEC = """
kind = "records"
[data]
records = "feats"
colour_order = "BGR"
no_contact = "rest.npy"
is_tared = true
still = ["dx", "dy", "deg"]
[data.indenters]
sphere_10 = "sphere:diameter=10mm"
cylinder_5 = "cylinder:diameter=5mm,fillet=0.1mm"
[data.columns]
image = "image"
force = { column = "fz", unit = "N" }
depth = { column = "dz", unit = "mm" }
x = { column = "x0", unit = "mm" }
y = { column = "y0", unit = "mm" }
[rig.sensor]
name = "gelsight-mini"
"""
BLUE, RED = 20, 120  # of an image as OpenCV has it: blue first


def record(**changed: Any) -> dict[str, Any]:
    """Return a record as FEATS documents it: place, way, turn, wrench, image and a map."""
    image = np.zeros((48, 64, 3), np.uint8)
    image[...] = (BLUE, 60, RED)
    told = {"x0": 1.5, "y0": -2.0, "z0": 0.0, "dx": 0.0, "dy": 0.0, "dz": 0.4, "deg": 0.0}
    felt = {"fx": 0.0, "fy": 0.0, "fz": 2.5, "mx": 0.0, "my": 0.0, "mz": 0.0}
    maps = {"grid_z": np.zeros((4, 5))}
    return {**told, **felt, **maps, "image": image, **changed}


def make_records(folder: Path) -> Path:
    """Write two straight presses and one that slides, and how to import them."""
    (folder / "feats").mkdir(parents=True)
    np.savez(folder / "feats/1_sphere_10.npz", **record())
    np.savez(folder / "feats/2_cylinder_5.npz", **record(fz=4.0, dz=0.3))
    np.savez(folder / "feats/3_sphere_10.npz", **record(dx=0.2))
    np.save(folder / "rest.npy", np.full((48, 64, 3), 90, np.uint8))
    (folder / "import.toml").write_text(RECORDS_SPEC)
    return folder


def make_lerobot(folder: Path, *, kind: str = "image") -> Path:
    """Write a dataset of two episodes of one press each, 2 N and 3 N, and how to import it."""
    key = "observation.images.tactile"
    data = [_episode(index, newton) for index, newton in enumerate((2.0, 3.0))]
    features: dict[str, Any] = {
        key: {"dtype": kind, "shape": [48, 64, 3], "names": ["height", "width", "channels"]},
        "observation.wrench": {"dtype": "float32", "shape": [6], "names": None},
        "observation.state": {"dtype": "float32", "shape": [3], "names": ["x", "y", "z"]},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
        "episode_index": {"dtype": "int64", "shape": [1], "names": None},
    }
    info = {
        "codebase_version": "v3.0",
        "total_episodes": 2,
        "fps": HZ,
        "chunks_size": 1000,
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
        "features": features,
    }
    rows = [row for episode in data for row in episode]
    if kind == "image":
        for row in rows:
            row[key] = {"bytes": bytes(cv2.imencode(".png", _image(row))[1]), "path": None}
    else:
        _video(folder / f"videos/{key}/chunk-000/file-000.mp4", rows)
    episodes = [
        {
            "episode_index": index,
            "length": len(episode),
            "data/chunk_index": 0,
            "data/file_index": 0,
            f"videos/{key}/chunk_index": 0,
            f"videos/{key}/file_index": 0,
            f"videos/{key}/from_timestamp": index * len(data[0]) / HZ,
        }
        for index, episode in enumerate(data)
    ]
    _parquet(folder / "data/chunk-000/file-000.parquet", rows)
    _parquet(folder / "meta/episodes/chunk-000/file-000.parquet", episodes)
    (folder / "meta/info.json").write_text(json.dumps(info))
    (folder / "import.toml").write_text(LEROBOT_SPEC)
    return folder


def _episode(index: int, newton: float) -> list[dict[str, Any]]:
    """Return rows: rest, a press of so many newtons, rest; 0.1 mm a newton deep."""
    rest, held = round(REST_S * HZ), round(HELD_S * HZ)
    force = newton * np.concatenate([np.zeros(rest), np.ones(held), np.zeros(held)])
    return [
        {
            "timestamp": k / HZ,
            "frame_index": k,
            "episode_index": index,
            "observation.wrench": [0.0, 0.0, float(f), 0.0, 0.0, 0.0],
            "observation.state": [0.0, 0.0, -0.1 * float(f)],
        }
        for k, f in enumerate(force)
    ]


def _image(row: dict[str, Any]) -> np.ndarray:
    level = 90 + round(20 * row["observation.wrench"][2])
    return np.full((48, 64, 3), level, np.uint8)


def _video(path: Path, rows: list[dict[str, Any]]) -> None:
    path.parent.mkdir(parents=True)
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), HZ, (64, 48))
    assert video.isOpened()
    for row in rows:
        video.write(_image(row))
    video.release()


def _parquet(path: Path, rows: list[dict[str, Any]]) -> None:
    path.parent.mkdir(parents=True)
    pq.write_table(pa.Table.from_pylist(rows), path)
