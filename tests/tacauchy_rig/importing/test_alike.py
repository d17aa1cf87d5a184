"""Indenter and place of presses are what a replay presses, or it says why it does not."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim.scene.indenter import Sphere
from tacauchy_rig.errors import ConfigError, RecordError
from tacauchy_rig.importing.importer import import_run
from tacauchy_rig.loop.alike import check_alike
from tacauchy_rig.loop.inputs import inputs_of
from tacauchy_rig.loop.settings import check_names
from tacauchy_rig.store.run_store import RunStore

HEAD = "image,fz,depth,x,y,tool"


def imported(folder: Path, *rows: str, force: bool = True) -> RunStore:
    """Import presses, each by its force, depth, place and tool."""
    (folder / "presses.csv").write_text("\n".join([HEAD, *(f"press.png,{row}" for row in rows)]))
    text = (folder / "import.toml").read_text().replace("[rig.replay]\nindenter", "[rig.replay]\n#")
    axes = "\n".join(f'{axis} = {{ column = "{axis}", unit = "mm" }}' for axis in "xy")
    if not force:
        text = text.replace('force = { column = "fz", unit = "N" }', "")
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


def test_presses_without_a_force_are_not_replayed(small: Path) -> None:
    """And are told what they are good for."""
    with pytest.raises(ConfigError, match="none of its presses has a force"):
        check_alike(imported(small, ",0.2,0,0,", force=False))


def test_a_tool_of_a_press_lies_within_the_folder(small: Path) -> None:
    """As one of import.toml does."""
    with pytest.raises(RecordError, match="the presses' indenter"):
        imported(small, '1,0.2,0,0,"mesh:/etc/hostname,unit=mm"')
