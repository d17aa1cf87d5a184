"""Extrapolation from the nearest points of a path."""

from __future__ import annotations

import numpy as np
import pytest

from sim.contact.state import ContactForces, State
from sim.effects.plan import plan_effects
from sim.effects.scene_path import follow, path_for
from sim.solve.equilibrium import Equilibrium
from sim.solve.path_point import PathPoint
from sim.solve.stepping import predicted_state
from sim.studies.effects_check.drawn import drawn_scene

_NONE = np.zeros((0, 1, 3))


def point(depth_m: float) -> PathPoint:
    """Return a made-up point whose nodes are a quadratic function of the depth."""
    nodes = np.array([[1.0, 2.0, 3.0]]) + depth_m * np.array([[0.5, -1.0, depth_m]])
    return PathPoint(
        depth_m=depth_m,
        force_n=np.zeros(3),
        stiffness_n_m=1.0,
        state=State(positions=nodes, tip=np.array([0.0, 0.0, -depth_m]), rotation=np.eye(3)),
        equilibrium=Equilibrium(
            iterations=0,
            push_n=np.zeros(3),
            touch=lambda: ContactForces(points=_NONE, gaps=_NONE, forces=_NONE, stiffness=_NONE),
            elastic_gradient=np.zeros((1, 3)),
            residual_n=0.0,
            min_jacobian=1.0,
        ),
    )


@pytest.mark.parametrize("at", [0.5, 2.5, 4.0])
def test_three_points_give_a_quadratic_exactly(at: float) -> None:
    """Ahead, between and behind; the points stay as they are."""
    depths = [1.0, 2.0, 3.0]
    points = [point(depth) for depth in depths]
    found = predicted_state(points, depths, at=at, step=at - depths[-1])
    np.testing.assert_allclose(found.positions, point(at).state.positions, rtol=1e-12)
    np.testing.assert_allclose(found.tip, [0.0, 0.0, -at], atol=1e-12)
    np.testing.assert_array_equal(points[-1].state.tip, [0.0, 0.0, -3.0])


def test_a_kink_is_followed_along_the_line() -> None:
    """Where a parabola would leave the last two points' line by more than half of its way."""
    depths = [1.0, 2.0, 3.0]
    points = [point(depth) for depth in depths]
    points[0].state.positions += 10.0 * (points[2].state.positions - points[1].state.positions)
    found = predicted_state(points, depths, at=4.0, step=1.0)
    line = 2.0 * points[2].state.positions - points[1].state.positions
    np.testing.assert_allclose(found.positions, line, rtol=1e-12)


def test_points_too_close_together_count_once() -> None:
    """Two points at the same depth give no division by their distance; one alone is copied."""
    depths = [1.0, 1.0 + 1e-13]
    found = predicted_state([point(depth) for depth in depths], depths, at=1.5, step=0.5)
    np.testing.assert_allclose(found.positions, point(1.0).state.positions, rtol=1e-9)


@pytest.mark.slow
def test_points_that_go_on_and_off_in_turn_come_to_rest() -> None:
    """A drawn punch slides on a stiff skin, 22 um deep: its lagged pressure cycled for ever."""
    scene = drawn_scene(61124, 154)
    found = follow(scene, path_for(scene, plan_effects(scene)))
    assert found.depth_m == pytest.approx(scene.target.depth_m, rel=1e-9)
    assert found.force_n[0] < -0.9 * scene.friction * found.force_n[2]
