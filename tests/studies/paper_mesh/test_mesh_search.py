"""The search of the paper's mesh, with a mesher of two tetrahedra."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sim.mesh.tet_mesh import TetMesh
from sim.mesh.tetwild import WildSizing
from sim.scene.pad import ParametricPad
from sim.studies.paper.claims import claims
from sim.studies.paper.kept import json_lines
from sim.studies.paper.presses import miss, read_trials
from tests.studies.paper_mesh.command import searched

EXACT = {name: claim.value for name, claim in claims().items() if name.startswith("mesh.")}


def two_tetrahedra(pad: ParametricPad, sizing: WildSizing) -> TetMesh:
    """Return a block of edges as long as the fine region's, at the pad's top."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, -1], [1, 1, -1]], dtype=float)
    vertices = corners * sizing.fine_m + np.array([0.0, 0.0, pad.height_m])
    tets = np.array([[0, 2, 1, 3], [1, 2, 4, 3]], dtype=np.int32)
    return TetMesh(vertices=vertices, tets=tets, name="two")


def test_every_pad_is_tried_with_every_share() -> None:
    """Longer coarse edges are longer in the table, refined ones are not."""
    trials = list(searched(make=two_tetrahedra))
    assert len({(trial["pad"], trial["share"]) for trial in trials}) == len(trials)
    first, second = trials[:2]
    assert second["found"]["mesh.edge_plain"] > first["found"]["mesh.edge_plain"]
    assert second["found"]["mesh.edge"] == pytest.approx(first["found"]["mesh.edge"])


def test_the_miss_is_zero_for_the_papers_table_alone() -> None:
    """Twice every number misses by 100 %."""
    assert miss({"found": EXACT}) == pytest.approx(0.0)
    doubled = {name: 2.0 * value for name, value in EXACT.items()}
    assert miss({"found": doubled}) == pytest.approx(1.0)


def test_trials_are_read_the_nearest_first(tmp_path: Path) -> None:
    """The order of the file does not matter; no file is no trials."""
    far = {"pad": "far", "share": 0.1, "found": EXACT | {"mesh.tets": 10.0}}
    near = {"pad": "near", "share": 0.1, "found": EXACT}
    file = tmp_path / "search.json"
    assert read_trials(file) == []
    file.write_text(json_lines([far, near]))
    assert read_trials(file) == [near, far]
