"""Kinds of hostile run folders: each changes a copy of a whole run."""

import io
import json
import os
import shutil
import socket
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from tacauchy_rig.core.run import JournalEvent
from tacauchy_rig.core.simulated import REPLAY_NAME
from tacauchy_rig.core.store.journal import append_event
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.recording.mcap_writer import RawMessage, RecordingWriter, Topic
from tacauchy_rig.core.store.run_files import RunPaths

Change = Callable[[Path, Path, Random], object]
"""Changes a run (first) with the help of what lies outside of it (second)."""
TERABYTE = 1 << 40
_REPLAY = f"replay/{REPLAY_NAME}"
_TRIAL = "trials/01/attempt-1"
_FILES = (
    "run.json",
    "rig.toml",
    "journal.jsonl",
    "expected.json",
    "truth.json",
    "optics.json",
    ".lock",
    "twin.jsonl",
    "watch.html",
    f"{_TRIAL}/recording.mcap",
    f"{_TRIAL}/result.json",
    f"{_REPLAY}/replay.json",
    f"{_REPLAY}/trials/01/image.png",
    "report/summary.json",
    "report/report.html",
    "report/figures/images.pdf",
    "emulation/force_trace.jsonl",
    "logs/control.log",
)
_FOLDERS = ("trials", _TRIAL, "replay", f"{_REPLAY}/trials/01", "report", "report/images", "logs")


def _clear(path: Path) -> Path:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def _link_file(name: str, root: Path, outside: Path, _: Random) -> None:
    _clear(root / name).symlink_to(outside / "secret.txt")


def _link_folder(name: str, root: Path, outside: Path, _: Random) -> None:
    _clear(root / name).symlink_to(outside / "folder")


def _pipe(name: str, root: Path, _outside: Path, _: Random) -> None:
    os.mkfifo(_clear(root / name))


def _sparse(name: str, root: Path, _outside: Path, _: Random) -> None:
    with _clear(root / name).open("wb") as file:
        file.truncate(TERABYTE)


def _write(name: str, content: bytes, root: Path, _outside: Path, _: Random) -> None:
    _clear(root / name).write_bytes(content)


def _fields(name: str, fields: dict[str, Any], root: Path, _outside: Path, _: Random) -> None:
    """Give fields of a JSON file another value; ``a.b`` goes into a table."""
    path = root / name
    content = json.loads(path.read_bytes())
    for place, value in fields.items():
        *tables, last = place.split(".") if name == "run.json" and "/" not in place else [place]
        inner = content
        for table in tables:
            inner = inner[table]
        inner[last.replace("/", ".")] = value
    path.write_text(json.dumps(content), "utf-8", errors="surrogatepass")


def _event(event: str, detail: dict[str, Any], root: Path, _outside: Path, _: Random) -> None:
    path = RunPaths(root).journal
    append_event(path, JournalEvent(stamp_ns=1, name=event, trial=0, attempt=0, detail=detail))


def _name(name: bytes, root: Path, _outside: Path, _: Random) -> None:
    Path(os.fsdecode(os.fsencode(root) + b"/" + name)).mkdir(parents=True)


def _deep(root: Path, _outside: Path, _: Random) -> None:
    (root / "/".join(["d"] * 200)).mkdir(parents=True)


def _hard_link(name: str, root: Path, outside: Path, _: Random) -> None:
    _clear(root / name).hardlink_to(outside / "secret.txt")


def _loop(root: Path, _outside: Path, _: Random) -> None:
    (root / "report" / "again").symlink_to(root)


def _socket(root: Path, _outside: Path, _: Random) -> None:
    descriptor = os.open(root, os.O_RDONLY)
    with socket.socket(socket.AF_UNIX) as end:
        end.bind(f"/proc/self/fd/{descriptor}/s")
    os.close(descriptor)


def _device(root: Path, _outside: Path, _: Random) -> None:
    _clear(root / "report/summary.json").symlink_to("/dev/zero")


def _messages(root: Path, change: Callable[[list[RawMessage]], list[RawMessage]]) -> None:
    """Write the first recording anew, with right checksums."""
    path = RunPaths(root).recording(1, 1)
    recording = Recording.open(path)
    messages = list(recording.raw_messages())
    path.unlink()
    with RecordingWriter(path, metadata=recording.metadata) as writer:
        writer.write_raw(change(messages))


def _garbled(topic: Topic, data: bytes, root: Path, _outside: Path, _: Random) -> None:
    _messages(root, lambda messages: [_with(m, data) if m.topic is topic else m for m in messages])


def _with(message: RawMessage, data: bytes, **changes: Any) -> RawMessage:
    known = {name: getattr(message, name) for name in RawMessage.__slots__}
    return RawMessage(**{**known, "data": data, **changes})


