"""What a recording holds: protobuf messages that any MCAP reader can decode.

Images are ``foxglove.CompressedImage``, which viewers show as they are. Force, arm and journal
messages are described here; the description travels inside each recording.
"""

import json
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import ArmSample, ForceSample, ImageFrame, JournalEvent
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
    match item:
        case ForceSample(counter=counter, wrench=wrench):
            values = zip(WRENCH_FIELDS, wrench, strict=True)
            return _encoded(Topic.FORCE, item, counter, counter=counter, **dict(values))
        case ArmSample():
            kept = ("controller_time_s", *ARM_STATES)
            return _encoded(
                Topic.ARM,
                item,
                **{name: getattr(item, name) for name in kept},
                **dict(zip(POSE_FIELDS, item.pose.as_vector(), strict=True)),
                **dict(zip(VELOCITY_FIELDS, item.velocity, strict=True)),
                **dict(zip(TCP_FORCE_FIELDS, item.tcp_force or (), strict=False)),
            )
        case JournalEvent(name=name, trial=trial, attempt=attempt):
            detail = json.dumps(to_json(item.detail))
            return _encoded(
                Topic.EVENT, item, name=name, trial=trial, attempt=attempt, detail_json=detail
            )
        case ImageFrame():
            return _encoded_frame(item)


def _encoded(
    topic: Topic, item: Recorded, sequence: int = 0, /, **fields: float | str
) -> RawMessage:
    message = MESSAGES[topic](stamp_ns=item.stamp_ns, **fields)
    return RawMessage(
        topic=topic,
        log_time=item.stamp_ns,
        publish_time=item.stamp_ns,
        sequence=sequence,
        data=bytes(message.SerializeToString()),
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
