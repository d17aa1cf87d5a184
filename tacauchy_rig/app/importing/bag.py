"""ROS 2 bags, MCAP or SQLite: images, wrenches and poses by topic.

Messages are decoded by the definitions that come with the reader: those that a file brings are not
looked at, since the reader would make code of them.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import numpy as np
from backports import zstd
from lz4.frame import LZ4FrameDecompressor
from pydantic import Field
from rosbags.rosbag2 import Reader, ReaderError
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from tacauchy_rig.app.importing.offset import (
    Signal,
    felt_over_rests,
    image_change,
    likeness,
    offset_to_force,
)
from tacauchy_rig.app.importing.presses import (
    Frame,
    Press,
    PressFinding,
    PressSpan,
    Recorded,
    S,
    Samples,
    Streams,
    cut,
    drift_note,
    find_presses,
)
from tacauchy_rig.app.importing.source import IMAGE_PIXELS, LARGE_BYTES, MIB, Source
from tacauchy_rig.core.arrays import Int64Array
from tacauchy_rig.core.config.fields import Length, Section
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.imported import CameraClock
from tacauchy_rig.core.rgb import decode_rgb, encode_png

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
# Of what a broken file makes the reader say.
_BROKEN = (
    ReaderError,
    OSError,
    ValueError,
    KeyError,
    IndexError,
    AssertionError,
    EOFError,
    RuntimeError,
    struct.error,
    TypeError,
    AttributeError,
    MemoryError,
)


class BagData(Section):
    """``[data]`` of a ROS 2 bag.

    Attributes:
        file: A ``.mcap`` or ``.db3``, or the folder with ``metadata.yaml``.
        image: Topic of the images; left out, the only one with images. Likewise the next two.
        pad_centre: Where the tip's x and y are above the pad's centre; left out, the place is not
            known.
    """

    file: str
    image: str | None = None
    force: str | None = None
    pose: str | None = None
    pad_centre: tuple[Length, Length] | None = None
    presses: PressFinding = Field(default_factory=PressFinding)


def read_bag(source: Source, data: BagData) -> Recorded:
    """Read a bag and cut it into presses.

    Raises:
        RecordError: It is damaged, a topic is missing or of another type, or no press is found.
    """
    paths = _checked(source, data.file)
    try:
        with ExitStack() as stack:
            bag = Bag(data.file, [stack.enter_context(Reader(path)) for path in paths])
            streams, notes = _streams(bag, data)
    except RecordError:
        raise
    except _BROKEN as error:
        raise RecordError(
            f"{data.file}: no whole ROS 2 bag: {type(error).__name__}: {str(error)[:200]}",
            remedy="copy it anew from its source; `mcap recover` of the MCAP tools mends a file "
            "whose end is missing",
        ) from error
    found = find_presses(streams.force, data.presses)
    streams, clock = _aligned(streams, found, notes)
    presses = tuple(_placed(press, data.pad_centre) for press in cut(streams, found))
    return Recorded(
        presses=presses,
        has_clock=True,
        unknown=tuple(_unknown(data, streams)),
        notes=(_FOUND.format(count=len(presses)), *drift_note(found), *notes.told),
        contact_force_n=data.presses.contact_force,
        name="bag",
        clock=clock,
    )


_FOUND = (
    "{count} presses were found by the force. Zero and the no-contact image of each are of the "
    "second before it; it counts as held while the force is nearly its largest, which no protocol "
    "judged."
)


@dataclass(frozen=True, slots=True)
class Bag:
    """The files of a bag, each read by itself: what its metadata says of them is not needed."""

    name: str
    readers: Sequence[Reader]

    @property
    def topics(self) -> dict[str, str]:
        """Types by topic."""
        return {each.topic: each.msgtype for file in self.readers for each in file.connections}

    def count(self, topic: str) -> int:
        """Return how many messages a topic has, by whichever publisher."""
        every = (each for file in self.readers for each in file.connections)
        return sum(each.msgcount for each in every if each.topic == topic)

    def messages(self, topic: str) -> Iterator[tuple[int, int, Any]]:
        """Yield when each was logged and stamped [ns], and its content."""
        for file in self.readers:
            own = [each for each in file.connections if each.topic == topic]
            for connection, logged_ns, raw in file.messages(own) if own else ():
                message: Any = TYPES.deserialize_cdr(raw, connection.msgtype)
                stamp = message.header.stamp
                header_ns = int(stamp.sec) * S + int(stamp.nanosec)
                yield int(logged_ns), header_ns or int(logged_ns), message


@dataclass(slots=True)
class _Notes:
    """What was met while reading.

    Attributes:
        told: Sentences.
        camera_s: By how much the camera's stamps are moved to fit the force's [s].
    """

    told: list[str]
    camera_s: float = 0.0


def _checked(source: Source, name: str) -> list[Path]:
    """Return the bag's files; each lies within the source and is no pack of its own."""
    if Path(name).suffix in STORAGES:
        return [_bounded(source.path(name, field="data.file", most_bytes=LARGE_BYTES))]
    folder = source.folder(name, field="data.file")
    inside = "" if folder == source.root else f"{folder.relative_to(source.root)}/"
    if (folder / METADATA).exists():
        about = source.read(f"{inside}{METADATA}", field="data.file", most_bytes=MIB)
        if re.search(rb"compression_mode:\s*['\"]?message", about, re.IGNORECASE):
            raise RecordError(
                f"{name}: its messages are packed one by one",
                remedy="`ros2 bag convert` without compression_mode",
            )
    files = [path for path in sorted(folder.iterdir()) if not path.name.startswith(".")]
    for path in files:
        if path.suffix in (".zstd", ".zst"):
            raise RecordError(
                f"data.file: {path.name} is packed as a whole", remedy="unpack it: `zstd -d`"
            )
    stored = [path.name for path in files if path.suffix in STORAGES]
    if not stored:
        raise RecordError(
            f"data.file: {name!r} holds no file {' or '.join(STORAGES)}",
            remedy="name the folder that `ros2 bag record` wrote, or the file itself",
        )
    return [
        _bounded(source.path(f"{inside}{each}", field="data.file", most_bytes=LARGE_BYTES))
        for each in stored
    ]


