"""Feeds: what viewers of a run are shown while it runs. Nobody ever waits for a viewer.

The record loses nothing; a feed may. A producer says a few numbers under a stream's name, with or
without a picture, through a channel that never blocks; a picture is a file in memory that goes with
its message. What a viewer was too slow for is counted.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from protocols.processes.messages import Channel

VIEWERS = ("page", "twin", "foxglove")
"""Processes that may watch a run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """Something that a viewer is shown."""

    stream: str  # its name, such as ``force``, ``arm``, ``camera``, ``twin``
    stamp_ns: int  # ``time.monotonic_ns`` of what it tells of
    numbers: dict[str, Any]  # plain values, lists and texts; units in the keys
    picture: bytes | None = None  # bytes of a JPEG or PNG; None where there is none


class FeedWriters:
    """A producer's ends to those of ``viewers`` that run; ``show`` neither blocks nor raises."""

    def __init__(self, descriptors: Mapping[str, int], viewers: Iterable[str]) -> None:
        self._channels = _inherited(descriptors, viewers)
        self._number = 0

    def __bool__(self) -> bool:
        return bool(self._channels)

    def show(
        self, stream: str, stamp_ns: int, numbers: dict[str, Any], picture: bytes | None = None
    ) -> None:
        """Show something to each viewer; one that is too slow or gone misses it."""
        self._number += 1
        shown = Shown(stream=stream, stamp_ns=stamp_ns, numbers=numbers)
        message = self._number, shown, picture is not None
        if picture is None:
            self._send(message)
            return
        try:
            with os.fdopen(os.memfd_create("picture"), "wb", buffering=0) as file:
                file.write(picture)
                self._send(message, file.fileno())
        except OSError:  # no memory for it
            self._send(message)

    def _send(self, message: tuple[int, Shown, bool], file: int | None = None) -> None:
        for channel in self._channels:
            channel.send(message, file=file)


class FeedReader:
    """A viewer's end."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self.fileno = channel.fileno
        self._number: int | None = None
        self.lost_count = 0  # messages and pictures that this viewer was too slow for

    def receive(self) -> Iterator[Shown]:
        """Yield what waits, oldest first."""
        for (number, shown, has_picture), files in self._channel.receive_with_files():
            if self._number is not None:
                self.lost_count += number - self._number - 1
            self._number = number
            self.lost_count += has_picture and not files
            for file in files:
                # Other viewers share the file and its position.
                shown = replace(shown, picture=os.pread(file, os.fstat(file).st_size, 0))
                os.close(file)
            yield shown


def feed_readers(descriptors: Mapping[str, int], sources: Iterable[str]) -> list[FeedReader]:
    """Return the ends that the parent process left open, of those of ``sources`` that run."""
    return [FeedReader(channel) for channel in _inherited(descriptors, sources)]


def _inherited(descriptors: Mapping[str, int], others: Iterable[str]) -> list[Channel]:
    ends = (descriptors.get(f"{other}-feed") for other in others)
    return [Channel.inherited(end) for end in ends if end is not None]


class FeedLines:
    """Feeds between processes, kept open by the supervisor so that a viewer can be started anew.

    Args:
        pairs: (producer, viewer) by their names.
    """

    def __init__(self, pairs: Iterable[tuple[str, str]]) -> None:
        self._ends: dict[str, dict[str, Channel]] = {}
        for producer, viewer in pairs:
            theirs, ours = Channel.pair()
            self._ends.setdefault(producer, {})[f"{viewer}-feed"] = theirs
            self._ends.setdefault(viewer, {})[f"{producer}-feed"] = ours

    def descriptors(self, name: str) -> dict[str, int]:
        """Return what a process has to inherit, by what it leads to."""
        return {what: end.fileno() for what, end in self._ends.get(name, {}).items()}

    def close(self) -> None:
        """Close every end here."""
        for ends in self._ends.values():
            for end in ends.values():
                end.close()
