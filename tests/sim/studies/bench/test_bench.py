"""The benchmark: what it counts and how it fits; no time is judged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.error.tolerance import Tolerance
from sim.fields.surface import SurfaceState
from sim.scene.indenter import Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Preset, Scene, Target
from sim.studies.bench import suite
from sim.studies.bench.growth import exponent, growth, local_exponents
from sim.studies.bench.part import Part
from sim.studies.bench.rendering import measure_rendering
from sim.studies.bench.replays import ReplayRow, measure_replay, peak_memory_mib
from sim.studies.bench.suite import Benchmark
from sim.studies.bench.tables import bench_tables
from tacauchy_rig.core.arrays import ImageArray

_SCENE = Scene(
    pad=DiscPad(radius_m=9e-3, height_m=5e-3),
    material=Material(young_pa=0.4e6, poisson=0.45),
    indenter=Sphere(diameter_m=12e-3),
    target=Target(depth_m=1e-3),
    preset=Preset.FAST,
)


def _image_of(surface: SurfaceState) -> ImageArray:
    assert surface.positions.shape == surface.positions_rest.shape
    return np.zeros((4, 4, 3), dtype=np.uint8)


def _replay(*, error: float | None = 0.015, presses_s: float = 9.0) -> ReplayRow:
    return ReplayRow(
        setting="balanced",
        trial_count=6,
        newton_iterations=60,
        presses_s=presses_s,
        images_s=1.0,
        force_error=error,
        memory_mib=400.0,
    )


@given(
    power=st.floats(0.2, 3.0),
    factor=st.floats(1e-6, 1e3),
    sizes=st.lists(st.integers(10, 10**6), min_size=2, max_size=6, unique=True),
)
def test_a_power_law_is_fitted_exactly(power: float, factor: float, sizes: list[int]) -> None:
    """Fitted through all and between neighbours, the exponent is the law's."""
    grown = sorted(float(size) for size in sizes)
    times = [factor * size**power for size in grown]
    assert exponent(grown, times) == pytest.approx(power, rel=1e-6)
    for local in local_exponents(grown, times):
        assert local == pytest.approx(power, rel=1e-4)


def test_growth_is_over_finer_meshes_of_the_same_press() -> None:
    """Elements grow with refinement; every row is a press that converged."""
    rows = growth(_SCENE, depth_m=0.1e-3, refinements=(0.5, 0.8))
    assert rows[0].tet_count < rows[1].tet_count
    assert all(row.newton_iterations > 0 and row.cpu_s > 0.0 for row in rows)


@pytest.fixture(scope="module")
def found() -> Benchmark:
    """Return a benchmark of a coarse ball press; its replay is made up."""
    return Benchmark(
        rendering=tuple(measure_rendering(_SCENE, sensors=("digit",), budget_s=0.1)),
        replays=(_replay(),),
        growth=tuple(growth(_SCENE, depth_m=0.1e-3, refinements=(0.5, 0.7))),
        absent=("many images",),
    )


@pytest.mark.parametrize(
    ("row", "met"),
    [
        (_replay(), True),
        (_replay(error=0.021), False),
        (_replay(error=None), False),
        (_replay(presses_s=19.5), False),
    ],
)
def test_a_replay_counts_if_it_is_close_and_in_time(row: ReplayRow, met: bool) -> None:
    """A believed error above 2 %, none, or more than 20 s with images: the criterion is missed."""
    (table,) = bench_tables(Benchmark(replays=(row,)))
    assert table.passed is met


def test_a_replay_takes_the_cheapest_settings_that_promise_a_tolerance() -> None:
    """A fifth of the force is more than preset fast promises: longer edges do."""
    scene = replace(_SCENE, sensor="gelsight-mini")
    row = measure_replay(scene, [0.2], _image_of, tolerance=Tolerance(relative=0.2))
    assert row.setting == "fast, edges 1.11 times as long"
    assert row.force_error is not None
    assert row.force_error < 0.2


def test_a_replay_makes_an_image_of_every_press() -> None:
    """Two forces, two images, both in its time."""
    surfaces: list[SurfaceState] = []
    row = measure_replay(
        replace(_SCENE, sensor="gelsight-mini"),
        [0.2, 0.1],
        lambda surface: (surfaces.append(surface), _image_of(surface))[1],
    )
    assert len(surfaces) == row.trial_count == 2
    assert row.wall_s == row.presses_s + row.images_s
    assert 0.0 < row.memory_mib <= peak_memory_mib()


def test_a_batch_renders_what_is_rendered_one_by_one(found: Benchmark) -> None:
    """With samples, shadows and blur, no value is more than one grey level apart."""
    plain, alone, together, from_nodes = found.rendering
    assert (plain.samples, alone.samples, together.samples) == (1, 2, 2)
    assert (alone.renderer, alone.image_count) == ("one by one", 1)
    for row in (together, from_nodes):
        assert row.image_count > 1
        assert row.shadow_count == 3
        assert row.apart_levels <= 1
        assert row.apart_share < 1e-3
        assert 0.0 < row.least_s <= row.median_s


def test_tables_hold_every_row(found: Benchmark) -> None:
    """One row an image, a replay, a mesh; what is absent is said."""
    tables = bench_tables(found)
    assert [len(table.rows) for table in tables] == [4, 1, 2]
    assert all(len(row) == len(table.columns) for table in tables for row in table.rows)
    assert "Not measured: many images." in tables[0].note
    assert "exponent" in tables[2].columns[-1]


def test_only_what_was_asked_for_is_measured(
    found: Benchmark, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One part: its table and no other."""
    monkeypatch.setattr(suite, "growth", lambda *_, **__: found.growth)
    only = suite.run_bench(_SCENE, _image_of, [0.5], parts=(Part.GROWTH,))
    titles = [table.title for table in bench_tables(found)]
    assert [table.title for table in bench_tables(only)] == titles[2:]
