"""ROS 2 bags, MCAP or SQLite: images, wrenches and poses by topic.

Messages are decoded by the definitions that come with the reader: those that a file brings are not
looked at, since the reader would make code of them.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from backports import zstd
from lz4.frame import LZ4FrameDecompressor
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from pydantic import Field
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from tacauchy_rig.app.importing import press_detection as detection
from tacauchy_rig.app.importing import video_and_clock_offset as offsets
from tacauchy_rig.app.importing.source_files import IMAGE_PIXELS, LARGE_BYTES, MIB, Source, at_most
from tacauchy_rig.core.arrays import Int64Array
from tacauchy_rig.core.config.field_ranges import Length, Section
from tacauchy_rig.core.errors import RecordError, whole
from tacauchy_rig.core.image_codec import decode_rgb, encode_png
from tacauchy_rig.core.run import CameraClock

TYPES = get_typestore(Stores.ROS2_HUMBLE)
MESSAGES_MOST = 2_000_000
"""Of a topic: a kilohertz for half an hour."""
FRAMES_BYTES = 4096 * MIB
"""Of all images together, which are held while they are cut into presses."""
IMAGES = ("sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image")
WRENCH, POSE = "geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/PoseStamped"
MCAP = ".mcap"
STORAGES = (MCAP, ".db3")
METADATA = "metadata.yaml"
CLOCKS_S = 0.1
"""By which stamps of image and force are apart, if they are of clocks of their own."""
FITS = 0.9
"""Of the best correlation: stamps that have it fit as they are."""
ALIGNED_MOST = 20_000
"""Frames that are looked at: a quarter of an hour at 20 Hz."""
_MENDED = "copy it anew from its source; `mcap recover` mends an MCAP file whose end is missing"
_FOUND = (
    "{count} presses were found by the force. Zero and the no-contact image of each are of the "
    "second before it; it counts as held while the force is nearly its largest, which no protocol "
    "judged."
)


class BagData(Section):
    """``[data]`` of a ROS 2 bag."""

    file: str
    image: str | None = None
    force: str | None = None
    pose: str | None = None
    pad_centre: tuple[Length, Length] | None = None
    presses: detection.PressFinding = Field(default_factory=detection.PressFinding)


def read_bag(source: Source, data: BagData) -> detection.Recorded:
    """Read a bag and cut it into presses.

    Raises:
        RecordError: It is damaged, a topic is missing or of another type, or no press is found.
    """
    paths = _checked(source, data.file)
    notes: list[str] = []
    pose = None
    with whole(data.file, "ROS 2 bag", remedy=_MENDED), ExitStack() as stack:
        # Each file is read by itself: what the bag's metadata says of them is not needed.
        bag = [stack.enter_context(Reader(path)) for path in paths]
        image = _topic(bag, data.image, IMAGES, "data.image")
        wrench = _topic(bag, data.force, (WRENCH,), "data.force")
        force, force_late_ns = _samples(bag, wrench, _wrench, notes)
        frames, frames_late_ns = _frames(bag, image)
        if data.pose is not None or POSE in _topics(bag).values():
            pose, _ = _samples(bag, _topic(bag, data.pose, (POSE,), "data.pose"), _pose, notes)
    found = detection.find_presses(force, data.presses)
    apart_s = float(np.median(frames_late_ns) - np.median(force_late_ns)) / detection.S
    frames, clock = _aligned(force, frames, found, apart_s, notes)
    presses = detection.cut(found, force, frames, pose, pad_centre=data.pad_centre)
    return detection.Recorded(
        presses=presses,
        has_clock=True,
        unknown=("The delays of the messages are not known.",),
        notes=(_FOUND.format(count=len(presses)), *detection.drift_note(found), *notes),
        contact_force_n=data.presses.contact_force,
        name="bag",
        clock=clock,
    )


def _checked(source: Source, name: str) -> list[Path]:
    """Return the bag's files; each lies within the source and is no pack of its own."""
    stored = [name]
    if Path(name).suffix not in STORAGES:
        inside = source.prefix(name, field="data.file")
        folder = source.root / inside
        if (folder / METADATA).exists():
            about = source.read(f"{inside}{METADATA}", field="data.file", most_bytes=MIB)
            if re.search(rb"compression_mode:\s*['\"]?message", about, re.IGNORECASE):
                raise RecordError(
                    f"{name}: its messages are packed one by one",
                    remedy="`ros2 bag convert` without compression_mode",
                )
        files = [path for path in sorted(folder.iterdir()) if not path.name.startswith(".")]
        if packed := [path.name for path in files if path.suffix in (".zstd", ".zst")]:
            raise RecordError(
                f"data.file: {packed[0]} is packed as a whole", remedy="unpack it: `zstd -d`"
            )
        stored = [f"{inside}{path.name}" for path in files if path.suffix in STORAGES]
    if not stored:
        raise RecordError(
            f"data.file: {name!r} holds no file {' or '.join(STORAGES)}",
            remedy="name the folder that `ros2 bag record` wrote, or the file itself",
        )
    paths = [source.path(each, field="data.file", most_bytes=LARGE_BYTES) for each in stored]
    for path in paths:
        if path.suffix == MCAP:  # SQLite's parts are within the file
            check_chunks(path, name=f"data.file: {path.name}")
    return paths


