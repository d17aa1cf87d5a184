"""The benchmark: what it counts and how it fits; no time is judged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.batch.environment import Course
from sim.fields.surface import SurfaceState
from sim.scene.indenter import Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Preset, Scene, Target
from sim.sensor.camera_geometry import ImageArray
from sim.studies.bench import suite
from sim.studies.bench.batches import BALANCE, exact_force, measure_batches, spread
from sim.studies.bench.frames import FRAME_COUNT
from sim.studies.bench.growth import exponent, growth, local_exponents
from sim.studies.bench.part import Part
from sim.studies.bench.rendering import measure_rendering
from sim.studies.bench.replays import ReplayRow, measure_replay, peak_memory_mib
from sim.studies.bench.suite import Benchmark
from sim.studies.bench.tables import bench_tables

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
        preset="balanced",
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
    exact_n = exact_force(_SCENE, preset=Preset.FAST)
    batches = measure_batches(_SCENE, device="cpu", counts=(1, 3), exact_n=exact_n)
    return Benchmark(
        batches=tuple(batches),
        rendering=tuple(measure_rendering(_SCENE, sensors=("digit",), budget_s=0.1)),
        replays=(_replay(),),
        growth=tuple(growth(_SCENE, depth_m=0.1e-3, refinements=(0.5, 0.7))),
        absent=("nothing", "many images"),
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


def test_a_replay_makes_an_image_of_every_press() -> None:
    """Two forces, two images, both in its time."""
    surfaces: list[SurfaceState] = []
    row = measure_replay(
        replace(_SCENE, sensor="gelsight-mini"),
        Preset.FAST,
        [0.2, 0.1],
        lambda surface: (surfaces.append(surface), _image_of(surface))[1],
    )
    assert len(surfaces) == row.trial_count == 2
    assert row.wall_s == row.presses_s + row.images_s
    assert 0.0 < row.memory_mib <= peak_memory_mib()


def test_batches_are_counted_over_all_environments(found: Benchmark) -> None:
    """Three environments: three times the frames of one in that time; the first is the scene."""
    alone, three = found.batches
    assert three.frames_per_s == pytest.approx(3 * FRAME_COUNT / three.wall_s)
    assert three.frame_ms == pytest.approx(1e3 * three.wall_s / FRAME_COUNT)
    assert three.force_error == pytest.approx(alone.force_error, abs=1e-4)
    assert max(alone.imbalance, three.imbalance) <= BALANCE
    assert alone.failed_count == three.failed_count == 0


def test_every_launch_of_a_step_is_timed(found: Benchmark) -> None:
    """In the order of the launches, and none takes no time."""
    for batch in found.batches:
        names = ["gel", "contact", "judge", "prepare", "inverse", "turn"]
        assert list(batch.parts_s) == names
        assert min(batch.parts_s.values()) > 0.0


def test_taking_the_stress_off_is_timed(found: Benchmark) -> None:
    """On the device and to the host, with the number of faces that each environment has."""
    alone, three = (batch.stress for batch in found.batches)
    assert alone.face_count == three.face_count > 0
    assert min(alone.device_s, alone.host_s, three.device_s, three.host_s) > 0.0


def test_environments_differ_but_the_first() -> None:
    """The first is the scene itself; others are up to a tenth stiffer and shallower."""
    course = Course(depths_m=np.array([0.5e-3, 1e-3]))
    young, depths = [], []
    for environment, own in spread(_SCENE, course, 5):
        assert environment.materials is not None
        young.append(environment.materials[0].young_pa)
        depths.append(own.along[-1])
    assert (young[0], depths[0]) == (_SCENE.material.young_pa, 1e-3)
    assert len(set(young)) == len(set(depths)) == 5
    assert all(1.0 <= other / young[0] <= 1.1 for other in young)
    assert all(0.9 <= other / depths[0] <= 1.0 for other in depths)


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
    """One row a batch, an image, a replay, a mesh; what is absent is said."""
    tables = bench_tables(found)
    assert [len(table.rows) for table in tables] == [2, 2, 2, 4, 1, 2]
    assert all(len(row) == len(table.columns) for table in tables for row in table.rows)
    assert "Not measured: nothing." in tables[0].note
    assert "Not measured: many images." in tables[3].note
    assert "exponent" in tables[5].columns[-1]


def test_only_what_was_asked_for_is_measured(
    found: Benchmark, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One part: its table and no other."""
    monkeypatch.setattr(suite, "growth", lambda *_, **__: found.growth)
    only = suite.run_bench(_SCENE, _image_of, [0.5], parts=(Part.GROWTH,))
    titles = [table.title for table in bench_tables(found)]
    assert [table.title for table in bench_tables(only)] == titles[5:]
