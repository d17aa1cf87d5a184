"""What a recording holds, and writing it so that nothing acknowledged is lost, whatever dies.

Its protobuf messages can be decoded by any MCAP reader. Images are ``foxglove.CompressedImage``,
which viewers show as they are. Force, arm and journal messages are described here; the description
travels inside each recording.

Every message is a chunk of its own and is with the operating system before the call returns, so
killing this process loses nothing; a thread brings the file to the disk each second, so losing
power loses about that second. The file is an MCAP of four topics, described inside it, without
compression.
"""

import contextlib
import fcntl
import hashlib
import io
import json
import logging
import os
import threading
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Self

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass
from mcap.well_known import MessageEncoding
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import ArmSample, ForceSample, ImageFrame, JournalEvent
from tacauchy_rig.core.store.atomic_write import sync_folder, write_error, writing
from tacauchy_rig.core.store.json_codec import loads, read_value, to_json

PACKAGE = "tacauchy_rig"
WRENCH_FIELDS = ("fx_n", "fy_n", "fz_n", "mx_n_m", "my_n_m", "mz_n_m")
POSE_FIELDS = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")
VELOCITY_FIELDS = ("vx_m_s", "vy_m_s", "vz_m_s", "wx_rad_s", "wy_rad_s", "wz_rad_s")
TCP_FORCE_FIELDS = tuple(f"tcp_{name}" for name in WRENCH_FIELDS)
ARM_STATES = ("runtime_state", "safety_bits", "robot_mode")
_LATEST_STAMP_S = 1e9  # of a camera's clock, which counts from the start; later ones are no stamps


class Topic(StrEnum):
    """Streams of a recording."""

    FORCE = "/force"
    ARM = "/arm"
    EVENT = "/event"
    IMAGE = "/image"


def _message(name: str, /, optional: tuple[str, ...] = (), **kinds: int) -> Any:
    """Return the class of a message; a field of ``optional`` may be absent, and knows it."""
    file = FileDescriptorProto(name=f"{PACKAGE}/{name}.proto", package=PACKAGE, syntax="proto3")
    message = file.message_type.add(name=name)
    for number, (field, kind) in enumerate(kinds.items(), start=1):
        added = message.field.add(
            name=field, number=number, type=kind, label=FieldDescriptorProto.LABEL_OPTIONAL
        )
        if field in optional:
            added.proto3_optional, added.oneof_index = True, len(message.oneof_decl)
            message.oneof_decl.add(name=f"_{field}")
    pool = DescriptorPool()
    pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName(f"{PACKAGE}.{name}"))


_UINT64 = FieldDescriptorProto.TYPE_UINT64
_INT64 = FieldDescriptorProto.TYPE_INT64
_DOUBLE = FieldDescriptorProto.TYPE_DOUBLE
_STRING = FieldDescriptorProto.TYPE_STRING

ForceMessage = _message(
    "Force", stamp_ns=_INT64, counter=_UINT64, **dict.fromkeys(WRENCH_FIELDS, _DOUBLE)
)
ArmMessage = _message(
    "Arm",
    TCP_FORCE_FIELDS,
    stamp_ns=_INT64,
    controller_time_s=_DOUBLE,
    **dict.fromkeys(ARM_STATES, _INT64),
    **dict.fromkeys(POSE_FIELDS + VELOCITY_FIELDS + TCP_FORCE_FIELDS, _DOUBLE),
)
EventMessage = _message(
    "Event", stamp_ns=_INT64, name=_STRING, trial=_INT64, attempt=_INT64, detail_json=_STRING
)
ImageMessage: Any = CompressedImage

MESSAGES: dict[Topic, Any] = {
    Topic.FORCE: ForceMessage,
    Topic.ARM: ArmMessage,
    Topic.EVENT: EventMessage,
    Topic.IMAGE: ImageMessage,
}


