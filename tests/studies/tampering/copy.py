"""A copy of a run, and ways to change its files that follow up hashes or do not."""

from __future__ import annotations

import hashlib
import json
import shutil
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode

from tacauchy_rig.core.store.atomic_write import bytes_sha256
from tacauchy_rig.core.store.journal import StoreEvent
from tacauchy_rig.core.store.json_codec import dumps
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.recording.mcap_writer import RawMessage, RecordingWriter
from tacauchy_rig.core.store.run_files import RunPaths
from tacauchy_rig.core.store.run_store import RunStore

Messages = list[RawMessage]
Json = dict[str, Any]

_RECORD_HEADER = struct.Struct("<BQ")  # opcode and length of an MCAP record
_MAGIC_BYTES = 8
_CHUNK_CRC, _CHUNK_RECORDS = 24, 40  # where they begin in a chunk that is not compressed
_MESSAGE_HEADER_BYTES = 22
_FOOTER_CRC_FROM_END = 12  # of the file: the CRC and the last magic bytes


class Care(StrEnum):
    """How far whoever changes a file follows it up.

    Attributes:
        BYTES: Only the bytes are changed, as an editor or a failing disk does.
        CHECKSUMS: The checksums and the chain within the changed file are right again.
        RESEALED: So are the hashes of it in every other file, and the whole chain.
    """

    BYTES = "bytes"
    CHECKSUMS = "checksums"
    RESEALED = "resealed"


@dataclass(frozen=True)
class RunCopy:
    """A copy of a run folder that may be spoilt."""

    root: Path  # the copy
    care: Care  # how far changes are followed up

    @classmethod
    def of(cls, run: Path, parent: Path, care: Care) -> RunCopy:
        """Copy a run into ``parent``, where its folder has the same name."""
        root = parent / run.name
        shutil.copytree(run, root, ignore=shutil.ignore_patterns("report", "logs", ".lock"))
        return cls(root, care)

    @property
    def paths(self) -> RunPaths:
        """Where everything lies."""
        return RunPaths(self.root)

    @property
    def replay(self) -> Path:
        """The folder of its only replay."""
        return next(path.parent for path in self.paths.replays.glob("*/replay.json"))

    def attempt(self, trial: int) -> int:
        """Return the attempt at a trial that counts."""
        record = RunStore.open(self.root).counting(trial)
        return 1 if record is None else record.attempt

    def recording(self, trial: int) -> Path:
        """Return the recording of a trial that counts."""
        return self.paths.recording(trial, self.attempt(trial))

    def result(self, trial: int) -> Path:
        """Return the result of a trial that counts."""
        return self.paths.result(trial, self.attempt(trial))

    def change_messages(
        self, trial: int, change: Callable[[Messages], Messages], /, **metadata: str
    ) -> None:
        """Write a recording anew with other messages, and with other metadata where given."""
        path = self.recording(trial)
        recording = Recording.open(path)
        before = list(recording.raw_messages())
        path.unlink()
        with RecordingWriter(path, metadata=recording.metadata | metadata) as writer:
            writer.write_raw(change(before))
        if self.care is Care.BYTES:
            _spoil_checksums(path, {message.data for message in before})

    def change_json(self, path: Path, fields: Callable[[Json], Json]) -> None:
        """Give fields of a JSON file another value, made from its content."""
        content = json.loads(path.read_bytes())
        path.write_bytes(dumps(content | fields(content)))

    def change_journal(self, change: Callable[[list[Json]], list[Json]]) -> None:
        """Change the lines of the journal, without their numbers and hashes."""
        lines = [json.loads(line) for line in self.paths.journal.read_bytes().splitlines()]
        self.write_journal(change(lines), chained=self.care is not Care.BYTES)

    def write_journal(self, lines: Sequence[Json], *, chained: bool) -> None:
        """Write the journal, its lines numbered and chained anew or as they were."""
        content, before = [], ""
        for number, line in enumerate(lines, start=1):
            link = {"number": number, "previous": before} if chained else {}
            raw = json.dumps({**line, **link}, ensure_ascii=False).encode()
            content.append(raw + b"\n")
            before = bytes_sha256(raw)
        self.paths.journal.write_bytes(b"".join(content))

    def reseal(self) -> None:
        """Make every hash right again that can be made right without knowing the content."""
        for key in self.paths.attempts():
            recording, result = self.paths.recording(*key), self.paths.result(*key)
            if recording.exists() and result.exists():
                known = {"recording_sha256": _sha256(recording)}
                self.change_json(result, lambda _, known=known: known)  # type: ignore[misc]
        self._reseal_replays()
        if self.paths.journal.exists():
            raw = self.paths.journal.read_bytes().splitlines()
            lines = [json.loads(line) for line in raw if _is_json(line)]
            self.write_journal([self._resealed(line) for line in lines], chained=True)

    def _reseal_replays(self) -> None:
        for path in self.paths.replays.glob("*/replay.json"):
            bases = {"made_from": self.root, "files": path.parent}

            def hashes(replay: Json, bases: dict[str, Path] = bases) -> Json:
                return {
                    field: {
                        n: _sha256(base / n) if (base / n).is_file() else known
                        for n, known in replay[field].items()
                    }
                    for field, base in bases.items()
                }

            self.change_json(path, hashes)

    def _resealed(self, line: Json) -> Json:
        """Return a line of the journal with the hashes of the files as they are now."""
        key, detail = (line["trial"], line["attempt"]), dict(line["detail"])
        for name, field, path in (
            (StoreEvent.SEALED, "result_sha256", self.paths.result(*key)),
            (StoreEvent.SEALED, "recording_sha256", self.paths.recording(*key)),
            (StoreEvent.WRITTEN, "sha256", self.root / str(detail.get("file"))),
            (StoreEvent.REPLAYED, "replay_sha256", self.paths.replay_json(str(detail.get("name")))),
        ):
            if line["name"] == name and path.is_file():
                detail[field] = _sha256(path)
        return {**line, "detail": detail}


def exchange(first: Path, second: Path) -> None:
    """Give each of two files the other's content."""
    content = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(content)


def _spoil_checksums(path: Path, known: set[bytes]) -> None:
    """Leave wrong checksums where a message is new, and in the index where messages are gone."""
    content = bytearray(path.read_bytes())
    kept = 0
    for start, end in list(_records(content, _MAGIC_BYTES, len(content), Opcode.CHUNK)):
        messages = list(_records(content, start + _CHUNK_RECORDS, end, Opcode.MESSAGE))
        if any(bytes(content[m + _MESSAGE_HEADER_BYTES : e]) not in known for m, e in messages):
            content[start + _CHUNK_CRC] ^= 1
        else:
            kept += len(messages)
    if kept < len(known):
        content[-_FOOTER_CRC_FROM_END] ^= 1
    path.write_bytes(content)


def _records(content: bytearray, start: int, end: int, kind: int) -> Iterator[tuple[int, int]]:
    """Yield where the bodies of the records of one kind begin and end."""
    while start + _RECORD_HEADER.size <= end:
        opcode, length = _RECORD_HEADER.unpack_from(content, start)
        start += _RECORD_HEADER.size
        if opcode == kind:
            yield start, start + length
        start += length


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _is_json(line: bytes) -> bool:
    try:
        json.loads(line)
    except ValueError:
        return False
    return True
