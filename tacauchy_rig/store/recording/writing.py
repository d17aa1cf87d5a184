"""Writing one attempt's streams so that nothing acknowledged is lost, whatever dies.

Every message is a chunk of its own and is with the operating system before the call returns, so
killing this process loses nothing; a thread brings the file to the disk each second, so losing
power loses about that second.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from tacauchy_rig.run import ArmSample, ForceSample, ImageFrame, JournalEvent
from tacauchy_rig.store.recording.mcap_file import McapFile, RawMessage
from tacauchy_rig.store.recording.messages import (
    Topic,
    encode_arm,
    encode_event,
    encode_force,
    encode_image,
)


class RecordingWriter:
    """The one writer of a recording; not for use from several threads.

    A message counts as recorded once the call that wrote it has returned. After a RecordError
    nothing of that call is in the file, all before it is, and no more can be written.

    Args:
        metadata: What this recording is; kept in it as plain text.

    Attributes:
        path: The MCAP file.
        message_count: Messages that are with the operating system.

    Raises:
        RecordError: The file exists, the disk is full, or the folder may not be written.
    """

    def __init__(self, path: Path, *, metadata: dict[str, str]) -> None:
        self.path = path
        self.message_count = 0
        self._file = McapFile(path, metadata=metadata, chunk_size=1)

    def write_force(self, samples: Sequence[ForceSample]) -> None:
        """Record force samples, all or none.

        Raises:
            RecordError: The disk is full or gone.
        """
        self._write(
            [
                _message(Topic.FORCE, sample.stamp_ns, encode_force(sample), sample.counter)
                for sample in samples
            ]
        )

    def write_arm(self, samples: Sequence[ArmSample]) -> None:
        """Record states of the arm, all or none.

        Raises:
            RecordError: The disk is full or gone.
        """
        self._write(
            [_message(Topic.ARM, sample.stamp_ns, encode_arm(sample), 0) for sample in samples]
        )

    def write_frame(self, frame: ImageFrame) -> None:
        """Record a frame; the driver's own stamp becomes MCAP's publish time.

        Raises:
            RecordError: The disk is full or gone.
        """
        message = RawMessage(
            topic=Topic.IMAGE,
            log_time=frame.stamp_ns,
            publish_time=_publish_time_ns(frame),
            sequence=frame.counter,
            data=encode_image(frame),
            width=frame.width,
            height=frame.height,
        )
        self._write([message])

    def write_event(self, event: JournalEvent) -> None:
        """Record a journal event beside the streams.

        Raises:
            RecordError: The disk is full or gone.
        """
        self._write([_message(Topic.EVENT, event.stamp_ns, encode_event(event), 0)])

    def close(self) -> None:
        """Write the index that viewers want and bring the file to the disk; safe to call twice.

        After a failed write the file is left unfinished, as after a crash: it stays readable.

        Raises:
            RecordError: The disk is full or gone; all messages are still in the file.
        """
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

    def _write(self, messages: list[RawMessage]) -> None:
        for message in messages:
            self._file.add(message)
        self._file.commit()
        self.message_count += len(messages)


def _message(topic: Topic, stamp_ns: int, data: bytes, counter: int) -> RawMessage:
    return RawMessage(
        topic=topic, log_time=stamp_ns, publish_time=stamp_ns, sequence=counter, data=data
    )


def _publish_time_ns(frame: ImageFrame) -> int:
    stamp = frame.device_stamp_s
    if stamp is None or not 0 <= stamp < 1e9:
        return frame.stamp_ns
    return round(stamp * 1e9)
