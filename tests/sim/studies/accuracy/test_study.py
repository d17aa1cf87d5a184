"""The study of accuracy against time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.mesh.elements import ElementOrder
from sim.optics.height.height_map import HeightMaps
from sim.scene.indenter import Sphere
from sim.scene.material import Material
from sim.scene.pad import BoxPad
from sim.scene.scene import Preset, Scene, Target
from sim.sensor.camera_geometry import CameraGeometry
from sim.studies.accuracy.configurations import FULL, SHORT, Configuration, reseeded
from sim.studies.accuracy.observation import Row
from sim.studies.accuracy.study import (
    QUANTITIES,
    chances,
    error_bar,
    front_of,
    study,
)
from sim.studies.accuracy.tables import seed_table
from tacauchy_rig.core.arrays import ImageArray

_GEOMETRY = CameraGeometry(
    width=40,
    height=30,
    scale_x_m=0.4e-3,
    scale_y_m=0.4e-3,
    centre_x_px=19.5,
    centre_y_px=14.5,
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


def test_a_locking_element_is_seen_as_too_stiff() -> None:
    """Linear tetrahedra push back harder than the limit of quadratic ones.

    Towards that limit errors fall by 1.5 squared, as it was extrapolated; half of what is left is
    doubted. What is not extrapolated may be off by what order 1 leaves, of two coarser meshes the
    one that tells more.
    """
    found = study(
        _SCENE,
        (_EXACT, _COARSE, _COARSEST, _LINEAR),
        _GEOMETRY,
        render=_image,
        similarity=_alike,
        reference=_EXACT,
    )
    exact, coarse, coarsest, linear = found.rows
    assert exact.errors["image"] == 0.0
    assert coarse.errors["force"] == pytest.approx(1.5**2 * exact.errors["force"], rel=1e-6)
    assert found.bars["force"] == pytest.approx(0.5 * abs(exact.errors["force"]), rel=1e-6)
    told = [2.0 * abs(coarse.errors["radius"]), abs(coarsest.errors["radius"]) / (1.5**2 - 1.0)]
    assert found.bars["radius"] == pytest.approx(max(told), rel=1e-6)
    assert linear.errors["force"] > 0.05
    assert linear.errors["depth"] < 0.0
    assert any(row.on_front for row in found.rows)


def test_what_cannot_be_simulated_is_a_row_that_says_so() -> None:
    """A failure is shown, not dropped."""
    absurd = Configuration(name="absurd", preset=Preset.FAST, refinement=1e-3, barrier_m=10.0)
    found = study(
        _SCENE,
        (absurd,),
        _GEOMETRY,
        render=_image,
        similarity=_alike,
        reference=_COARSE,
    )
    assert found.rows[0].failure
    assert not found.rows[0].on_front


@given(st.lists(st.tuples(st.floats(0.0, 1e3), st.floats(0.0, 1.0)), min_size=1))
def test_the_front_is_what_nothing_beats(points: list[tuple[float, float]]) -> None:
    """Every point off the front is beaten by one on it; none on it is beaten."""
    on = front_of(points)
    front = [point for point, is_on in zip(points, on, strict=True) if is_on]
    assert front
    for (cost, error), is_on in zip(points, on, strict=True):
        beaten = any(c <= cost and e <= error and (c, e) != (cost, error) for c, e in front)
        assert beaten is not is_on


def test_nan_is_never_on_the_front() -> None:
    """A configuration without a number beats nobody."""
    assert front_of([(np.nan, 0.1), (1.0, np.nan), (2.0, 0.5)]) == [False, False, True]


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
    bars = {"a": dict.fromkeys(QUANTITIES, 0.0025)}
    near = {**_ERRORS, "force": 0.0149}
    alike = seed_table({"a": _ERRORS}, {"a": near}, bars, seed=1, command="c")
    assert alike.passed
    far = seed_table({"a": _ERRORS}, {"a": {**near, "depth": 0.0151}}, bars, seed=1, command="c")
    assert not far.passed
    assert far.rows[0][-1] == "depth"
    assert "5 of 6" in far.note


def test_a_bar_holds_the_references_doubt_and_the_meshs_chance() -> None:
    """F / F_ref - 1 = 100 % is off by twice what F_ref is."""
    assert error_bar(0.01, 1.0, 0.0) == pytest.approx(0.02)
    assert error_bar(0.01, -0.5, 0.2) == pytest.approx(0.215)


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


def test_a_study_measures_chance_on_shifted_meshes() -> None:
    """Two more meshes are pressed; what they give is the chance of the settings between them."""
    found = study(
        _SCENE,
        (_EXACT, _COARSE),
        _GEOMETRY,
        render=_image,
        similarity=_alike,
        reference=_EXACT,
        shifted=(_COARSE,),
    )
    chance = found.rows[1].chances["force"]
    assert chance >= 0.25 * abs(found.rows[1].errors["force"])
    assert set(found.rows[0].chances) == set(QUANTITIES)
