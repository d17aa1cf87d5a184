"""A ROS 2 bag comes back as the presses that it holds; chunks of MCAP are bounded first."""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import lz4.frame
import pytest
from backports import zstd
from rosbags.rosbag2 import StoragePlugin

from tacauchy_rig.app.importing.bag import CHUNK_BYTES, MAGIC, check_chunks
from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.check.run import check_run
from tacauchy_rig.core.store.run_store import RunStore
from tests.tacauchy_rig.app.importing.sources import counting, header, write_bag


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_run_of_ours_comes_back(ours: RunStore, storage: StoragePlugin, tmp_path: Path) -> None:
    """Forces within half a per cent and depths within 10 um: windows are found, not told."""
    store = import_run(write_bag(ours, tmp_path / "source", storage=storage), parent=tmp_path)
    assert check_run(store).passed, list(check_run(store).missed())
    assert len(counting(store)) == len(counting(ours)) == 2
    for theirs, own in zip(counting(store), counting(ours), strict=True):
        assert theirs.force_measured_n == pytest.approx(own.force_measured_n, rel=5e-3)
        assert theirs.depth_measured_m == pytest.approx(own.depth_measured_m, abs=1e-5)
    assert store.imported_trials[1].streams == ("force", "arm", "image")


def test_a_file_alone_is_enough(ours: RunStore, tmp_path: Path) -> None:
    """Topics are told by their types; what sensor it was, the command line says."""
    folder = write_bag(ours, tmp_path / "source") / "recorded"
    (file,) = folder.glob("*.mcap")
    store = import_run(file, parent=tmp_path, overrides=["rig.sensor.name=gelsight-mini"])
    assert len(counting(store)) == 2


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ('image = "/cell/wrench"', "/cell/wrench"),
        ('force = "/no"', "/no"),
        ('presses.press_force = "1 kN"', "press_force"),
        ('file = "../x.mcap"', "leads out of the folder"),
    ],
)
def test_what_is_not_there_is_named(ours: RunStore, line: str, told: str, tmp_path: Path) -> None:
    """With the topics that there are, or the largest force."""
    folder = write_bag(ours, tmp_path / "source")
    text = (folder / "import.toml").read_text().replace("[data]", f"[data]\n{line}")
    if line.startswith("file"):
        text = text.replace('file = "recorded"\n', "")
    (folder / "import.toml").write_text(text)
    with pytest.raises(RecordError, match=told):
        import_run(folder, parent=tmp_path)


def test_a_bag_that_was_cut_off_is_refused(ours: RunStore, tmp_path: Path) -> None:
    """And nothing is left of it."""
    folder = write_bag(ours, tmp_path / "source")
    (file,) = (folder / "recorded").glob("*.mcap")
    file.write_bytes(file.read_bytes()[:5000])
    with pytest.raises(RecordError):
        import_run(folder, parent=tmp_path / "runs")
    assert not list((tmp_path / "runs").glob("*"))


CAMERA_S = 4.2  # that the camera's clock is ahead


def test_a_bag_as_other_tools_leave_it(ours: RunStore, tmp_path: Path) -> None:
    """No storage is named, forces begin with no numbers, and the camera has a clock of its own."""
    first: list[int] = []

    def changed(name: str, stamp_ns: int, message: Any) -> Any:
        if name == "/gel/image":
            return replace(message, header=header(stamp_ns + round(CAMERA_S * 1e9)))
        first.append(stamp_ns)
        if name == "/cell/wrench" and len(first) < 10:
            force = replace(message.wrench.force, z=math.nan)
            return replace(message, wrench=replace(message.wrench, force=force))
        return message

    folder = write_bag(ours, tmp_path / "source", changed=changed)
    about = folder / "recorded" / "metadata.yaml"
    about.write_text(
        about.read_text().replace("storage_identifier: mcap", "storage_identifier: ''")
    )
    store = import_run(folder, parent=tmp_path)
    for theirs, own in zip(counting(store), counting(ours), strict=True):
        assert theirs.force_measured_n == pytest.approx(own.force_measured_n, rel=5e-3)
    imported = store.imported.load()
    assert imported is not None
    assert imported.clock is not None
    assert imported.clock.offset_s == pytest.approx(-CAMERA_S, abs=0.1)
    assert any("no finite numbers" in note.replace("\n", " ") for note in imported.notes)


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
