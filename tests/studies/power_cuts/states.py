"""States that a power cut can leave of a recorded run, drawn at random.

Whatever was written more than ``VOLATILE_S`` before the cut is on the disk. Of each file that was
written later, any part may be: cut at any byte, with zeros or stale bytes behind the cut, empty,
missing, or under the name that it has before it gets its own.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import accumulate
from pathlib import Path
from random import Random

from tacauchy_rig.core.store.journal import Journal
from tacauchy_rig.core.store.recording.mcap_reader import Recording, Scan
from tacauchy_rig.core.store.recording.mcap_writer import RecordingWriter
from tacauchy_rig.core.store.run_files import RunPaths, open_file

VOLATILE_S = 3.0
SPILL = "unacknowledged-control.mcap"
_CONNECTING_S = 10.0
"""From a folder's creation to the first line of its journal: devices are connected meanwhile."""
_STORE_EVENTS = ("written", "sealed", "recovered", "cut-off")


@dataclass(frozen=True, kw_only=True)
class Appended:
    """A file that only grows."""

    content: bytes  # at the end
    sizes: tuple[tuple[float, int], ...]  # from when [s] it had how many bytes, ascending

    def size_at(self, time_s: float) -> int:
        """Return its size [bytes]; 0 before it was there."""
        return max((size for since_s, size in self.sizes if since_s <= time_s), default=0)


@dataclass(frozen=True, kw_only=True)
class Replaced:
    """A file that is written whole: what it held from when [s] on, ascending."""

    versions: tuple[tuple[float, bytes], ...]

    def at(self, time_s: float) -> list[bytes]:
        """Return its contents until then, oldest first."""
        return [content for since_s, content in self.versions if since_s <= time_s]


@dataclass(frozen=True, kw_only=True)
class History:
    """How the files of a run came to be."""

    root: Path  # the run
    appended: dict[str, Appended]  # journal and recordings, by name within the run
    replaced: dict[str, Replaced]  # the other files
    moments: tuple[float, ...]  # times of the folder's creation and of the journal's lines [s]
    attempts: dict[tuple[int, int], tuple[float, float]]  # when each began and ended [s]

    @classmethod
    def of(cls, root: Path) -> History:
        """Read a run of which every session ended."""
        paths = RunPaths(root)
        journal = paths.journal.read_bytes()
        lines = Journal.read(paths.journal).lines
        times, last_s = [], 0.0
        begun: dict[tuple[int, int], float] = {}
        attempts: dict[tuple[int, int], tuple[float, float]] = {}
        for line in lines:
            assert line.event is not None
            if line.event.name not in _STORE_EVENTS:
                last_s = line.event.stamp_ns * 1e-9
            times.append(last_s)
            key = (line.event.trial, line.event.attempt)
            if line.event.name == "attempt-start":
                begun[key] = last_s
            elif line.event.name == "attempt-end":
                attempts[key] = (begun[key], last_s)
        ends = accumulate(len(line.raw) + 1 for line in lines)
        first_s = min(begun.values()) - 2.0
        created_s = first_s - _CONNECTING_S
        sizes = tuple((max(time_s, first_s), end) for time_s, end in zip(times, ends, strict=True))
        appended = {"journal.jsonl": Appended(content=journal, sizes=sizes)}
        replaced = {
            "rig.toml": Replaced(versions=((created_s, paths.rig_toml.read_bytes()),)),
            "run.json": Replaced(
                versions=(
                    (created_s, (root / "run.json.previous").read_bytes()),
                    (first_s, paths.run_json.read_bytes()),
                )
            ),
        }
        for key, (start_s, end_s) in attempts.items():
            name = paths.recording(*key).relative_to(root)
            appended[str(name)] = _recorded(root / name, start_s, end_s)
            result = paths.result(*key)
            replaced[str(result.relative_to(root))] = Replaced(
                versions=((end_s, result.read_bytes()),)
            )
        return cls(
            root=root,
            appended=appended,
            replaced=replaced,
            moments=(created_s, *sorted({time_s for time_s, _ in sizes})),
            attempts=attempts,
        )


def _recorded(path: Path, start_s: float, end_s: float) -> Appended:
    with open_file(path, what="the recording") as descriptor:
        scan = Scan(descriptor)
    content = path.read_bytes()
    header = scan.entries[0].offset - 100  # what the writer writes before the first message
    sizes, last_s = [(start_s, max(header, 0))], start_s
    for entry in scan.entries:
        last_s = max(last_s, entry.log_time * 1e-9)
        sizes.append((last_s, entry.offset + entry.length))
    return Appended(content=content, sizes=(*sizes, (end_s, len(content))))


@dataclass(frozen=True, kw_only=True)
class State:
    """What a power cut left."""

    number: int  # which one it is
    cut_s: float  # when the power was cut [s]
    files: dict[str, bytes]  # content by name within the run
    said: tuple[str, ...] = ()  # what is unlike the moment of the cut, in words

    def write(self, history: History, folder: Path) -> Path:
        """Make the run's folder as it was left; return it."""
        root = folder / history.root.name
        for name, content in self.files.items():
            path = root / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        return root


