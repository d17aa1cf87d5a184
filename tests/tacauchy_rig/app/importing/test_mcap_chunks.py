"""Chunks of an MCAP file are bounded before anything unpacks them."""

from __future__ import annotations

import struct
from pathlib import Path

import lz4.frame
import pytest
from backports import zstd
from rosbags.rosbag2 import StoragePlugin

from tacauchy_rig.app.importing.bag import CHUNK_BYTES, MAGIC, check_chunks
from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.run_store import RunStore
from tests.tacauchy_rig.app.importing.sources import write_bag

VAST = bytes(64 * 2**20)


def chunk(said: int, packing: bytes, packed: bytes) -> bytes:
    """Return a chunk's record."""
    head = struct.pack("<QQQII", 0, 0, said, 0, len(packing)) + packing
    data = head + struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", 6, len(data)) + data


@pytest.mark.parametrize(
    ("record", "told"),
    [
        (chunk(CHUNK_BYTES + 1, b"", b""), f"unpacks to {CHUNK_BYTES + 1} bytes"),
        (chunk(100, b"lz4", lz4.frame.compress(VAST)), "100 bytes and goes on"),
        (chunk(100, b"zstd", zstd.compress(VAST)), "100 bytes and goes on"),
        (struct.pack("<BQ", 5, 2**60), f"{2**60} bytes long"),
        (struct.pack("<BQ", 6, 3) + b"abc", "is cut off"),
    ],
)
def test_what_is_too_much_is_refused(record: bytes, told: str, tmp_path: Path) -> None:
    """By what it says, or by what it is where that is more."""
    path = tmp_path / "bag.mcap"
    path.write_bytes(MAGIC + record)
    with pytest.raises(RecordError, match=told) as refused:
        check_chunks(path, name="bag.mcap")
    assert refused.value.remedy


def test_a_whole_file_passes(tmp_path: Path) -> None:
    """Packed in either way, and without."""
    data = b"abc" * 1000
    path = tmp_path / "bag.mcap"
    packed = [(b"lz4", lz4.frame.compress(data)), (b"zstd", zstd.compress(data)), (b"", data)]
    path.write_bytes(MAGIC + b"".join(chunk(len(data), *each) for each in packed) + MAGIC)
    check_chunks(path, name="bag.mcap")


def test_an_import_looks_before_it_reads(ours: RunStore, tmp_path: Path) -> None:
    """Nothing is left of a run of it."""
    folder = write_bag(ours, tmp_path / "source", storage=StoragePlugin.MCAP)
    (file,) = (folder / "recorded").glob("*.mcap")
    file.write_bytes(MAGIC + chunk(2**40, b"zstd", zstd.compress(b"")))
    with pytest.raises(RecordError, match="unpacks to"):
        import_run(folder, parent=tmp_path / "runs")
    assert not list((tmp_path / "runs").glob("*"))
