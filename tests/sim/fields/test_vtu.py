"""Files for ParaView: the whole gel right side out with its tensors, and the indenter."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pyvista

from sim.fields.press_fields import gel_vtu, indenter_vtu, surface_state
from sim.solve.loading_path import LoadingPath
from sim.solve.path_point import PathPoint


def test_the_whole_gel_is_written_with_its_stress(
    pressed: tuple[LoadingPath, PathPoint], tmp_path: Path
) -> None:
    """Four copies of the quarter, none inside out; tensors are mirrored as they must be."""
    path, point = pressed
    file = tmp_path / "gel.vtu"
    file.write_bytes(gel_vtu(path.model, point))
    grid = pyvista.read(file)
    assert grid.n_cells == 4 * len(path.model.elements)
    volumes = grid.linear_copy().compute_cell_sizes()["Volume"]
    assert volumes.min() > 0.0
    assert volumes.sum() == pytest.approx(4.0 * path.model.volume_m3, rel=0.01)
    stress, places = grid.point_data["cauchy_stress_pa"], grid.points
    assert stress.shape == (grid.n_points, 6)
    assert grid.cell_data["cauchy_stress_pa"].shape == (grid.n_cells, 6)
    assert grid.cell_data["cauchy_stress_error_pa"].min() >= 0.0
    image = [grid.find_closest_point(place) for place in places[:200] * (-1.0, 1.0, 1.0)]
    np.testing.assert_allclose(
        stress[:200] * (1.0, 1.0, 1.0, -1.0, 1.0, -1.0), stress[image], atol=1e-6
    )


def test_the_indenter_stands_where_it_presses(
    pressed: tuple[LoadingPath, PathPoint], tmp_path: Path
) -> None:
    """Its lowest point is the tip, moved by the wide barrier's reach, its width the ball's."""
    surface = surface_state(*pressed)
    file = tmp_path / "indenter.vtu"
    file.write_bytes(indenter_vtu(surface))
    grid = pyvista.read(file)
    assert grid.bounds[4] == pytest.approx(surface.indenter_position[2], abs=1e-12)
    assert grid.bounds[1] - grid.bounds[0] == pytest.approx(8e-3, rel=0.02)