def _topics(bag: Sequence[Reader]) -> dict[str, str]:
    """Return types by topic."""
    return {each.topic: each.msgtype for file in bag for each in file.connections}


def _topic(bag: Sequence[Reader], name: str | None, types: tuple[str, ...], field: str) -> str:
    """Return a topic by its name, or the only one of its types, by whichever publishers."""
    there, counts = _topics(bag), Counter[str]()
    for each in (connection for file in bag for connection in file.connections):
        counts[each.topic] += each.msgcount
    fitting = [t for t, kind in there.items() if kind in types and name in (None, t)]
    fitting = [topic for topic in fitting if counts[topic]] or fitting
    if len(fitting) == 1 and counts[fitting[0]] <= MESSAGES_MOST:
        return fitting[0]
    topics = ", ".join(f"{topic} ({kind})" for topic, kind in list(there.items())[:20]) or "nothing"
    raise RecordError(
        f"{field}: {'no topic' if name is None else name} is the one of type {' or '.join(types)} "
        f"with at most {MESSAGES_MOST} messages; {len(fitting)} of that name and type",
        remedy=f"name one of its topics: {topics}",
    )


def _messages(bag: Sequence[Reader], topic: str) -> Iterator[tuple[int, int, Any]]:
    """Yield when each message was stamped, how much later it was logged [ns], and its content."""
    for file in bag:
        own = [each for each in file.connections if each.topic == topic]
        for connection, logged_ns, raw in file.messages(own) if own else ():
            message: Any = TYPES.deserialize_cdr(raw, connection.msgtype)
            stamp = message.header.stamp
            stamp_ns = int(stamp.sec) * detection.S + int(stamp.nanosec) or int(logged_ns)
            yield stamp_ns, int(logged_ns) - stamp_ns, message


def _samples(
    bag: Sequence[Reader], topic: str, values: Any, notes: list[str]
) -> tuple[detection.Samples, Int64Array]:
    """Return a topic's numbers by stamp, and how late each was logged [ns]."""
    rows = sorted(
        ((stamp, late, values(each)) for stamp, late, each in _messages(bag, topic)),
        key=lambda row: row[0],
    )
    stamps, late = (np.array([row[k] for row in rows], dtype=np.int64) for k in (0, 1))
    value = np.array([row for *_, row in rows], dtype=np.float64).reshape(-1, 6)
    known = np.asarray(np.isfinite(value).all(axis=1))
    return detection.known_samples(stamps, value, known, topic, notes), late


def _wrench(message: Any) -> list[float]:
    force, torque = message.wrench.force, message.wrench.torque
    return [force.x, force.y, force.z, torque.x, torque.y, torque.z]


def _pose(message: Any) -> list[float]:
    place, turned = message.pose.position, message.pose.orientation
    quaternion = np.array([turned.x, turned.y, turned.z, turned.w])
    vector = np.zeros(3)  # of a message that says nothing of its orientation
    if np.isfinite(quaternion).all() and np.linalg.norm(quaternion) > 0.0:
        vector = Rotation.from_quat(quaternion).as_rotvec()
    return [place.x, place.y, place.z, *vector]


def _frames(bag: Sequence[Reader], topic: str) -> tuple[list[detection.Frame], Int64Array]:
    """Return a topic's images by stamp, and how late each was logged [ns]."""
    size, is_raw = 0, _topics(bag)[topic] == IMAGES[1]
    found, lateness = [], []
    for number, (stamp_ns, late, message) in enumerate(_messages(bag, topic)):
        size += len(message.data)
        at_most(FRAMES_BYTES, size, f"{topic}: {size} bytes of images or more")
        name = f"{topic} {number}"
        data = _raw(message, name) if is_raw else message.data.tobytes()
        found.append(detection.Frame(stamp_ns=stamp_ns, name=name, read=partial(bytes, data)))
        lateness.append(late)
    found.sort(key=lambda frame: frame.stamp_ns)
    return found, np.array(lateness or [0], dtype=np.int64)


_CHANNELS: Mapping[str, tuple[int, ...]] = {
    "rgb8": (0, 1, 2),
    "bgr8": (2, 1, 0),
    "mono8": (0, 0, 0),
}