def _bombs(picture: bytes, root: Path, outside: Path, random: Random) -> None:
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

    content = CompressedImage(frame_id="camera", format="jpeg", data=picture).SerializeToString()
    _garbled(Topic.IMAGE, bytes(content), root, outside, random)


def _late(root: Path, _outside: Path, _: Random) -> None:
    _messages(root, lambda messages: [_with(m, m.data, log_time=2**64 - 1) for m in messages])


def _chunks(root: Path, _outside: Path, random: Random) -> None:
    """Bytes that look like thousands of chunks, each as long as the file."""
    size = 6 << 20
    header = struct.pack("<BQQQQIIQ", 6, size // 2 + 40, 0, 0, size // 2, 1, 0, size // 2)
    path = RunPaths(root).recording(1, 1)
    body = (header + random.randbytes(11)) * (size // 64)
    path.write_bytes(path.read_bytes()[:3000] + body)


def _noise(root: Path, _outside: Path, random: Random) -> None:
    path = RunPaths(root).recording(1, 1)
    content = bytearray(path.read_bytes())
    for _ in range(2000):
        content[random.randrange(len(content))] = random.randrange(256)
    path.write_bytes(bytes(content))


def _foreign(root: Path, _outside: Path, _: Random) -> None:
    path = RunPaths(root).recording(1, 1)
    content = path.read_bytes().replace(b"/force", b"/f\xff\xfece")
    path.write_bytes(content)


def png(width: int, height: int) -> bytes:
    """Return a PNG that claims a size, and holds next to nothing."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        crc = zlib.crc32(kind + data)
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", crc)

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    rows = zlib.compress(bytes(1 << 20))
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    )


def _jpeg(width: int, height: int) -> bytes:
    frame = struct.pack(">BBHBHHB", 0xFF, 0xC0, 17, 8, height, width, 3) + bytes(9)
    return b"\xff\xd8" + frame + bytes(100) + b"\xff\xd9"


def _archive(**files: bytes) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(f"{name}.npy", content)
    return buffer.getvalue()


def _array(shape: tuple[int, ...], data: bytes = b"", *, kind: str = "<f8") -> bytes:
    header = repr({"descr": kind, "fortran_order": False, "shape": shape}).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data


def _shapes() -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, position=np.zeros((3, 7)), pressure=np.full(5, np.nan), image=np.zeros(0))
    return buffer.getvalue()


def _nested(depth: int) -> bytes:
    return b'{"a":' * depth + b"1" + b"}" * depth


def all_kinds() -> dict[str, Change]:
    """Return every kind by name."""
    return dict(_all())


def _all() -> Iterator[tuple[str, Change]]:
    for name in _FILES:
        yield f"link: {name}", partial(_link_file, name)
    for name in _FOLDERS:
        yield f"linked folder: {name}", partial(_link_folder, name)
    for name in ("run.json", "journal.jsonl", f"{_TRIAL}/recording.mcap", "report/summary.json"):
        yield f"pipe: {name}", partial(_pipe, name)
        yield f"terabyte: {name}", partial(_sparse, name)
    for name in ("report/report.html", "truth.json", "emulation/force_trace.jsonl"):
        yield f"terabyte: {name}", partial(_sparse, name)
    row = b'{"stamp_ns": "x", "force_true_n": [], "depth_true_m": 1}'
    trace = b"\n".join((b"[]", row, b"\xff\xfe", _nested(9999)))
    yield "emulation: lines of other kinds", partial(_write, "emulation/force_trace.jsonl", trace)
    for name in (".lock", "journal.jsonl", "report/report.html", "report/summary.json"):
        yield f"hard link: {name}", partial(_hard_link, name)
    yield "a link to the run itself", _loop
    yield "a socket", _socket
    yield "a link to /dev/zero", _device
    yield "200 folders deep", _deep
    for what, odd in (
        ("bytes that are no text", b"trials/\xff\xfe"),
        ("a line break", b"replay/a\nb"),
        ("an escape sequence", b"report/\x1b[2J"),
        ("markup", b"replay/<script>1<script>"),
        ("a digit that is no number", "trials/\u00b2".encode()),
        ("a trial of 200 digits", b"trials/" + b"9" * 200 + b"/attempt-1"),
        ("an attempt of 200 digits", b"trials/01/attempt-" + b"9" * 200),
    ):
        yield f"name: {what}", partial(_name, odd)
    for what, content in (
        ("nested 100,000 deep", _nested(100_000)),
        ("nested 900 deep", _nested(900)),
        ("a list", b"[1, 2]"),
        ("half a surrogate pair", b'{"a": "\\ud800"}'),
        ("a number of 4,000 digits", b'{"a": 1' + b"0" * 4000 + b"}"),
        ("nothing", b""),
    ):
        for name in ("run.json", f"{_TRIAL}/result.json", "report/summary.json", "expected.json"):
            yield f"{name}: {what}", partial(_write, name, content)
    yield (
        "journal: a line nested 100,000 deep",
        partial(_write, "journal.jsonl", _nested(100_000) + b"\n"),
    )
    yield "journal: a million empty lines", partial(_write, "journal.jsonl", b"\n" * 1_000_000)
    for event, detail in (
        ("written", {"file": "../../outside/secret.txt", "sha256": "0"}),
        ("written", {"file": "/dev/zero", "sha256": "0"}),
        ("replayed", {"name": "../../outside", "replay_sha256": "0"}),
        ("resume-set", {"changes": ["not a table"]}),
        ("resume-set", {"changes": 7}),
        ("force-check", {"passed": "<script>"}),
    ):
        yield f"journal: {event} {detail}", partial(_event, event, detail)
    fields: dict[str, Any]
    for fields in (
        {"devices": {"robot": "none"}},
        {"devices": {"robot": {"simulated": []}}},
        {"created": "<script>alert(1)</script>"},
        {"versions": 7, "seed": [], "clock": None},
        {"written.sensor/name": "../outside/pipe.toml"},
        {"written.sensor/optics_calibration": "/dev/zero"},
        {"written.sensor/optics_calibration": "../outside/pipe.toml"},
        {"written.run/name": "\u202e<b>x</b>"},
        {"written.protocol/force_targets": ["1e300 N", "2 N"]},
        {"written": {}},
    ):
        yield f"run.json: {fields}", partial(_fields, "run.json", fields)
    for fields in (
        {"force_measured_n": "Infinity", "contact_z_m": "NaN"},
        {"dwell_start_ns": -(2**62), "dwell_end_ns": 2**62},
        {"reference_start_ns": 2**62, "reference_end_ns": -(2**62)},
        {"index": 10**9, "attempt": -1},
        {"rates": {"force_count": 1e300}},
        {"reason": "\x1b[2J<script>"},
        {"force_measured_n": 10**300},
    ):
        yield f"result.json: {fields}", partial(_fields, f"{_TRIAL}/result.json", fields)
    for fields in (
        {"files": {"../../../../outside/secret.txt": "0"}},
        {"made_from": {"/dev/zero": "0", "../secret.txt": "1"}},
        {"trials": []},
        {"name": "../../outside"},
    ):
        yield f"replay.json: {fields}", partial(_fields, f"{_REPLAY}/replay.json", fields)
    for fields in (
        {"passed": "yes"},
        {"trials": 7, "statistics": [], "model": "x"},
        {"trials": [{"index": []}, 7]},
        {"criteria": {"a": 1}},
        {"statistics": {"metrics": {"ssim": {"mean": 1e308, "deviation": 1e308}}}},
        {"verdict": "<script>fetch('http://127.0.0.1:9/')</script>"},
    ):
        yield f"summary.json: {fields}", partial(_fields, "report/summary.json", fields)
    for topic in Topic:
        yield f"recording: {topic} of garbage", partial(_garbled, topic, b"\xff" * 40)
    yield "recording: images of 60,000 x 60,000, PNG", partial(_bombs, png(60_000, 60_000))
    yield "recording: images of 60,000 x 60,000, JPEG", partial(_bombs, _jpeg(60_000, 60_000))
    yield "recording: stamps of 64 bits", _late
    yield "recording: thousands of chunks as long as the file", _chunks
    yield "recording: noise", _noise
    yield "recording: a topic that is no text", _foreign
    yield "recording: empty", partial(_write, f"{_TRIAL}/recording.mcap", b"")
    for what, content in (
        ("a bomb", _archive(height=_array((1 << 28,), bytes(1 << 24)))),
        ("an array of 10^15 numbers", _archive(height=_array((10**15,)))),
        ("a pickle", _archive(height=_array((1,), b"cos\nsystem\n", kind="|O"))),
        ("other shapes", _shapes()),
        ("no archive", b"PK\x03\x04" + bytes(100)),
    ):
        for name in ("height", "fields", "passed"):
            path = f"{_REPLAY}/trials/01/{name}.npz"
            yield f"{name}.npz: {what}", partial(_write, path, content)
    image = f"{_REPLAY}/trials/01/image.png"
    yield "image.png: 60,000 x 60,000", partial(_write, image, png(60_000, 60_000))
    yield "image.png: no picture", partial(_write, image, b"\x89PNG")
    yield "image.png: another size", partial(_write, image, png(3, 5))
