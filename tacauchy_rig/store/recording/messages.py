"""What a recording holds: protobuf messages that any MCAP reader can decode.

Images are ``foxglove.CompressedImage``, which viewers show as they are. Force, arm and journal
messages are described here; the description travels inside each recording.
"""

from __future__ import annotations

import json
from enum import StrEnum
from typing import Any

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass

from tacauchy_rig.run import ArmSample, ForceSample, ImageFrame, JournalEvent
from tacauchy_rig.store.codec import to_json

PACKAGE = "tacauchy_rig"
WRENCH_FIELDS = ("fx_n", "fy_n", "fz_n", "mx_n_m", "my_n_m", "mz_n_m")
POSE_FIELDS = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")
VELOCITY_FIELDS = ("vx_m_s", "vy_m_s", "vz_m_s", "wx_rad_s", "wy_rad_s", "wz_rad_s")
ARM_STATES = ("runtime_state", "safety_bits", "robot_mode")


class Topic(StrEnum):
    """Streams of a recording."""

    FORCE = "/force"
    ARM = "/arm"
    EVENT = "/event"
    IMAGE = "/image"


def _message(name: str, /, **kinds: int) -> Any:
    file = FileDescriptorProto(name=f"{PACKAGE}/{name}.proto", package=PACKAGE, syntax="proto3")
    message = file.message_type.add(name=name)
    for number, (field, kind) in enumerate(kinds.items(), start=1):
        message.field.add(
            name=field,
            number=number,
            type=kind,
            label=FieldDescriptorProto.LABEL_OPTIONAL,
        )
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
    stamp_ns=_INT64,
    controller_time_s=_DOUBLE,
    **dict.fromkeys(ARM_STATES, _INT64),
    **dict.fromkeys(POSE_FIELDS + VELOCITY_FIELDS, _DOUBLE),
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


def encode_force(sample: ForceSample) -> bytes:
    """Encode a force sample."""
    values = (*sample.wrench.force, *sample.wrench.torque)
    message = ForceMessage(
        stamp_ns=sample.stamp_ns,
        counter=sample.counter,
        **dict(zip(WRENCH_FIELDS, values, strict=True)),
    )
    return bytes(message.SerializeToString())


def encode_arm(sample: ArmSample) -> bytes:
    """Encode a state of the arm."""
    message = ArmMessage(
        stamp_ns=sample.stamp_ns,
        controller_time_s=sample.controller_time_s,
        runtime_state=sample.runtime_state,
        safety_bits=sample.safety_bits,
        robot_mode=sample.robot_mode,
        **dict(zip(POSE_FIELDS, sample.pose.as_vector(), strict=True)),
        **dict(zip(VELOCITY_FIELDS, sample.velocity, strict=True)),
    )
    return bytes(message.SerializeToString())


def encode_event(event: JournalEvent) -> bytes:
    """Encode a journal event."""
    message = EventMessage(
        stamp_ns=event.stamp_ns,
        name=event.name,
        trial=event.trial,
        attempt=event.attempt,
        detail_json=json.dumps(to_json(event.detail)),
    )
    return bytes(message.SerializeToString())


def decode_event(data: bytes) -> JournalEvent:
    """Decode a journal event."""
    message = EventMessage.FromString(data)
    return JournalEvent(
        stamp_ns=message.stamp_ns,
        name=message.name,
        trial=message.trial,
        attempt=message.attempt,
        detail=json.loads(message.detail_json),
    )


def encode_image(frame: ImageFrame) -> bytes:
    """Encode a frame; its JPEG bytes pass through unchanged."""
    seconds, nanoseconds = divmod(frame.stamp_ns, 10**9)
    message = ImageMessage(frame_id="camera", format="jpeg", data=frame.jpeg)
    message.timestamp.seconds = seconds
    message.timestamp.nanos = nanoseconds
    return bytes(message.SerializeToString())


def decode_jpeg(data: bytes) -> bytes:
    """Return the JPEG bytes of an encoded frame."""
    return bytes(ImageMessage.FromString(data).data)
