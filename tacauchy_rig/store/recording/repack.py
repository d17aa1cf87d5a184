"""Writing the readable messages of some recordings into one finished file."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from pathlib import Path

from tacauchy_rig.store.recording.mcap_file import McapFile, RawMessage
from tacauchy_rig.store.recording.reading import Recording

CHUNK_SIZE = 4 << 20


def repack(recordings: Sequence[Recording], path: Path) -> list[int]:
    """Write the messages of ``recordings`` to ``path``, in order of arrival, each once.

    Returns:
        How many messages each recording gave; one that an earlier one held already counts there.

    Raises:
        RecordError: ``path`` exists, or the disk is full.
    """
    metadata: dict[str, str] = {}
    for recording in recordings:
        metadata = {**recording.metadata, **metadata}
    counts = [0] * len(recordings)
    file = McapFile(path, metadata=metadata, chunk_size=CHUNK_SIZE)
    try:
        for index, message in _merged(recordings):
            file.add(message)
            file.commit()
            counts[index] += 1
    finally:
        file.close()
    return counts


def _merged(recordings: Sequence[Recording]) -> Iterator[tuple[int, RawMessage]]:
    """Yield (index of the recording, message) by arrival, without what two of them hold.

    Equal messages have equal stamps, so only those of one stamp have to be remembered.
    """
    streams = [_tagged(index, recording) for index, recording in enumerate(recordings)]
    stamp, holders = -1, dict[RawMessage, int]()
    for index, message in heapq.merge(*streams, key=lambda item: item[1].log_time):
        if message.log_time != stamp:
            stamp = message.log_time
            holders.clear()
        if holders.setdefault(message, index) == index:
            yield index, message


def _tagged(index: int, recording: Recording) -> Iterator[tuple[int, RawMessage]]:
    for message in recording.raw_messages():
        yield index, message