@dataclass
class _Draw:
    history: History
    random: Random
    cut_s: float
    files: dict[str, bytes] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)

    def say(self, name: str, what: str) -> None:
        self.said.append(f"{name}: {what}")

    def append(self, name: str, file: Appended) -> None:
        """Draw what is left of a file that grows."""
        least = file.size_at(self.cut_s - VOLATILE_S)
        most = file.size_at(self.cut_s)
        is_begun = any(since_s <= self.cut_s for since_s, _ in file.sizes)
        if not is_begun:
            return
        if least == most:
            self.files[name] = file.content[:least]
            return
        way = self.random.choice(("kept", "kept", "cut", "cut", "zeros", "stale", "least"))
        if way == "least" and not least:
            self.say(name, "missing")
            return
        end = {"kept": most, "least": least}.get(way, self.random.randint(least, most))
        if way != "kept":
            self.say(name, f"{way}, {end} of {most} bytes")
        behind = {"zeros": bytes(most - end), "stale": self.random.randbytes(most - end)}
        self.files[name] = file.content[:end] + behind.get(way, b"")

    def replace(self, name: str, file: Replaced) -> None:
        """Draw what is left of a file that is written whole."""
        known, before = file.at(self.cut_s), file.at(self.cut_s - VOLATILE_S)
        if not known:
            return
        if len(known) > 1:
            self.files[f"{name}.previous"] = known[-2]
        self.files[name] = known[-1]
        if known == before:
            return
        way = self.random.choice(("kept", "kept", "before", "empty", "cut", "zeros", "unnamed"))
        if way != "kept":
            self.say(name, way)
        whole = known[-1]
        part = whole[: self.random.randrange(len(whole))]
        if way in ("before", "unnamed"):
            del self.files[name]
            if before:
                self.files[name] = before[-1]
            if way == "unnamed":
                place = Path(name)
                self.files[str(place.with_name(f".{place.name}.7.new"))] = part
        elif way in ("empty", "cut", "zeros"):
            left = {"empty": b"", "cut": part, "zeros": part + bytes(len(whole) - len(part))}
            self.files[name] = left[way]

    def spill(self) -> None:
        """Add what a dead recorder's producer left, of this attempt or, wrongly, of the next."""
        running = [k for k, (start_s, _) in self.history.attempts.items() if start_s < self.cut_s]
        if not running or self.random.random() > 0.3:
            return
        own = running[-1]
        start_s = self.history.attempts[own][0]
        folders = [own]
        if len(running) > 1 and start_s + 1.5 < self.cut_s:
            folders.append(running[-2])
        folder = self.random.choice(folders)
        since_s = max(start_s, self.cut_s - VOLATILE_S) if folder == own else start_s + 1.2
        content = _spilled(self.history, own, folder, since_s, self.cut_s)
        way = self.random.choice(("whole", "whole", "cut", "empty"))
        left = {"whole": len(content), "cut": self.random.randrange(len(content)), "empty": 0}
        name = f"{_folder(folder)}/{SPILL}"
        self.files[name] = content[: left[way]]
        self.say(name, way if folder == own else f"{way}, of the next attempt")


def _folder(key: tuple[int, int]) -> str:
    return f"trials/{key[0]:02d}/attempt-{key[1]}"


def _spilled(
    history: History, own: tuple[int, int], folder: tuple[int, int], since_s: float, until_s: float
) -> bytes:
    recording = Recording.open(RunPaths(history.root).recording(*own))
    window = range(round(since_s * 1e9), round(until_s * 1e9) + 1)
    messages = [m for m in recording.raw_messages() if m.log_time in window]
    stated = {"trial": str(folder[0]), "attempt": str(folder[1]), "run": history.root.name}
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / SPILL
        with RecordingWriter(path, metadata=recording.metadata | stated, chunk_size=4096) as writer:
            writer.write_raw(messages)
        return path.read_bytes()


def draw_state(history: History, number: int, *, seed: int) -> State:
    """Draw one state; the same numbers give the same state."""
    random = Random(f"{seed}-{number}")  # noqa: S311
    cut_s = random.choice(history.moments) + random.uniform(0.0, VOLATILE_S)
    draw = _Draw(history, random, cut_s)
    for name, appended in history.appended.items():
        draw.append(name, appended)
    for name, replaced in history.replaced.items():
        draw.replace(name, replaced)
    draw.spill()
    return State(number=number, cut_s=cut_s, files=draw.files, said=tuple(draw.said))


def finished_recordings(root: Path, history: History) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of each recording that its result, as it lies there, tells of."""
    paths = RunPaths(root)
    for key in history.attempts:
        name = str(paths.recording(*key).relative_to(root))
        result = str(paths.result(*key).relative_to(root))
        wanted = (history.appended[name].content, history.replaced[result].versions[-1][1])
        there = (root / name, root / result)
        found = tuple(path.read_bytes() if path.exists() else None for path in there)
        if found == wanted:
            yield name, wanted[0]
