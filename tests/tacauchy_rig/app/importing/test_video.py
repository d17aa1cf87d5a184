"""A video and a force log of another clock come back as the presses that both saw."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tacauchy_rig.app.importing.importer import import_run
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.check.run import check_run
from tacauchy_rig.core.store.run_store import RunStore
from tests.tacauchy_rig.app.importing.sources import counting, write_video

LOG = b"t,fx,fy,fz,mx,my,mz,x,y,z\n"
LATER_S = 0.7  # that the log begins after the video


def test_a_run_of_ours_comes_back(ours: RunStore, tmp_path: Path) -> None:
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