def _bounded(path: Path) -> Path:
    """Return a file whose parts are none too large; SQLite's are within the file."""
    if path.suffix == MCAP:
        check_chunks(path, name=f"data.file: {path.name}")
    return path


def _unknown(data: BagData, streams: Streams) -> Iterator[str]:
    yield "How much later than the moment itself the messages are stamped is not known."
    if streams.pose is None:
        yield "The depth is not known."
    if data.pad_centre is None or streams.pose is None:
        yield "Where on the pad was pressed is not known."


def _streams(bag: Bag, data: BagData) -> tuple[Streams, _Notes]:
    image = _topic(bag, data.image, IMAGES, "data.image")
    force = _topic(bag, data.force, (WRENCH,), "data.force")
    pose = _topic(bag, data.pose, (POSE,), "data.pose", optional=True)
    if image is None or force is None:
        raise RecordError(f"{bag.name}: has no images or no forces", remedy="name its topics")
    notes = _Notes([])
    felt, felt_late = _samples(bag, force, _wrench, notes)
    frames, seen_late = _frames(bag, image)
    apart_s = float(np.median(seen_late) - np.median(felt_late)) / S
    notes.camera_s = apart_s if abs(apart_s) > CLOCKS_S else 0.0
    streams = Streams(
        force=felt,
        frames=frames,
        pose=None if pose is None else _samples(bag, pose, _pose, notes)[0],
    )
    return streams, notes


