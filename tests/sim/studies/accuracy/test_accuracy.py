"""Accuracy against time: presses, judgements, settings, and the figure."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.cheapest_setting import keeping, keeping_corrected
from sim.mesh.elements import ElementOrder
from sim.mesh_bias_correction import WAY
from sim.optics.height.height_map import HeightMaps
from sim.scene.indenter import Cylinder, Sphere, describe
from sim.scene.material import Material
from sim.scene.pad import BoxPad
from sim.scene.scene import Preset, Scene, SceneTerms, Target
from sim.sensor.camera_geometry import CameraGeometry
from sim.studies.accuracy.reference_errors import (
    FULL,
    QUANTITIES,
    SHORT,
    Configuration,
    Judge,
    Row,
    chances,
    extrapolated,
    finished,
    front_of,
    observe,
    reseeded,
)
from sim.studies.accuracy.study import Accuracy, seed_table
from sim.studies.accuracy.tolerance import (
    CHOICE,
    COLUMNS,
    COST,
    HELD_OUT,
    SEEN_BEFORE,
    HeldOut,
    check_tolerance,
    corrected_at,
    judged_depth,
    pressed,
    tolerance_table,
)
from sim.tolerance import Tolerance
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.study import About, Result
from tacauchy_rig.core.tables import Table

_GEOMETRY = CameraGeometry(
    width=40, height=30, scale_x_m=0.4e-3, scale_y_m=0.4e-3, centre_x_px=19.5, centre_y_px=14.5
)

_SCENE = Scene(
    pad=BoxPad(size_x_m=20e-3, size_y_m=20e-3, height_m=4e-3),
    material=Material(young_pa=0.4e6, poisson=0.48),
    indenter=Sphere(diameter_m=8e-3),
    target=Target(force_n=0.3),
)

_EXACT = Configuration(name="exact", preset=Preset.FAST)
_COARSE = Configuration(name="coarse", preset=Preset.FAST, refinement=1.0 / 1.5)
_COARSEST = replace(_COARSE, name="coarsest", refinement=1.5**-2)
_LINEAR = Configuration(name="P1", preset=Preset.FAST, element=ElementOrder.P1)


def _image(maps: HeightMaps) -> ImageArray:
    grey = 255.0 * (maps.rest - maps.loaded) / 1e-3
    return np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def _alike(first: ImageArray, second: ImageArray, _maps: HeightMaps) -> tuple[float, float]:
    difference = np.abs(first.astype(float) - second.astype(float)).mean() / 255.0
    return 1.0 - difference, 1.0 - difference


def _judge(reference: Configuration) -> Judge:
    return Judge(_SCENE, _GEOMETRY, reference, render=_image, similarity=_alike)


def test_a_locking_element_is_seen_as_too_stiff() -> None:
    """Linear tetrahedra push back harder than the limit of quadratic ones.

    Towards that limit errors fall by 1.5 squared, as it was extrapolated; half of what is left is
    doubted. What is not extrapolated may be off by what order 1 leaves, of two coarser meshes the
    one that tells more, or by what edges 7 % longer or shorter change.
    """
    judge = _judge(_EXACT)
    rows = finished([judge.row(each) for each in (_EXACT, _COARSE, _COARSEST, _LINEAR)])
    exact, coarse, coarsest, linear = rows
    assert exact.errors["image"] == 0.0
    assert coarse.errors["force"] == pytest.approx(1.5**2 * exact.errors["force"], rel=1e-6)
    assert judge.bars["force"] == pytest.approx(0.5 * abs(exact.errors["force"]), rel=1e-6)
    told = [2.0 * abs(coarse.errors["radius"]), abs(coarsest.errors["radius"]) / (1.5**2 - 1.0)]
    told += [abs(judge.row(_EXACT.refined(by)).errors["radius"]) for by in (0.93, 1.07)]
    assert judge.bars["radius"] == pytest.approx(max(told), rel=1e-6)
    assert linear.errors["force"] > 0.05
    assert linear.errors["depth"] < 0.0
    assert any(row.on_front for row in rows)


def test_a_corrected_configuration_is_softer_than_its_mesh() -> None:
    """By the bias that such meshes have: deeper at the force, and with less force at a depth."""
    raw_only = Configuration(name="raw", preset=Preset.FAST, path_refinement=WAY)
    raw, corrected = (
        observe(_SCENE, each, _GEOMETRY)
        for each in (raw_only, replace(raw_only, name="corrected", is_corrected=True))
    )
    assert raw.bias == 0.0 < corrected.bias < 0.1
    assert raw.depth_m < corrected.depth_m < 1.1 * raw.depth_m
    forces = [each.force_at(1.02 * raw.depth_m) for each in (raw, corrected)]
    assert forces[0] == pytest.approx((1.0 + corrected.bias) * forces[1], rel=1e-6)
    assert raw.row.solve_s > 0.0
    assert raw.row.setup_s > 0.0


@given(st.lists(st.tuples(st.floats(0.0, 1e3), st.floats(0.0, 1.0)), min_size=1))
def test_the_front_is_what_nothing_beats(points: list[tuple[float, float]]) -> None:
    """Every point off the front is beaten by one on it; none on it is beaten."""
    on = front_of(points)
    front = [point for point, is_on in zip(points, on, strict=True) if is_on]
    assert front
    for (cost, error), is_on in zip(points, on, strict=True):
        beaten = any(c <= cost and e <= error and (c, e) != (cost, error) for c, e in front)
        assert beaten is not is_on


def test_the_short_form_is_part_of_the_full_one() -> None:
    """At least twelve settings, each named once; the presets are among them."""
    names = [each.name for each in FULL]
    assert len(SHORT) >= 12
    assert set(SHORT) <= set(FULL)
    assert len(set(names)) == len(names)
    assert {c.name for c in SHORT if c.is_preset} == {"paper", "fast", "balanced", "accurate"}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_seed_means_another_mesh_of_about_the_same_size(seed: int) -> None:
    """Edges change by at most 7 %, and by something; the paper's one mesh stays."""
    other = reseeded(_EXACT, seed)
    assert 0.0 < abs(other.refinement - 1.0) <= 0.07
    paper = Configuration(name="paper", preset=Preset.PAPER, element=ElementOrder.P1)
    assert reseeded(paper, seed) == paper


