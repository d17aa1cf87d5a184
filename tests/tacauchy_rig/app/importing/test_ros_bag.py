"""A bag, a LeRobot dataset, and a video with its log come back as the presses that they hold."""

import math
import re
import struct
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import pytest
from backports import zstd
from mcap.writer import MCAP0_MAGIC
from rosbags.rosbag2 import StoragePlugin

from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.app.importing.ros_bag import CHUNK_BYTES, check_chunks
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.image_codec import decode_rgb
from tacauchy_rig.core.store.check.run_and_press_check import check_run
from tacauchy_rig.core.store.recording.mcap_reader import Recording
from tacauchy_rig.core.store.run_store import RunStore
from tests.tacauchy_rig.app.importing.sources import (
    counting,
    header,
    make_lerobot,
    write_bag,
    write_video,
)


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
FOOTER = struct.pack("<BQQQI", 2, 20, 0, 0, 0) + MCAP0_MAGIC


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
        (struct.pack("<BQ", 5, 2**60), f"length {2**60} that exceeds limit"),
        (struct.pack("<BQ", 6, 3) + b"abc", "no whole MCAP file"),
    ],
)
def test_what_is_too_much_is_refused(record: bytes, told: str, tmp_path: Path) -> None:
    """By what it says, or by what it is where that is more."""
    path = tmp_path / "bag.mcap"
    path.write_bytes(MCAP0_MAGIC + record)
    with pytest.raises(RecordError, match=told) as refused:
        check_chunks(path, name="bag.mcap")
    assert refused.value.remedy


def test_a_whole_file_passes(tmp_path: Path) -> None:
    """Packed in either way, and without."""
    data = b"abc" * 1000
    path = tmp_path / "bag.mcap"
    packed = [(b"lz4", lz4.frame.compress(data)), (b"zstd", zstd.compress(data)), (b"", data)]
    path.write_bytes(MCAP0_MAGIC + b"".join(chunk(len(data), *each) for each in packed) + FOOTER)
    check_chunks(path, name="bag.mcap")


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda content: content[:5000], "."),
        (lambda _: MCAP0_MAGIC + chunk(2**40, b"zstd", zstd.compress(b"")), "unpacks to"),
    ],
    ids=["cut off", "vast"],
)
def test_nothing_is_left_of_a_bag_that_is_refused(
    ours: RunStore, change: Callable[[bytes], bytes], told: str, tmp_path: Path
) -> None:
    """An import looks before it reads."""
    folder = write_bag(ours, tmp_path / "source")
    (file,) = (folder / "recorded").glob("*.mcap")
    file.write_bytes(change(file.read_bytes()))
    with pytest.raises(RecordError, match=told):
        import_run(folder, parent=tmp_path / "runs")
    assert not list((tmp_path / "runs").glob("*"))


LOSS = 5.0  # grey levels that the codec takes; the presses are 20 apart


@pytest.mark.parametrize("kind", ["image", "video"])
def test_episodes_become_presses(kind: str, tmp_path: Path) -> None:
    """Each with its force, its depth, and images of its own time in files of many episodes."""
    source = make_lerobot(tmp_path / "source", kind=kind)
    (last,) = counting(import_run(source, parent=tmp_path, overrides=["data.episodes=[1]"]))
    assert last.force_measured_n == pytest.approx(3.0)
    store = import_run(source, parent=tmp_path / "all")
    assert check_run(store).passed, list(check_run(store).missed())
    trials = counting(store)
    assert [each.force_measured_n for each in trials] == pytest.approx([2.0, 3.0])
    depths = [each.depth_measured_m for each in trials]
    assert depths == pytest.approx([0.2e-3, 0.3e-3], abs=1e-9)
    for trial, newton in zip(trials, (2.0, 3.0), strict=True):
        recording = Recording.open(store.paths.recording(trial.index, 1))
        held = recording.frames(trial.dwell_start_ns, trial.dwell_end_ns)
        images = [decode_rgb(frame.jpeg) for frame in held]
        levels = [float(np.mean(image)) for image in images if image is not None]
        assert len(levels) == 50
        assert levels == pytest.approx([90 + 20 * newton] * len(levels), abs=LOSS)
    assert store.imported_trials[2].name.startswith("episode 1, press 1")


def test_without_its_extra_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The reader of Parquet is no part of a plain installation."""
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(ConfigError, match="pyarrow") as refused:
        import_run(make_lerobot(tmp_path / "source"), parent=tmp_path)
    assert "pip install" in refused.value.remedy


LOG = b"t,fx,fy,fz,mx,my,mz,x,y,z\n"
LATER_S = 0.7  # that the log begins after the video


def test_a_video_of_a_run_of_ours_comes_back(ours: RunStore, tmp_path: Path) -> None:
    """The offset is found to within three times what it says, and forces and depths are kept."""
    folder = write_video(ours, tmp_path / "source", later_s=LATER_S)
    store = import_run(folder, parent=tmp_path)
    assert check_run(store).passed, list(check_run(store).missed())
    assert store.config.run.sync_mode == "contact_onset"
    for theirs, own in zip(counting(store), counting(ours), strict=True):
        assert theirs.force_measured_n == pytest.approx(own.force_measured_n, rel=5e-3)
        assert theirs.depth_measured_m == pytest.approx(own.depth_measured_m, abs=1e-5)
    imported = store.imported.load()
    assert imported is not None
    told = re.search(r"is ([-+.\d]+) s from.*uncertainty (\d+) ms", imported.notes[0])
    assert told is not None
    offset_s, uncertainty_s = float(told[1]), float(told[2]) / 1e3
    assert offset_s == pytest.approx(-LATER_S, abs=3.0 * uncertainty_s)
    assert 0.005 < uncertainty_s < 0.05


def test_a_log_of_other_presses_is_refused(ours: RunStore, tmp_path: Path) -> None:
    """The correlation is said."""
    folder = write_video(ours, tmp_path / "source", later_s=0.0)
    lines = (folder / "force.csv").read_text().splitlines()
    times, rest = zip(*(line.split(",", 1) for line in lines[1:]), strict=True)
    mixed = [*rest[len(rest) // 3 :: 3], *rest[: len(rest) // 3], *rest[len(rest) // 3 :: 4]]
    rows = [f"{time},{row}" for time, row in zip(times, mixed, strict=False)]
    (folder / "force.csv").write_text("\n".join([lines[0], *rows]))
    with pytest.raises(RecordError):
        import_run(folder, parent=tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("gel.avi", b"RIFF....AVI no video at all", "0 frames"),
        ("force.csv", LOG + b"0" + b",0" * 9 + b"\n0" + b",0" * 9, "too coarse"),
        ("force.csv", LOG + b"1" + b",0" * 9 + b"\n0" + b",0" * 9, "line 3"),
    ],
)
def test_what_is_damaged_is_named(
    name: str, content: bytes, told: str, ours: RunStore, tmp_path: Path
) -> None:
    """A video that is none; times that do not ascend."""
    folder = write_video(ours, tmp_path / "source", later_s=0.0)
    (folder / name).write_bytes(content)
    with pytest.raises(RecordError, match=told):
        import_run(folder, parent=tmp_path)