def _aligned(
    streams: Streams, found: Sequence[PressSpan], notes: _Notes
) -> tuple[Streams, CameraClock | None]:
    """Return the streams with the camera's stamps in the clock of the force.

    Messages of both are about as late, so when they arrive tells clocks roughly apart; what is seen
    and felt of the presses tells the rest. Stamps that already fit stay as they are.
    """
    moved = [replace(f, stamp_ns=f.stamp_ns + round(notes.camera_s * S)) for f in streams.frames]
    images = [decode_rgb(frame.read(), reduction=8) for frame in moved[:ALIGNED_MOST]]
    known = [k for k, image in enumerate(images) if image is not None]
    if len(known) < 3:
        return streams, None
    time_s = np.array([moved[k].stamp_ns for k in known]) / S
    change = image_change((image for image in images if image is not None), time_s)
    seen = Signal(time_s=time_s, value=change)
    felt = felt_over_rests(streams.force, found)
    try:
        offset = offset_to_force(streams.force, seen, found)
    except RecordError as error:
        notes.told.append(
            f"Whether the camera has the force's clock is not known: {error.message}."
        )
        return replace(streams, frames=moved), None
    fits = likeness(felt, seen, 0.0) > FITS * offset.correlation
    shift_s = 0.0 if fits or abs(offset.seconds) < CLOCKS_S else offset.seconds
    if not shift_s and not notes.camera_s:
        return streams, None
    frames = [replace(frame, stamp_ns=frame.stamp_ns + round(shift_s * S)) for frame in moved]
    clock = CameraClock(
        offset_s=notes.camera_s + shift_s,
        uncertainty_s=offset.uncertainty_s,
        correlation=offset.correlation,
    )
    notes.told.append(
        f"The camera's stamps are of another clock: {clock.offset_s:+.3f} s were added, by when "
        f"contact shows in both, standard uncertainty {1e3 * clock.uncertainty_s:.0f} ms."
    )
    return replace(streams, frames=frames), clock


def _topic(
    bag: Bag, name: str | None, types: tuple[str, ...], field: str, *, optional: bool = False
) -> str | None:
    """Return a topic by its name, or the only one of its types."""
    there = bag.topics
    fitting = [t for t, kind in there.items() if kind in types and name in (None, t)]
    fitting = [topic for topic in fitting if bag.count(topic)] or fitting
    if len(fitting) == 1 and bag.count(fitting[0]) <= MESSAGES_MOST:
        return fitting[0]
    if not fitting and optional and name is None:
        return None
    topics = ", ".join(f"{topic} ({kind})" for topic, kind in list(there.items())[:20]) or "nothing"
    raise RecordError(
        f"{field}: {'no topic' if name is None else name} is the one of type {' or '.join(types)} "
        f"with at most {MESSAGES_MOST} messages; {len(fitting)} of that name and type",
        remedy=f"name one of its topics: {topics}",
    )


def _samples(bag: Bag, topic: str, values: Any, notes: _Notes) -> tuple[Samples, Int64Array]:
    """Return a topic's numbers by stamp, and how late each was logged [ns]."""
    rows = sorted(
        ((stamp, logged - stamp, values(each)) for logged, stamp, each in bag.messages(topic)),
        key=lambda row: row[0],
    )
    value = np.array([row for *_, row in rows], dtype=np.float64).reshape(-1, 6)
    known = np.asarray(np.isfinite(value).all(axis=1))
    if not known.all():
        notes.told.append(
            f"{topic}: {int((~known).sum())} of {len(known)} messages hold values that are no "
            "finite numbers and were left out."
        )
    stamps, late = (np.array([row[k] for row in rows], dtype=np.int64) for k in (0, 1))
    return Samples(stamp_ns=stamps[known], value=value[known]), late


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


def _frames(bag: Bag, topic: str) -> tuple[tuple[Frame, ...], Int64Array]:
    """Return a topic's images by stamp, and how late each was logged [ns]."""
    size, is_raw = 0, bag.topics[topic] == IMAGES[1]
    found, late = [], []
    for number, (logged_ns, stamp_ns, message) in enumerate(bag.messages(topic)):
        size += len(message.data)
        if size > FRAMES_BYTES:
            raise RecordError(
                f"{topic}: more than {FRAMES_BYTES} bytes of images", remedy="split the bag"
            )
        name = f"{topic} {number}"
        data = _raw(message, name) if is_raw else message.data.tobytes()
        found.append(Frame(stamp_ns=stamp_ns, name=name, read=partial(bytes, data)))
        late.append(logged_ns - stamp_ns)
    frames = tuple(sorted(found, key=lambda frame: frame.stamp_ns))
    return frames, np.array(late or [0], dtype=np.int64)


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