_ERRORS = dict.fromkeys(QUANTITIES, 0.01)


def test_seeds_agree_within_the_bar_or_say_where_not() -> None:
    """Twice the first run's own bar is allowed: either run may be off by it."""
    first = Row(configuration=_EXACT, errors=_ERRORS, chances=dict.fromkeys(QUANTITIES, 0.0025))
    bars = dict.fromkeys(QUANTITIES, 0.0)
    near = replace(first, errors={**_ERRORS, "force": 0.0149})
    assert seed_table([first], [near], bars, seed=1).passed
    far = replace(near, errors={**near.errors, "depth": 0.0151})
    table = seed_table([first], [far], bars, seed=1)
    assert not table.passed
    assert table.rows[0][-1] == "depth"
    assert "5 of 6" in table.note


def test_chance_is_measured_or_taken_from_the_finest_that_was() -> None:
    """A finer mesh has the share of its error that the finest measured one has, within bounds."""
    coarse = replace(_EXACT, refinement=0.25)
    known = [
        Row(configuration=each, errors={"force": error}, chances={"force": chance}, tet_count=count)
        for each, error, chance, count in ((coarse, 0.2, 0.01, 100), (_EXACT, 0.05, 0.02, 1000))
    ]
    assert chances(_EXACT, {"force": 0.05}, known) == {"force": 0.02}
    assert chances(coarse, {"force": 0.2}, known) == {"force": pytest.approx(0.05)}
    finer = replace(_EXACT, preset=Preset.BALANCED)
    assert chances(finer, {"force": 0.02}, known) == {"force": pytest.approx(0.008)}
    paper = Configuration(name="paper", preset=Preset.PAPER, element=ElementOrder.P1)
    assert chances(paper, {"force": 1.0}, known) == {"force": 0.0}
    assert chances(_LINEAR, {"force": 0.4}, known) == {"force": pytest.approx(0.1)}


def test_chance_is_measured_on_shifted_meshes() -> None:
    """Two more meshes are pressed; what they give is the chance of the settings between them."""
    judge = _judge(_EXACT)
    exact, coarse = finished([judge.row(_EXACT), judge.row(_COARSE, shifted=True)])
    assert coarse.chances["force"] >= 0.25 * abs(coarse.errors["force"])
    assert set(exact.chances) == set(QUANTITIES)


