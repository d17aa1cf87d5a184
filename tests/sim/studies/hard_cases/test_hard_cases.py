"""The hard cases: their rows and page, from made-up results; all of them if time is given."""

from typing import Any

import numpy as np
import pytest

from sim.mesh.cached_tet_mesh import smallest_dihedral_deg
from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.scene import Effect
from sim.solve.equilibrium import SolverOptions
from sim.solve.loading_path import LoadingPath
from sim.studies.hard_cases import presses
from sim.studies.hard_cases.dynamics import torsion
from sim.studies.hard_cases.invariants import random_start, repeatable, slide_and_return
from sim.studies.hard_cases.precision import in_single_precision
from sim.studies.hard_cases.small_pads import brick_mesh, pad_model
from sim.studies.hard_cases.study import CASES, HardCases, has_passed, measured
from tacauchy_rig.core.errors import ConvergenceError
from tacauchy_rig.core.study import About, Result

NAMES = {case.alias: case.name for case in HardCases().cases()}


def result(number: str, **measured: Any) -> Result:
    """Return a case that passed with some numbers."""
    found = {"passed": True, "measured": measured}
    return Result(name=NAMES[number], shows="it ends", found=found, wall_s=2.4)


# Tests of verification have the presses of 3 and 5, those of the command line 14, and other tests
# of this folder the rest.
_ELSEWHERE = ("2", "3", "5", "14", "16", "19")

# Kernels in single precision (13) end in NaN on some processors, and meet the criterion on others.
_BY_PROCESSOR = pytest.mark.xfail(reason="float32 kernels: NaN on some processors", strict=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    "number",
    [
        pytest.param(number, marks=_BY_PROCESSOR) if number == "13" else number
        for number in CASES
        if number not in _ELSEWHERE
    ],
)
def test_every_case_meets_its_criterion(number: str) -> None:
    """As `study hard-cases` measures them, which nobody runs as often."""
    outcome = measured(number)
    assert outcome["passed"], outcome["measured"]


def test_page_has_criterion_numbers_verdict_and_command() -> None:
    """What was asked, what came out, and what made it; a case without numbers has failed."""
    good = result("1", iterations=7, distance_over_H=3.25e-13, same=True)
    bad = Result(name=NAMES["4"], shows="converged", failure="stopped at 3.1 mm")
    study = HardCases()
    page = study.page([good, bad], About("tacauchy-rig study hard-cases"), [])
    assert "**1 of 2 hard cases pass; failed: 4.**" in page
    assert "Written by `tacauchy-rig study hard-cases` with tacauchy-rig" in page
    assert "2 of the 19 cases are on this page" in page
    assert f"| 1 | {NAMES['1']} | pass | 2 |" in page
    assert "| distance_over_H | 3.25e-13 |" in page
    assert "| same | yes |" in page
    assert f"## 4. {NAMES['4']}: FAIL" in page
    assert "No numbers: stopped at 3.1 mm" in page
    first, second = study.facts([good, bad])["cases"]
    assert (first["passed"], second["passed"]) == (True, False)
    assert not study.has_passed([good, bad])


def test_page_says_what_passing_a_random_start_means() -> None:
    """Of case 2 the starts that came back are told by element; knots only where there are some."""
    measured = {
        "starts": 6,
        "ended_at_rest_P1": 3,
        "ended_at_rest_P2": 1,
        "ended_knotted_but_stationary": 2,
        "elements_whose_corners_are_inside_out_max": 5,
        "det_F_min_at_the_end": 0.9,
    }
    texts = [
        " ".join(HardCases().page([each], About("x"), []).split())
        for each in (
            result("2", **measured),
            result("2", **measured | {"ended_knotted_but_stationary": 0}),
        )
    ]
    assert "3 on linear tetrahedra and 1 on quadratic ones ended at rest" in texts[0]
    assert "The other 2 end in a knot: up to 5 elements" in texts[0]
    assert "knot:" not in texts[1]


def test_rounded_cylinder_goes_down_by_four_fifths() -> None:
    """Every frame converges, the force rises, no element is turned inside out."""
    found = presses.press_in("coarse", fillet_m=0.5e-3, bonded=True)
    assert has_passed("4", found), found
    assert float(found["min_jacobian_coarse"]) > 0.0
    assert float(found["force_end_coarse_n"]) > 20.0


def test_slivers_are_as_flat_as_asked_and_change_nothing_else() -> None:
    """The smallest angle is the one asked for, every volume positive, the surface untouched."""
    good = brick_mesh((4, 4, 3))
    bad = presses.with_slivers(good, dihedral_deg=0.5)
    assert smallest_dihedral_deg(bad) == pytest.approx(0.5, rel=1e-6)
    corners = bad.vertices[bad.tets]
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    assert volumes.min() > 0.0
    assert volumes.sum() == pytest.approx(12e-3 * 12e-3 * 4e-3, rel=1e-12)


