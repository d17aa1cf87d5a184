"""The paper's mesh and the cost of its stress."""

from __future__ import annotations

from sim.scene.scene import Preset
from sim.studies.verification.paper_mesh import measure_mesh, measure_stress_cost


def test_stress_cost_is_reported_and_never_judged() -> None:
    """Quantiles rise; whatever they are, nothing is missed."""
    found = measure_stress_cost(presets=(Preset.PAPER,))
    low, middle, high = (float(value or 0.0) for value in found.rows[0][5:8])
    assert 0.0 < low <= middle <= high
    assert found.passed


def test_mesh_table_has_the_papers_numbers_beside_ours() -> None:
    """The refined mesh has more tetrahedra than the coarse one, and shorter edges."""
    rows = {row[0]: row[1:] for row in measure_mesh().rows}
    assert rows["tetrahedra, refined"][0] == 1920
    assert float(rows["refined over not refined"][1] or 0.0) > 1.0
    assert float(rows["density in the middle, refined over not"][1] or 0.0) > 1.0
