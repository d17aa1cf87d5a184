"""A ROS 2 bag comes back as the presses that it holds."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag2 import StoragePlugin

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