def _raw(message: Any, name: str) -> bytes:
    """Return a raw image as PNG."""
    order = _CHANNELS.get(message.encoding)
    height, width, step = int(message.height), int(message.width), int(message.step)
    depth = 1 if message.encoding == "mono8" else 3
    if (
        order is None
        or not 0 < height * width <= IMAGE_PIXELS
        or step < width * depth
        or len(message.data) != height * step
    ):
        raise RecordError(
            f"{name}: {width} x {height} px, step {step}, {len(message.data)} bytes of "
            f"{message.encoding[:40]!r}",
            remedy=f"encodings that are read: {', '.join(_CHANNELS)}, whole images only",
        )
    rows = np.asarray(message.data, np.uint8).reshape(height, step)[:, : width * depth]
    return encode_png(np.ascontiguousarray(rows.reshape(height, width, depth)[..., list(order)]))


def _aligned(
    force: detection.Samples,
    frames: list[detection.Frame],
    found: Sequence[detection.PressSpan],
    apart_s: float,
    notes: list[str],
) -> tuple[list[detection.Frame], CameraClock | None]:
    """Return the frames in the clock of the force.

    Messages of both are about as late, so when they arrive tells clocks roughly apart; what is seen
    and felt of the presses tells the rest. Stamps that already fit stay as they are.

    Args:
        apart_s: By how much images were logged later after their stamps than forces.
    """
    rough_s = apart_s if abs(apart_s) > CLOCKS_S else 0.0
    moved = _moved(frames, rough_s)
    images = [
        (f.stamp_ns / detection.S, decode_rgb(f.read(), reduction=8)) for f in moved[:ALIGNED_MOST]
    ]
    known = [(time_s, image) for time_s, image in images if image is not None]
    if len(known) < 3:
        return frames, None
    time_s = np.array([each for each, _ in known])
    seen = offsets.Signal(
        time_s=time_s, value=offsets.image_change((image for _, image in known), time_s)
    )
    try:
        clock = offsets.offset_to_force(force, seen, found)
    except RecordError as error:
        notes.append(f"Whether the camera has the force's clock is not known: {error.message}.")
        return moved, None
    felt = offsets.root_of(offsets.felt_over_rests(force, found))
    fits = offsets.likeness(felt, seen, 0.0) > FITS * clock.correlation
    if fits or np.abs(offsets.aligned(time_s, clock) - time_s).max() < CLOCKS_S:
        clock = replace(clock, offset_s=0.0, drift=0.0)
        if not rough_s:
            return frames, None
    clock = replace(clock, offset_s=rough_s + clock.offset_s)
    notes.append(
        f"The camera's stamps are of another clock: {clock.offset_s:+.3f} s were added, and "
        f"{clock.drift:+.5f} s a second further, by when contact shows in both, standard "
        f"uncertainty {1e3 * clock.uncertainty_s:.0f} ms."
    )
    return _moved(frames, clock.offset_s, clock.drift), clock


def _moved(
    frames: Sequence[detection.Frame], by_s: float, drift: float = 0.0
) -> list[detection.Frame]:
    later_ns = [
        round(by_s * detection.S + drift * (f.stamp_ns - frames[0].stamp_ns)) for f in frames
    ]
    return [replace(f, stamp_ns=f.stamp_ns + ns) for f, ns in zip(frames, later_ns, strict=True)]


CHUNK_BYTES = 256 * MIB
"""Of a chunk, packed or unpacked; writers begin a new one after some megabytes."""
_UNPACKING = {"lz4": LZ4FrameDecompressor, "zstd": zstd.ZstdDecompressor}


def check_chunks(path: Path, *, name: str) -> None:
    """Refuse a file whose records or chunks are larger than they may be.

    Raises:
        RecordError: A record is longer than its file, or a chunk unpacks to too much.
    """
    limit = min(path.stat().st_size, 2 * CHUNK_BYTES)
    with path.open("rb") as file, whole(name, "MCAP file", remedy=_MENDED):
        for record in StreamReader(file, emit_chunks=True, record_size_limit=limit).records:
            if isinstance(record, Chunk):
                _check_chunk(record, f"{name}: a chunk before byte {file.tell()}")


def _check_chunk(chunk: Chunk, where: str) -> None:
    """Refuse a chunk by its size; never more than it states is unpacked."""
    size, remedy = chunk.uncompressed_size, "record it anew in chunks of some megabytes"
    at_most(CHUNK_BYTES, size, f"{where} unpacks to {size} bytes", remedy=remedy)
    if chunk.compression not in _UNPACKING:
        return
    with suppress(RuntimeError, EOFError, zstd.ZstdError):  # the reader says that it is damaged
        unpacked = _UNPACKING[chunk.compression]().decompress(chunk.data, max_length=size + 1)
        told = f"{where} says to unpack to {size} bytes and goes on"
        at_most(size, len(unpacked), told, remedy=remedy)