def _placed(press: Press, centre: tuple[float, float] | None) -> Press:
    """Return a press with where the tip was beside the pad's centre, where that is stated."""
    if press.pose is None or centre is None:
        return press
    held = press.pose.within(press.dwell).value
    if not len(held):
        return press
    x, y = held[:, :2].mean(axis=0) - np.array(centre)
    return replace(press, place_m=(float(x), float(y)))


CHUNK_BYTES = 256 * MIB
"""Of a chunk unpacked; writers begin a new one after some megabytes."""
RECORDS_MOST = 20_000_000
MAGIC = b"\x89MCAP0\r\n"
_CHUNK = 6
_HEAD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct(
    "<QQQII"
)  # times, size unpacked, checksum, length of the packing's name
_LENGTH = struct.Struct("<Q")
_PIECE = MIB


class _Unpacks(Protocol):
    @property
    def eof(self) -> bool: ...
    @property
    def needs_input(self) -> bool: ...
    def decompress(self, data: bytes, max_length: int = -1) -> bytes: ...


def check_chunks(path: Path, *, name: str) -> None:
    """Refuse a file whose records or chunks are larger than they may be.

    Args:
        name: Of the file, for messages.

    Raises:
        RecordError: A record is longer than its file, or a chunk unpacks to too much.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise _broken(name, "does not begin as one")
        for _ in range(RECORDS_MOST):
            at = file.tell()
            head = file.read(_HEAD.size)
            if len(head) < _HEAD.size or head == (MAGIC + MAGIC)[: _HEAD.size]:
                return  # its end, which the reader judges
            opcode, length = _HEAD.unpack(head)
            if length > size - file.tell():
                raise _broken(name, f"its record at byte {at} says to be {length} bytes long")
            end = file.tell() + length
            if opcode == _CHUNK:
                _check_chunk(file, length, at=at, name=name)
            file.seek(end)
    raise _broken(name, f"more than {RECORDS_MOST} records")


def _check_chunk(file: BinaryIO, length: int, *, at: int, name: str) -> None:
    where = f"its chunk at byte {at}"
    head = file.read(min(length, _CHUNK_HEAD.size))
    if len(head) < _CHUNK_HEAD.size:
        raise _broken(name, f"{where} is cut off")
    *_, stated, _, letters = _CHUNK_HEAD.unpack(head)
    if stated > CHUNK_BYTES:
        raise _broken(name, f"{where} unpacks to {stated} bytes; at most {CHUNK_BYTES} are read")
    packing = file.read(min(letters, length))
    packed_length = _LENGTH.unpack(file.read(_LENGTH.size).ljust(_LENGTH.size, b"\0"))[0]
    if packed_length > length:
        raise _broken(name, f"{where} says to hold {packed_length} bytes of its {length}")
    unpacking = {b"lz4": LZ4FrameDecompressor, b"zstd": zstd.ZstdDecompressor}.get(packing)
    if unpacking is not None and _is_longer(unpacking(), file, packed_length, stated):
        raise _broken(name, f"{where} says to unpack to {stated} bytes and goes on")


def _is_longer(unpacks: _Unpacks, file: BinaryIO, packed: int, stated: int) -> bool:
    """Return whether packed bytes give more than they say; never more than a piece is in memory."""
    found = 0
    while packed > 0 or not unpacks.needs_input:
        data = b""
        if unpacks.needs_input:
            data = file.read(min(packed, _PIECE))
            packed -= len(data)
            if not data:
                return False  # the reader says that it is cut off
        try:
            found += len(unpacks.decompress(data, max_length=_PIECE))
        except (RuntimeError, EOFError, zstd.ZstdError):
            return False  # the reader says that it is damaged
        if found > stated:
            return True
        if unpacks.eof:
            return False
    return False


def _broken(name: str, why: str) -> RecordError:
    return RecordError(
        f"{name}: no MCAP file that is read: {why}",
        remedy="record it anew in chunks of some megabytes, or copy it anew from its source",
    )
