"""A ROS 2 bag in MCAP: images, wrenches, poses, and the tip's motion as six joints.

Messages are stamped and logged as their samples arrived. Joints are of the tip, in the base frame:
position is the pose, velocity the tip's, effort the wrench that the arm itself felt.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from scipy.spatial.transform import Rotation

from tacauchy_rig.app.exporting.episode_and_import_toml import Episode, pad_centre, write_spec
from tacauchy_rig.app.importing.ros_bag import IMAGES, POSE, TYPES, WRENCH
from tacauchy_rig.core.store.recording.mcap_writer import POSE_FIELDS
from tacauchy_rig.core.store.run_store import RunStore

IMAGE_TOPIC, FORCE_TOPIC, POSE_TOPIC = "/tactile/image", "/force/wrench", "/tip/pose"
KINDS = {
    IMAGE_TOPIC: IMAGES[0],
    FORCE_TOPIC: WRENCH,
    POSE_TOPIC: POSE,
    "/tip/joints": "sensor_msgs/msg/JointState",
}
_FRAMES = {IMAGE_TOPIC: "tactile", FORCE_TOPIC: "force_sensor"}
_BAG = "recorded"


def write_bag(presses: Iterable[Episode], out: Path, store: RunStore | None) -> None:
    """Write presses into one bag, and how to import those of a run."""
    with Writer(out / _BAG, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {
            name: writer.add_connection(name, kind, typestore=TYPES) for name, kind in KINDS.items()
        }
        for episode in presses:
            for topic, stamp_ns, values in sorted(_messages(episode), key=lambda each: each[1]):
                sec, nanosec = divmod(stamp_ns, 10**9)
                stamp = TYPES.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
                frame = _FRAMES.get(topic, "base")
                header = TYPES.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)
                message = TYPES.types[KINDS[topic]](header=header, **values)
                raw = TYPES.serialize_cdr(message, KINDS[topic])
                writer.write(topics[topic], stamp_ns, raw)
    if store is None:
        return
    data: dict[str, object] = {"file": _BAG, "force": FORCE_TOPIC}
    if (centre := pad_centre(store)) is not None:
        data["pad_centre"] = [f"{value!r} m" for value in centre]
    write_spec(store, out, "bag", data)


def _messages(episode: Episode) -> Iterator[tuple[str, int, dict[str, Any]]]:
    """Yield topic, stamp [ns] and content of each message."""
    kinds = TYPES.types
    vector, point = kinds["geometry_msgs/msg/Vector3"], kinds["geometry_msgs/msg/Point"]
    quaternion, pose_of = kinds["geometry_msgs/msg/Quaternion"], kinds["geometry_msgs/msg/Pose"]
    wrench_of, names = kinds["geometry_msgs/msg/Wrench"], [f"tip_{name}" for name in POSE_FIELDS]
    force, pose = episode.force, episode.pose
    for stamp, wrench in zip(force.stamp_ns.tolist(), force.value.tolist(), strict=True):
        felt = wrench_of(force=vector(*wrench[:3]), torque=vector(*wrench[3:]))
        yield FORCE_TOPIC, stamp, {"wrench": felt}
    if pose is not None:
        motion = np.hstack([pose.value, episode.velocity, episode.arm_wrench])
        for stamp, row in zip(pose.stamp_ns.tolist(), motion, strict=True):
            # A pose that says nothing of its orientation keeps NaN there, as its reader expects.
            known = np.isfinite(row[3:6]).all()
            turned = Rotation.from_rotvec(row[3:6]).as_quat().tolist() if known else [np.nan] * 4
            place = pose_of(position=point(*row[:3].tolist()), orientation=quaternion(*turned))
            yield POSE_TOPIC, stamp, {"pose": place}
            joints = dict(zip(("position", "velocity", "effort"), row.reshape(3, 6), strict=True))
            yield "/tip/joints", stamp, {"name": names, **joints}
    for frame in episode.frames():
        data = np.frombuffer(frame.jpeg, np.uint8)
        yield IMAGE_TOPIC, frame.stamp_ns, {"format": frame.kind, "data": data}
