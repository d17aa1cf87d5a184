"""The quick hard cases: what they measure meets their criteria."""

from __future__ import annotations

import numpy as np
import pytest

from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.solve.load_steps.path import LoadingPath
from sim.solve.newton import NewtonOptions, equilibrate
from sim.solve.problem import Problem
from sim.studies.hard_cases.pads import pad_model, quarter_brick_mesh
from sim.studies.hard_cases.rows.consistency import patch_test, rigid_motion
from sim.studies.hard_cases.rows.friction_slide import slide_and_return
from sim.studies.hard_cases.rows.precision import in_single_precision
from sim.studies.hard_cases.rows.presses import FORCE_ROUNDING, no_contact, repeatable
from sim.studies.hard_cases.rows.starts import ENERGY_ROUNDING, random_start
from tacauchy_rig.errors import ConvergenceError


def test_no_contact_is_exactly_nothing() -> None:
    """Case 14."""
    outcome = no_contact()
    assert outcome.passed
    assert outcome.measured["force_max_n"] == 0.0
    assert outcome.measured["iterations_before_touch"] == 0


def test_random_starts_end_stationary() -> None:
    """Case 2: the energy never rises, and where it ends is said."""
    outcome = random_start()
    assert outcome.passed
    measured = outcome.measured
    assert float(measured["energy_rise_max_over_first"]) <= ENERGY_ROUNDING
    ended = int(measured["ended_at_rest"]) + int(measured["ended_knotted_but_stationary"])
    assert ended == measured["starts"]
    assert np.isfinite(float(measured["det_F_min_at_the_end"]))


def test_rigid_motion_and_patch_are_exact() -> None:
    """Case 17, first half."""
    assert all(float(deviation) <= 1e-10 for deviation in rigid_motion().values())
    assert all(float(deviation) <= 1e-10 for deviation in patch_test().values())


def test_the_same_press_gives_the_same_force() -> None:
    """Case 19, within this process and against another, to the rounding of the sums.

    Not bit by bit: where MKL's arrays lie in memory may change the order in which it sums.
    """
    measured = repeatable().measured
    for where in ("same", "other"):
        assert float(measured[f"deviation_{where}_process_relative"]) <= FORCE_ROUNDING


@pytest.mark.parametrize(
    ("indenter", "depth_m", "told"),
    [
        (Sphere(diameter_m=6e-3), 1.3e-3, "starts 1.29 mm inside the indenter"),
        (Sphere(diameter_m=6e-3), 5e-3, "nearest side does not face the gel"),
        (Cylinder(diameter_m=1e-3, fillet_m=1e-4), 1e-3, "nearest side does not face the gel"),
    ],
)
def test_deep_starts_are_refused_unchanged(indenter: Indenter, depth_m: float, told: str) -> None:
    """Case 15: too deep, through its far side, or past its flank; the state is left as it was."""
    model = pad_model(quarter_brick_mesh((3, 3, 2)), order=ElementOrder.P1)
    path = LoadingPath(model, indenter)
    state = model.rest_state(tip=np.array([0.0, 0.0, path.touch_m - depth_m]))
    problem = Problem(model, path.solver, indenter)
    with pytest.raises(ConvergenceError, match=told):
        equilibrate(problem, state, options=NewtonOptions())
    assert np.array_equal(state.positions, model.nodes)


def test_a_shallow_start_inside_is_resolved() -> None:
    """Case 15: begun 0.5 mm inside the gel, the force is that of a press."""
    model = pad_model(quarter_brick_mesh((3, 3, 2)), order=ElementOrder.P1)
    indenter = Sphere(diameter_m=6e-3)
    path = LoadingPath(model, indenter)
    state = model.rest_state(tip=np.array([0.0, 0.0, path.touch_m - 0.5e-3]))
    found = equilibrate(Problem(model, path.solver, indenter), state, options=NewtonOptions())
    force = model.mesh.symmetry.whole_force(found.contact.forces.sum(axis=(0, 1)))[2]
    assert force == pytest.approx(path.advance(0.5e-3).force_n[2], rel=1e-6)
    assert model.gaps(state.positions, indenter, state).min() > 0.0


def test_friction_takes_energy_out_at_every_point() -> None:
    """Case 18: no point gives any back, and all of them together take what the indenter put in."""
    slide = slide_and_return()
    assert slide.gives_nothing_back
    assert slide.dissipated_j > 0.0
    assert slide.dissipated_j == pytest.approx(slide.work_less_stored_j, rel=0.05)
    assert slide.balance_relative <= 1e-6
    assert slide.gap_min_m > 0.0


def test_single_precision_source_has_no_double_left() -> None:
    """Case 13: types of the kernels change, those of the host do not."""
    source = "x: wp.array(dtype=wp.vec3d) = wp.mat33d(wp.float64(0.0)); np.float64; wp.array2d"
    single = "x: wp.array(dtype=wp.vec3f) = wp.mat33f(wp.float32(0.0)); np.float64; wp.array2d"
    assert in_single_precision(source) == single
