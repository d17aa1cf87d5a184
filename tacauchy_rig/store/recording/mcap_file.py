"""The MCAP file under a recording: four topics, described inside the file, no compression."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import IO, cast

from mcap.well_known import MessageEncoding
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from tacauchy_rig.store.recording.append_file import AppendFile
from tacauchy_rig.store.recording.messages import MESSAGES, PACKAGE, Topic

_SEQUENCE_MASK = 0xFFFFFFFF


@dataclass(frozen=True, slots=True, kw_only=True)
class RawMessage:
    """One encoded message.

    Attributes:
        log_time: Arrival on this host [ns].
        publish_time: The device's own stamp [ns]; ``log_time`` where it has none (MCAP's rule).
        sequence: The device's counter; kept modulo 2^32.
        width: Of an image [px]; 0 for the other topics.
        height: Of an image [px]; 0 for the other topics.
    """

    topic: Topic
    log_time: int
    publish_time: int
    sequence: int
    data: bytes
    width: int = 0
    height: int = 0


class McapFile:
    """A new MCAP file. What was added is with the kernel once ``commit`` has returned.

    Args:
        metadata: Becomes the metadata record ``tacauchy_rig``.
        chunk_size: 1 gives each message a chunk of its own, so that ``commit`` hands it over.

    Raises:
        RecordError: The file exists, or cannot be created.
    """

    def __init__(self, path: Path, *, metadata: dict[str, str], chunk_size: int) -> None:
        self._file = AppendFile(path)
        stream = cast("IO[bytes]", self._file)
        self._mcap = Writer(stream, chunk_size=chunk_size, compression=CompressionType.NONE)
        self._mcap.start(profile="", library=PACKAGE)
        self._mcap.add_metadata(PACKAGE, metadata)
        self._schemas = {topic: self._register_schema(topic) for topic in Topic}
        self._channels: dict[tuple[Topic, int, int], int] = {}
        for topic in (Topic.FORCE, Topic.ARM, Topic.EVENT):
            self._channel(topic, 0, 0)
        self.commit()

    def add(self, message: RawMessage) -> None:
        """Add a message to the next commit."""
        self._mcap.add_message(
            channel_id=self._channel(message.topic, message.width, message.height),
            log_time=message.log_time,
            publish_time=message.publish_time,
            sequence=message.sequence & _SEQUENCE_MASK,
            data=message.data,
        )

    def commit(self) -> None:
        """Hand over what was added, all or nothing.

        Raises:
            RecordError: The disk is full or gone; no more can be written.
        """
        self._file.commit()

    def close(self) -> None:
        """Write the index and bring the file to the disk; safe to call twice.

        After a failed write the file is left unfinished, as after a crash: it stays readable.

        Raises:
            RecordError: The disk is full or gone; all committed messages are in the file.
        """
        if self._file.is_closed:
            return
        try:
            if not self._file.has_failed:
                self._mcap.finish()  # type: ignore[no-untyped-call]
                self._file.commit()
        finally:
            self._file.close()

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