Recorded = ForceSample | ArmSample | ImageFrame | JournalEvent
"""What a stream of a recording consists of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RawMessage:
    """One encoded message."""

    topic: Topic
    log_time: int  # arrival on this host [ns]
    publish_time: int  # the device's own stamp [ns]; ``log_time`` where it has none (MCAP's rule)
    sequence: int  # the device's counter; kept modulo 2^32
    data: bytes
    width: int = 0  # of an image [px]; 0 for the other topics
    height: int = 0  # of an image [px]; 0 for the other topics


def encode(item: Recorded) -> RawMessage:
    """Encode a sample, a frame or an event; JPEG bytes pass through unchanged."""
    fields: dict[str, Any]
    match item:
        case ForceSample():
            topic, fields = Topic.FORCE, {"counter": item.counter}
            fields |= zip(WRENCH_FIELDS, item.wrench, strict=True)
        case ArmSample():
            topic, kept = Topic.ARM, ("controller_time_s", *ARM_STATES)
            fields = {name: getattr(item, name) for name in kept}
            fields |= zip(POSE_FIELDS, item.pose.as_vector(), strict=True)
            fields |= zip(VELOCITY_FIELDS, item.velocity, strict=True)
            fields |= zip(TCP_FORCE_FIELDS, item.tcp_force or (), strict=False)
        case JournalEvent():
            topic = Topic.EVENT
            fields = {name: getattr(item, name) for name in ("name", "trial", "attempt")}
            fields["detail_json"] = json.dumps(to_json(item.detail))
        case ImageFrame():
            return _encoded_frame(item)
    return RawMessage(
        topic=topic,
        log_time=item.stamp_ns,
        publish_time=item.stamp_ns,
        sequence=fields.get("counter", 0),
        data=bytes(MESSAGES[topic](stamp_ns=item.stamp_ns, **fields).SerializeToString()),
    )


def _encoded_frame(frame: ImageFrame) -> RawMessage:
    """Encode a frame; the driver's own stamp becomes MCAP's publish time."""
    message = ImageMessage(frame_id="camera", format=frame.kind, data=frame.jpeg)
    message.timestamp.seconds, message.timestamp.nanos = divmod(frame.stamp_ns, 10**9)
    stamp_s = frame.device_stamp_s
    if stamp_s is None or not 0 <= stamp_s < _LATEST_STAMP_S:
        stamp_s = None
    return RawMessage(
        topic=Topic.IMAGE,
        log_time=frame.stamp_ns,
        publish_time=frame.stamp_ns if stamp_s is None else round(stamp_s * 1e9),
        sequence=frame.counter,
        data=bytes(message.SerializeToString()),
        width=frame.width,
        height=frame.height,
    )


def decode(topic: Topic, data: bytes, *, source: object = "the recording") -> Any:
    """Decode a message; errors name the source."""
    try:
        return MESSAGES[topic].FromString(data)
    except DecodeError as error:
        raise RecordError(
            f"{source}: a message of {topic} does not decode: {error}",
            remedy="the recording was edited, or written by another program",
        ) from error


def decode_event(data: bytes, *, source: object = "the recording") -> JournalEvent:
    """Decode a journal event; errors as for ``decode``."""
    message, source = decode(Topic.EVENT, data, source=source), f"{source}: an event"
    plain = {name: getattr(message, name) for name in ("stamp_ns", "name", "trial", "attempt")}
    plain["detail"] = loads(message.detail_json.encode(), source=source)
    return read_value(JournalEvent, plain, source=source)


def decode_jpeg(data: bytes, *, source: object = "the recording") -> bytes:
    """Return the JPEG bytes of an encoded frame; errors as for ``decode``."""
    return bytes(decode(Topic.IMAGE, data, source=source).data)


logger = logging.getLogger(__name__)

SYNC_PERIOD_S = 1.0
_SEQUENCE_MASK = 0xFFFFFFFF


class _Pending(io.BytesIO):
    """What ``mcap.writer.Writer`` wrote since the last commit, which has ``committed`` bytes."""

    committed = 0

    def tell(self) -> int:
        """Return the offset in the file [bytes] that the next written byte will have."""
        return self.committed + super().tell()


class RecordingWriter:
    """The one writer of a recording; not for use from several threads.

    A message counts as recorded once the call that wrote it has returned. After a RecordError
    nothing of that call is in the file, all before it is, and no more can be written. The file is
    locked, so that nobody repairs it while it is written.

    Args:
        metadata: What this recording is; kept in it as plain text, the record ``tacauchy_rig``.
        chunk_size: Of the file [bytes]; 1 gives each message a chunk of its own.

    Attributes:
        path: The MCAP file.
        message_count: Messages that are with the operating system.

    Raises:
        RecordError: The file exists, the disk is full, or the folder may not be written.
    """

    def __init__(self, path: Path, *, metadata: dict[str, str], chunk_size: int = 1) -> None:
        self.path = path
        self.message_count = 0
        self._hash = hashlib.sha256()
        self._failure: RecordError | None = None
        self._was_reported = False
        self._closed = threading.Event()
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
            self._descriptor = os.open(path, flags, 0o644)
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            sync_folder(path.parent)
        self._syncer = threading.Thread(
            target=self._sync_often, name=f"sync {path.name}", daemon=True
        )
        self._syncer.start()
        self._pending = _Pending()
        self._mcap = Writer(self._pending, chunk_size=chunk_size, compression=CompressionType.NONE)
        self._mcap.start(profile="", library=PACKAGE)
        self._mcap.add_metadata(PACKAGE, metadata)
        self._schemas = {topic: self._register_schema(topic) for topic in Topic}
        self._channels: dict[tuple[Topic, int, int], int] = {}
        for topic in (Topic.FORCE, Topic.ARM, Topic.EVENT):
            self._channel(topic, 0, 0)
        try:
            self._commit()
        except RecordError:
            self.close()
            with contextlib.suppress(OSError):  # it is empty
                path.unlink()
            raise

    @property
    def sha256(self) -> str | None:
        """Of the file so far; None once bytes could not be written."""
        return self._hash.hexdigest() if self._failure is None else None

    def write(self, items: Iterable[Recorded]) -> None:
        """Record samples, frames and events, all or none; RecordError if the disk is full."""
        self.write_raw(map(encode, items))

    def write_raw(self, messages: Iterable[RawMessage]) -> None:
        """Record encoded messages, all or none."""
        encoded = list(messages)
        for message in encoded:
            self._mcap.add_message(
                channel_id=self._channel(message.topic, message.width, message.height),
                log_time=message.log_time,
                publish_time=message.publish_time,
                sequence=message.sequence & _SEQUENCE_MASK,
                data=message.data,
            )
        self._commit()
        self.message_count += len(encoded)

    def close(self) -> None:
        """Write the index that viewers want and bring the file to the disk; safe to call twice.

        After a failed write the file is left unfinished, as after a crash: it stays readable.

        Raises:
            RecordError: The disk is full or gone, and no earlier call has said so; all messages are
                still in the file.
        """
        if self._closed.is_set():
            return
        try:
            if self._failure is None:
                self._mcap.finish()  # type: ignore[no-untyped-call]
                self._commit()
        finally:
            self._closed.set()
            self._syncer.join()
            self._sync()
            os.close(self._descriptor)
        if self._failure is not None and not self._was_reported:
            raise self._failure

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _commit(self) -> None:
        """Hand all that is pending to the kernel; on failure take back what went out of it."""
        if self._failure is not None:
            self._was_reported = True
            raise self._failure
        data = self._pending.getvalue()
        self._pending.seek(0)
        self._pending.truncate(0)
        try:
            view = memoryview(data)
            while view:
                view = view[os.write(self._descriptor, view) :]
        except OSError as error:
            self._failure = write_error(self.path, error)
            self._was_reported = True
            try:
                os.ftruncate(self._descriptor, self._pending.committed)
            except OSError as torn:
                logger.warning("%s: a torn message stays at the end: %s", self.path, torn)
            raise self._failure from error
        self._pending.committed += len(data)
        self._hash.update(data)

    def _sync_often(self) -> None:
        while not self._closed.wait(SYNC_PERIOD_S):
            self._sync()

    def _sync(self) -> None:
        try:
            os.fdatasync(self._descriptor)
        except OSError as error:
            if self._failure is None:
                self._failure = write_error(self.path, error)

    def _register_schema(self, topic: Topic) -> int:
        message = MESSAGES[topic]
        number: int = self._mcap.register_schema(
            name=message.DESCRIPTOR.full_name,
            encoding="protobuf",
            data=build_file_descriptor_set(message).SerializeToString(),
        )
        return number

    def _channel(self, topic: Topic, width: int, height: int) -> int:
        key = (topic, width, height)
        if key not in self._channels:
            self._channels[key] = self._mcap.register_channel(
                topic=topic,
                message_encoding=MessageEncoding.Protobuf,
                schema_id=self._schemas[topic],
                metadata={"width": str(width), "height": str(height)} if width else {},
            )
        return self._channels[key]
