"""Writing one attempt's streams so that nothing acknowledged is lost, whatever dies.

Every message is a chunk of its own and is with the operating system before the call returns, so
killing this process loses nothing; a thread brings the file to the disk each second, so losing
power loses about that second. The file is an MCAP of four topics, described inside it, without
compression.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import logging
import os
import threading
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import IO, Self, cast

from mcap.well_known import MessageEncoding
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.durable import sync_folder, write_error
from tacauchy_rig.core.store.recording.messages import (
    MESSAGES,
    PACKAGE,
    RawMessage,
    Recorded,
    Topic,
    encode,
)

logger = logging.getLogger(__name__)

SYNC_PERIOD_S = 1.0


class AppendFile:
    """What ``mcap.writer.Writer`` writes to: ``write`` gathers, ``commit`` hands to the kernel.

    A thread brings the file to the disk every ``SYNC_PERIOD_S``. The file is locked, so that
    nobody repairs it while it is written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._parts: list[bytes] = []
        self._pending = 0
        self._committed = 0
        self._hash = hashlib.sha256()
        self._failure: RecordError | None = None
        self._was_reported = False
        self._ended = threading.Event()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
            self._descriptor = os.open(path, flags, 0o644)
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            sync_folder(path.parent)
        except OSError as error:
            raise write_error(path, error) from error
        self._syncer = threading.Thread(
            target=self._sync_often, name=f"sync {path.name}", daemon=True
        )
        self._syncer.start()

    @property
    def is_closed(self) -> bool:
        """True after ``close``."""
        return self._ended.is_set()

    @property
    def has_failed(self) -> bool:
        """True once bytes could not be written; nothing is written after that."""
        return self._failure is not None

    @property
    def sha256(self) -> str | None:
        """Of all that was committed; None once bytes could not be written."""
        return None if self.has_failed else self._hash.hexdigest()

    def write(self, data: bytes) -> int:
        """Gather bytes for the next commit."""
        self._parts.append(data)
        self._pending += len(data)
        return len(data)

    def tell(self) -> int:
        """Return the offset [bytes] that the next written byte will have."""
        return self._committed + self._pending

    def flush(self) -> None:
        """Do nothing: only ``commit`` hands bytes over."""

    def commit(self) -> None:
        """Hand all gathered bytes to the kernel; on failure take back what went out of them.

        Raises:
            RecordError: The disk is full or gone, now or since the last call.
        """
        if self._failure is not None:
            self._was_reported = True
            raise self._failure
        data = b"".join(self._parts)
        self._parts.clear()
        self._pending = 0
        try:
            view = memoryview(data)
            while view:
                view = view[os.write(self._descriptor, view) :]
        except OSError as error:
            self._failure = write_error(self.path, error)
            self._was_reported = True
            self._take_back()
            raise self._failure from error
        self._committed += len(data)
        self._hash.update(data)

    def close(self) -> None:
        """Bring the file to the disk and close it; safe to call twice.

        Raises:
            RecordError: The disk refused, and no earlier call has said so.
        """
        if self.is_closed:
            return
        self._ended.set()
        self._syncer.join()
        try:
            self._sync()
        finally:
            os.close(self._descriptor)
        if self._failure is not None and not self._was_reported:
            raise self._failure

    def _take_back(self) -> None:
        try:
            os.ftruncate(self._descriptor, self._committed)
        except OSError as error:
            logger.warning("%s: a torn message stays at the end: %s", self.path, error)

    def _sync_often(self) -> None:
        while not self._ended.wait(SYNC_PERIOD_S):
            self._sync()

    def _sync(self) -> None:
        try:
            os.fdatasync(self._descriptor)
        except OSError as error:
            if self._failure is None:
                self._failure = write_error(self.path, error)


_SEQUENCE_MASK = 0xFFFFFFFF


class RecordingWriter:
    """The one writer of a recording; not for use from several threads.

    A message counts as recorded once the call that wrote it has returned. After a RecordError
    nothing of that call is in the file, all before it is, and no more can be written.

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
        self._file = AppendFile(path)
        stream = cast("IO[bytes]", self._file)
        self._mcap = Writer(stream, chunk_size=chunk_size, compression=CompressionType.NONE)
        self._mcap.start(profile="", library=PACKAGE)
        self._mcap.add_metadata(PACKAGE, metadata)
        self._schemas = {topic: self._register_schema(topic) for topic in Topic}
        self._channels: dict[tuple[Topic, int, int], int] = {}
        for topic in (Topic.FORCE, Topic.ARM, Topic.EVENT):
            self._channel(topic, 0, 0)
        try:
            self._file.commit()
        except RecordError:
            self._file.close()
            with contextlib.suppress(OSError):  # it is empty
                path.unlink()
            raise

    @property
    def sha256(self) -> str | None:
        """Of the file so far; None once bytes could not be written."""
        return self._file.sha256

    def write(self, items: Iterable[Recorded]) -> None:
        """Record samples, frames and events, all or none.

        Raises:
            RecordError: The disk is full or gone.
        """
        self.write_raw(map(encode, items))

    def write_raw(self, messages: Iterable[RawMessage]) -> None:
        """Record encoded messages, all or none.

        Raises:
            RecordError: The disk is full or gone.
        """
        encoded = list(messages)
        for message in encoded:
            self._mcap.add_message(
                channel_id=self._channel(message.topic, message.width, message.height),
                log_time=message.log_time,
                publish_time=message.publish_time,
                sequence=message.sequence & _SEQUENCE_MASK,
                data=message.data,
            )
        self._file.commit()
        self.message_count += len(encoded)

    def close(self) -> None:
        """Write the index that viewers want and bring the file to the disk; safe to call twice.

        After a failed write the file is left unfinished, as after a crash: it stays readable.

        Raises:
            RecordError: The disk is full or gone; all messages are still in the file.
        """
        if self._file.is_closed:
            return
        try:
            if not self._file.has_failed:
                self._mcap.finish()  # type: ignore[no-untyped-call]
                self._file.commit()
        finally:
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

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