def test_a_page_holds_study_seeds_and_tolerances() -> None:
    """Of results that were kept: a table each, the first seed's with its bars."""
    terms = SceneTerms(indenter="sphere:diameter=8mm", sensor="digit", force="0.5N")
    study = Accuracy(terms, _alike, seeds=(0, 1), tolerances=True)
    row = Row(configuration=SHORT[7], errors=_ERRORS, chances=dict.fromkeys(QUANTITIES, 0.005))
    found = {
        "row": asdict(row),
        "bars": dict.fromkeys(QUANTITIES, 0.001),
        "reference": {"name": "reference", "wall_s": 1.0},
    }
    kept = dict.fromkeys(COLUMNS) | {"scene": HELD_OUT[0].name, "kept": "yes"}
    results = [
        Result(name="fast", found=found),
        Result(name="seed 1: fast", found=found),
        Result(name=f"tolerance: {HELD_OUT[0].name}", found=kept),
        Result(name="fast / 2", failure="no mesh"),
    ]
    text = study.page(results, About("tacauchy-rig study accuracy"), ["images/accuracy.png"])
    for title in ("Error against time", "The same on other meshes", "What a tolerance keeps"):
        assert f"## {title}" in text
    assert "6 of 6 errors" in text
    assert "| fast / 2 | no mesh |" in text
    (configuration,) = study.facts(results)["configurations"]
    assert configuration["force_error_relative"] == 0.01


_SHARP = replace(_SCENE, indenter=Cylinder(diameter_m=5e-3))


@given(
    limit=st.floats(0.1, 10.0),
    constant=st.floats(-0.1, 0.1),
    of=st.sampled_from([(1, _SHARP), (2, _SCENE)]),
)
def test_an_error_of_known_order_is_extrapolated_away(
    limit: float, constant: float, of: tuple[int, Scene]
) -> None:
    """F(h) = limit (1 + c h^p) on h and 1.5 h gives the limit exactly; half the way is doubted."""
    order, scene = of
    fine, coarse = (limit * (1.0 + constant * h**order) for h in (1.0, 1.5))
    found = extrapolated(fine, coarse, scene=scene)
    assert found.value == pytest.approx(limit, rel=1e-9)
    assert found.doubt == pytest.approx(0.5 * abs(constant), abs=1e-9)


_KEPT = dict.fromkeys(COLUMNS) | {"kept": "yes", COST: 1.0, CHOICE: 0.0}


def test_the_scenes_are_held_out_and_each_gets_a_preset() -> None:
    """Two times ten, of indenters that the other ten have not."""
    one, other = (
        {describe(press.scene.indenter) for press in each} for each in (HELD_OUT, SEEN_BEFORE)
    )
    assert not one & other
    loose = [each for each in HELD_OUT if each.tolerance.relative == 0.06]
    for each in loose:
        assert keeping(each.scene, each.tolerance).preset is not Preset.PAPER


def test_what_is_judged_is_corrected() -> None:
    """Where a tolerance chose two meshes; on one the force is the mesh's own."""
    scene = keeping_corrected(HELD_OUT[0].scene, Tolerance(relative=0.05))
    depth = judged_depth(scene)
    known = corrected_at(scene, depth)
    assert known is not None
    assert pressed(scene, depth)[0] == pytest.approx(known.force_n, rel=1e-9)
    raw, _ = pressed(replace(scene, path_refinement=None), depth)
    assert raw == pytest.approx((1.0 + known.bias_relative) * known.force_n, rel=3e-3)


def test_a_refusal_is_a_row_that_was_not_kept() -> None:
    """What no preset promises is shown with its reason, and counts as missed."""
    strict = HeldOut("strict", SEEN_BEFORE[0].scene, Tolerance(relative=1e-6))
    refused = check_tolerance(strict)
    assert refused["kept"] == "no"
    assert "comes nearest" in refused["refusal"]
    assert _table([refused]).rows[0][4] == "refused"
    assert not _table([refused]).passed


def test_nine_of_ten_kept_and_all_thrifty_is_a_pass() -> None:
    """An error above the tolerance may happen once; a price above twice the cheapest may not."""
    broken, dear = _KEPT | {"kept": "no"}, _KEPT | {COST: 2.5}
    assert _table([_KEPT] * 9 + [broken]).passed
    assert not _table([_KEPT] * 8 + [broken] * 2).passed
    assert not _table([_KEPT] * 9 + [dear]).passed


def test_the_choices_own_time_counts() -> None:
    """What was cheap once chosen is dear where choosing it took long; the note has both."""
    slow = _KEPT | {COST: 2.4, CHOICE: 0.9}
    found = _table([_KEPT] * 9 + [slow])
    assert not found.passed
    assert "on 9, the choice's own time included; on 10 without it" in found.note


def _table(found: Sequence[dict[str, Any]]) -> Table:
    return tolerance_table(found)