def test_slivers_cost_few_iterations() -> None:
    """The row itself, pressed less deep."""
    found = presses.slivers(depth_m=0.2e-3)
    assert has_passed("7", found), found


LINEAR = ((Effect.LOCKING_FREE_ELEMENT, False),)


@pytest.mark.slow
def test_sharp_rim_off_the_pad() -> None:
    """Half off and on a corner it balances and rises; beside the pad the message says where."""
    found = presses.off_the_pad({"cylinder": presses.PUNCH}, LINEAR)
    assert has_passed("16", found), found
    forces = [float(found[f"cylinder_{p}_force_n"]) for p in ("middle", "edge", "corner")]
    # Half and a quarter of the face touch, on gel that has less around it.
    assert 0.2 < forces[1] / forces[0] < 0.5
    assert 0.05 < forces[2] / forces[0] < 0.25
    assert "beside the pad" in str(found["cylinder_beside"])


def test_single_precision_source_has_no_double_left() -> None:
    """Case 13: types of the kernels change, those of the host do not."""
    source = "x: wp.array(dtype=wp.vec3d) = wp.mat33d(wp.float64(0.0)); np.float64; wp.array2d"
    single = "x: wp.array(dtype=wp.vec3f) = wp.mat33f(wp.float32(0.0)); np.float64; wp.array2d"
    assert in_single_precision(source) == single


def test_the_same_press_gives_the_same_force() -> None:
    """Case 19, within this process and against another, to the rounding of the sums.

    Not bit by bit: where MKL's arrays lie in memory may change the order in which it sums.
    """
    assert has_passed("19", repeatable())


def test_friction_takes_energy_out_at_every_point() -> None:
    """Case 18: no point gives any back, and all of them together take what the indenter put in."""
    slide = slide_and_return()
    assert slide["point_min_j"] >= -5.7e-14 * slide["dissipated_j"]
    assert slide["dissipated_j"] > 0.0
    assert slide["dissipated_j"] == pytest.approx(slide["work_less_stored_j"], rel=0.05)
    assert slide["balance_relative"] <= 1e-6
    assert slide["gap_min_m"] > 0.0


def test_rigid_motion_and_patch_are_exact() -> None:
    """Case 17, first half."""
    assert all(float(deviation) <= 1e-10 for deviation in presses.rigid_motion().values())
    assert all(float(deviation) <= 1e-10 for deviation in presses.patch_test().values())


def test_first_part_of_the_torsion_is_smooth() -> None:
    """Thirty degrees of it."""
    found = torsion(turn_deg=30.0)
    assert has_passed("11", found), found
    assert float(found["torque_end_nm"]) > 2.5 * float(found["torque_first_step_nm"])


def test_random_starts_end_stationary() -> None:
    """Case 2: the energy never rises, and where it ends is said."""
    measured = random_start()
    assert has_passed("2", measured), measured
    at_rest = [int(measured[f"ended_at_rest_{order.value}"]) for order in ElementOrder]
    knotted = int(measured["ended_knotted_but_stationary"])
    assert sum(at_rest) + knotted == measured["starts"]
    # A knot is told by its corners, since det F does not show it.
    assert (int(measured["elements_whose_corners_are_inside_out_max"]) > 0) == (knotted > 0)
    assert np.isfinite(float(measured["det_F_min_at_the_end"]))


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
    model = pad_model(brick_mesh((3, 3, 2), quarter=True), order=ElementOrder.P1)
    path = LoadingPath(model, indenter)
    state = model.rest_state(tip=np.array([0.0, 0.0, path.touch_m - depth_m]))
    with pytest.raises(ConvergenceError, match=told):
        path.solver.settle(state, options=SolverOptions())
    assert np.array_equal(state.positions, model.nodes)


def test_a_shallow_start_inside_is_resolved() -> None:
    """Case 15: begun 0.5 mm inside the gel, the force is that of a press."""
    model = pad_model(brick_mesh((3, 3, 2), quarter=True), order=ElementOrder.P1)
    indenter = Sphere(diameter_m=6e-3)
    path = LoadingPath(model, indenter)
    state = model.rest_state(tip=np.array([0.0, 0.0, path.touch_m - 0.5e-3]))
    found = path.solver.settle(state, options=SolverOptions())
    force = model.mesh.symmetry.whole_force(found.contact.forces.sum(axis=(0, 1)))[2]
    assert force == pytest.approx(path.advance(0.5e-3).force_n[2], rel=1e-6)
    assert model.surface.gaps(state.positions, indenter, state).min() > 0.0
