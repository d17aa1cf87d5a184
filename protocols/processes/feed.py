"""Feeds: what viewers of a run are shown while it runs. Nobody ever waits for a viewer.

The record loses nothing; a feed may. A producer says a few numbers under a stream's name, with or
without a picture. Numbers go through a channel that never blocks, pictures through memory that both
processes see and in which new ones overwrite old ones. What a viewer was too slow for is counted.
"""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from protocols.processes.messages import Channel

VIEWERS = ("page", "twin", "foxglove")
"""Processes that may watch a run."""
PICTURES_BYTES = 16 << 20
_CLAIMED = struct.Struct("=Q")


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """Something that a viewer is shown.

    Attributes:
        stream: Its name, such as ``force``, ``arm``, ``camera``, ``twin``.
        stamp_ns: ``time.monotonic_ns`` of what it tells of.
        numbers: Plain values, lists and texts; units in the keys.
        picture: Bytes of a JPEG or PNG; None where there is none, or it was overwritten already.
    """

    stream: str
    stamp_ns: int
    numbers: dict[str, Any]
    picture: bytes | None = None


class Pictures:
    """Memory of two processes into which pictures are written round and round.

    Positions count on for ever. How far memory has been claimed stands at its begin and is raised
    before anything is written, so a reader knows afterwards whether what it copied was whole.
    """

    def __init__(self, descriptor: int) -> None:
        self._memory = mmap.mmap(descriptor, os.fstat(descriptor).st_size)
        self._capacity = len(self._memory) - _CLAIMED.size

    def write(self, picture: bytes) -> int | None:
        """Return where the picture begins; None where it is too large."""
        size = len(picture)
        if size > self._capacity // 2:
            return None
        start = self._claimed()
        if start % self._capacity + size > self._capacity:  # no picture is split
            start += self._capacity - start % self._capacity
        _CLAIMED.pack_into(self._memory, 0, start + size)
        place = _CLAIMED.size + start % self._capacity
        self._memory[place : place + size] = picture
        return start

    def read(self, start: int, size: int) -> bytes | None:
        """Return a picture; None where it is overwritten already."""
        place = _CLAIMED.size + start % self._capacity
        picture = self._memory[place : place + size]
        return picture if self._claimed() - start <= self._capacity else None

    def _claimed(self) -> int:
        return int(_CLAIMED.unpack_from(self._memory)[0])


class FeedWriter:
    """A producer's end: ``show`` never blocks and never raises."""

    def __init__(self, descriptors: Mapping[str, int], *, to: str) -> None:
        self._channel, self._pictures = _inherited(descriptors, to)
        self._number = 0

    def show(
        self, stream: str, stamp_ns: int, numbers: dict[str, Any], picture: bytes | None = None
    ) -> bool:
        """Show something; return False where the viewer is too slow or gone."""
        start = None if picture is None else self._pictures.write(picture)
        size = 0 if picture is None or start is None else len(picture)
        self._number += 1
        return self._channel.send((self._number, stream, stamp_ns, numbers, start or 0, size))


class FeedReader:
    """A viewer's end.

    Attributes:
        lost_count: Messages and pictures that this viewer was too slow for.
    """

    def __init__(self, descriptors: Mapping[str, int], *, source: str) -> None:
        self._channel, self._pictures = _inherited(descriptors, source)
        self.fileno = self._channel.fileno
        self._number: int | None = None
        self.lost_count = 0

    def receive(self) -> list[Shown]:
        """Return what waits, oldest first."""
        return [self._shown(*sent) for sent in self._channel.receive()]

    def _shown(
        self,
        number: int,
        stream: str,
        stamp_ns: int,
        numbers: dict[str, Any],
        start: int,
        size: int,
    ) -> Shown:
        if self._number is not None:
            self.lost_count += number - self._number - 1
        self._number = number
        picture = self._pictures.read(start, size) if size else None
        self.lost_count += bool(size and picture is None)
        return Shown(stream=stream, stamp_ns=stamp_ns, numbers=numbers, picture=picture)


def feed_readers(descriptors: Mapping[str, int], sources: Iterable[str]) -> list[FeedReader]:
    """Return the ends that the parent process left open, of those of ``sources`` that run."""
    return [
        FeedReader(descriptors, source=each) for each in sources if f"{each}-feed" in descriptors
    ]


class FeedWriters:
    """A producer's ends to every viewer; none is as good as any."""

    def __init__(self, descriptors: Mapping[str, int], viewers: Iterable[str]) -> None:
        self._writers = [
            FeedWriter(descriptors, to=each) for each in viewers if f"{each}-feed" in descriptors
        ]

    def __bool__(self) -> bool:
        return bool(self._writers)

    def show(
        self, stream: str, stamp_ns: int, numbers: dict[str, Any], picture: bytes | None = None
    ) -> None:
        """Show something to each viewer."""
        for writer in self._writers:
            writer.show(stream, stamp_ns, numbers, picture)


class FeedLines:
    """Feeds between processes, kept open by the supervisor so that a viewer can be started anew.

    Args:
        pairs: (producer, viewer) by their names.
    """

    def __init__(self, pairs: Iterable[tuple[str, str]]) -> None:
        self._ends: dict[str, dict[str, int]] = {}
        self._kept: list[Channel] = []
        self._memories: list[int] = []
        for producer, viewer in pairs:
            theirs, ours = Channel.pair()
            memory = os.memfd_create(f"{producer}-{viewer}")
            os.truncate(memory, PICTURES_BYTES + _CLAIMED.size)
            self._kept += [theirs, ours]
            self._memories.append(memory)
            for one, other, end in ((producer, viewer, theirs), (viewer, producer, ours)):
                self._ends.setdefault(one, {}).update(
                    {f"{other}-feed": end.fileno(), f"{other}-pictures": memory}
                )

    def descriptors(self, name: str) -> dict[str, int]:
        """Return what a process has to inherit, by what it leads to."""
        return dict(self._ends.get(name, {}))

    def close(self) -> None:
        """Close every end here."""
        for channel in self._kept:
            channel.close()
        for memory in self._memories:
            os.close(memory)
        self._ends, self._kept, self._memories = {}, [], []


def _inherited(descriptors: Mapping[str, int], other: str) -> tuple[Channel, Pictures]:
    channel = Channel.inherited(descriptors[f"{other}-feed"])
    return channel, Pictures(descriptors[f"{other}-pictures"])
