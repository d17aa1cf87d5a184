"""A calibration in Taxim's form colours slopes as ours does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tacauchy_rig.app.exporting.formats import export
from tacauchy_rig.app.exporting.names import Format
from tacauchy_rig.app.exporting.taxim import ISAAC_BINS, TAXIM_BINS
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.rgb import decode_rgb


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[Format, Path]:
    """The nominal optics of a GelSight Mini in both forms."""
    out = tmp_path_factory.mktemp("calibration")
    for form in (Format.ISAACLAB, Format.TAXIM):
        export(Path("gelsight-mini"), out / form, form)
    return {form: out / form for form in (Format.ISAACLAB, Format.TAXIM)}


def colour(table: np.ndarray, slope: float, turn: float, x: float, y: float) -> float:
    """Return a change of colour by the renderers' own rule: the bin that a slope is in."""
    bins = len(table) - 1
    row = int(np.arctan(slope) / (0.5 * np.pi / bins))
    column = int((turn + np.pi) / (2.0 * np.pi / bins))
    return float(table[row, column] @ [x * x, y * y, x * y, x, y, 1.0])


def test_slopes_have_the_lamps_colours(folders: dict[Format, Path]) -> None:
    """A slope is lit by the lamps that it faces; Taxim's opposite sign and order are kept."""
    with np.load(folders[Format.ISAACLAB] / "polycalib.npz") as tables:
        isaac = {name: tables[f"grad_{name}"] for name in "rgb"}
    with np.load(folders[Format.TAXIM] / "polycalib.npz") as tables:
        taxim = {name: tables[f"grad_{name}"] for name in "rgb"}
    assert isaac["r"].shape == (ISAAC_BINS, ISAAC_BINS, 6)
    assert taxim["r"].shape == (TAXIM_BINS, TAXIM_BINS, 6)
    # Lamps stand at azimuths -90, 30 and 150 degrees, elevation 25. The camera sees the surface
    # from below: one that rises along the rows turns from the first to the others (Lambert).
    for slope in (0.1, 0.3):
        angle, elevation = np.arctan(slope), np.radians(25.0)
        lamps = {"r": (90, 10, 10), "g": (15, 80, 20), "b": (10, 15, 90)}
        for name, levels in lamps.items():
            gains = [
                level
                * (
                    np.cos(elevation) * np.sin(angle) * facing
                    + np.sin(elevation) * (np.cos(angle) - 1.0)
                )
                for level, facing in zip(levels, (-1.0, 0.5, 0.5), strict=True)
            ]
            found = colour(isaac[name], slope, 0.5 * np.pi, 160.0, 120.0)
            assert found == pytest.approx(sum(gains), abs=1.5)
            other = {"r": "b", "g": "g", "b": "r"}[name]
            opposite = colour(taxim[other], slope, -0.5 * np.pi, 160.0, 120.0)
            assert opposite == pytest.approx(found, abs=1.5), "one bin is 1.4 degrees"


def test_level_gel_is_the_frame(folders: dict[Format, Path]) -> None:
    """Slope zero adds nothing, in whatever direction; the frame is the one that was given."""
    for folder in folders.values():
        with np.load(folder / "polycalib.npz") as tables:
            assert not any(tables[f"grad_{name}"][0].any() for name in "rgb")
    frame = decode_rgb((folders[Format.ISAACLAB] / "bg.jpg").read_bytes())
    assert frame is not None
    assert frame.shape == (240, 320, 3)
    with np.load(folders[Format.TAXIM] / "dataPack.npz") as data:
        assert np.array_equal(data["f0"], frame)


def test_colours_by_depth_are_refused(tmp_path: Path) -> None:
    """A sensor whose gel is seen by its thickness has no slopes to tabulate."""
    with pytest.raises(ConfigError, match="one of depth"):
        export(Path("9dtact"), tmp_path / "out", Format.TAXIM)
