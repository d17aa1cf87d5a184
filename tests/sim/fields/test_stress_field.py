"""The recovered Cauchy stress: exact where strain is even, nearer than the elements' own."""

from __future__ import annotations

import numpy as np

from sim.effects.presets import build_model
from sim.fields.stress import cauchy_stress
from sim.scene.scene import Scene
from sim.solve.loading_path import LoadingPath
from sim.solve.path_point import PathPoint


def test_even_strain_gives_even_stress_without_an_error(
    pressed: tuple[LoadingPath, PathPoint],
) -> None:
    """Nodes on corners and on edges, and cells, have the one stress there is."""
    model, stretch = pressed[0].model, np.diag([1.05, 0.98, 0.97])
    found = cauchy_stress(model, model.nodes @ stretch)
    expected = found.cells_pa[0]
    size = np.abs(expected).max()
    np.testing.assert_allclose(found.nodes_pa - expected, 0.0, atol=1e-6 * size)
    np.testing.assert_allclose(found.cells_pa - expected, 0.0, atol=1e-6 * size)
    assert found.errors_pa.max() < 1e-6 * size


def test_the_estimated_error_falls_with_the_edges(ball: Scene) -> None:
    """As the square of the edges, or nearly: twice shorter, at most 0.45 times the error."""

    def error(refinement: float) -> float:
        path = LoadingPath(build_model(ball, refinement=refinement), ball.indenter)
        point = path.advance(0.2e-3)
        found, volumes = cauchy_stress(path.model, point.state.positions), path.model.discretisation
        return float(np.sqrt(found.errors_pa**2 @ volumes.volumes))

    assert error(2.0) < 0.45 * error(1.0)
