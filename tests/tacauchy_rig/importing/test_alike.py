"""Indenter and place of presses are what a replay presses, or it says why it does not."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from sim.scene.indenter import Sphere
from tacauchy_rig.errors import ConfigError, RecordError
from tacauchy_rig.importing.importer import import_run
from tacauchy_rig.loop.alike import check_alike
from tacauchy_rig.loop.inputs import inputs_of
from tacauchy_rig.loop.opening import open_run
from tacauchy_rig.loop.replay import replay_run
from tacauchy_rig.loop.report import report_run
from tacauchy_rig.loop.settings import check_names
from tacauchy_rig.rgb import encode_png
from tacauchy_rig.store.check.run import check_run
from tacauchy_rig.store.run_store import RunStore

MESHES_APART = 1e-3  # of a depth: a force's mesh is another than the depth's (preset fast)
HEAD = "image,fz,depth,x,y,tool"


def imported(folder: Path, *rows: str, force: bool = True) -> RunStore:
    """Import presses, each by its force, depth, place and tool."""
    (folder / "presses.csv").write_text("\n".join([HEAD, *(f"press.png,{row}" for row in rows)]))
    text = (folder / "import.toml").read_text().replace("[rig.replay]\nindenter", "[rig.replay]\n#")
    axes = "\n".join(f'{axis} = {{ column = "{axis}", unit = "mm" }}' for axis in "xy")
    if not force:
        text = text.replace('force = { column = "fz", unit = "N" }', "")
    text = text.replace("[rig.replay]", '[rig.replay]\npreset = "fast"\npose = "stated"')
    text = text.replace("[rig.sensor]", f'{axes}\nindenter = "tool"\n[rig.sensor]')
    (folder / "import.toml").write_text(text)
    return import_run(folder, parent=folder.parent, check=check_names)


def test_what_all_presses_share_is_replayed(small: Path) -> None:
    """One ball at one place, to a few micrometres."""
    ball = "sphere:diameter=6mm"
    store = imported(small, f"1,0.2,1.5,-2,{ball}", f"2,0.3,1.51,-2,{ball}")
    check_alike(store)
    inputs = inputs_of(store.config)
    assert isinstance(inputs.indenter, Sphere)
    assert inputs.indenter.diameter_m == pytest.approx(6e-3)
    assert inputs.mounting.offset_m == pytest.approx((1.505e-3, -2e-3))


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (("1,,0,0,sphere:diameter=6mm", "1,,0,0,sphere:diameter=4mm"), "2 indenters"),
        (("1,,0,0,", "1,,1,0,"), "1.000 mm apart"),
        (("1,,0,0,", "1,,,,"), "1 of its 2 presses have a known place"),
    ],
)
def test_presses_unlike_each_other_are_not_replayed(
    rows: tuple[str, ...], told: str, small: Path
) -> None:
    """Rather than all with the indenter, or at the place, of one."""
    with pytest.raises(ConfigError, match=told):
        check_alike(imported(small, *rows))


@pytest.mark.slow
def test_presses_without_a_force_are_replayed_to_their_depths(small: Path) -> None:
    """The simulator meets the depths, and no force is made up as measured."""
    blob = np.hypot(*np.mgrid[-240:240, -320:320]) < 60
    pressed = np.where(blob[..., None], np.uint8((150, 90, 60)), np.uint8(90))
    (small / "press.png").write_bytes(encode_png(np.asarray(pressed, np.uint8)))
    ball = "sphere:diameter=6mm"
    rows = (f",0.2,0,0,{ball}", f",0.3,0,0,{ball}")
    run = open_run(imported(small, *rows, force=False).paths.root)
    replay = replay_run(run)
    depths = [trial.depth_simulated_m for trial in replay.trials]
    assert depths == pytest.approx([0.2e-3, 0.3e-3], rel=MESHES_APART)
    assert all(math.isnan(trial.force_measured_n) for trial in replay.trials)
    assert replay.trials[1].force_simulated_n > replay.trials[0].force_simulated_n > 0.1
    assert check_run(run.store).passed, list(check_run(run.store).missed())
    report, paths = report_run(open_run(run.store.paths.root))
    assert [trial.force_measured_n for trial in report.trials] == [None, None]
    assert all(trial.metrics is not None for trial in report.trials)
    assert "NaN" not in paths.summary.read_text()


def test_presses_with_neither_are_not_replayed(small: Path) -> None:
    """There is nothing to press to."""
    run = open_run(imported(small, ",,0,0,", force=False).paths.root)
    with pytest.raises(RecordError, match="force"):
        replay_run(run)


def test_a_tool_of_a_press_lies_within_the_folder(small: Path) -> None:
    """As one of import.toml does."""
    with pytest.raises(RecordError, match="the presses' indenter"):
        imported(small, '1,0.2,0,0,"mesh:/etc/hostname,unit=mm"')
