"""Writing one attempt's streams so that nothing acknowledged is lost, whatever dies.

Every message is a chunk of its own and is with the operating system before the call returns, so
killing this process loses nothing; a thread brings the file to the disk each second, so losing
power loses about that second. The file is an MCAP of four topics, described inside it, without
compression.
"""

import contextlib
import fcntl
import hashlib
import io
import logging
import os
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import Self

from mcap.well_known import MessageEncoding
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.atomic_write import sync_folder, write_error, writing
from tacauchy_rig.core.store.recording.mcap_messages import (
    MESSAGES,
    PACKAGE,
    RawMessage,
    Recorded,
    Topic,
    encode,
)

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
