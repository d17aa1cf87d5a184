"""The benchmark's parts."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.error import Tolerance
from sim.fields.surface import SurfaceState
from sim.press_command import scene_from
from sim.scene.indenter import Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Preset, Scene, SceneTerms, Target
from sim.studies.bench import Part, parts
from sim.studies.bench.parts import (
    BELIEVED,
    exponent,
    growth_figure,
    growth_table,
    local_exponents,
    measure_growth,
    measure_replay,
    peak_memory_mib,
    replay_table,
)
from sim.studies.bench.rendering import measure_rendering, rendering_table
from sim.studies.bench.scenes import Manner
from sim.studies.bench.study import Bench
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.errors import ConfigError, RigError
from tacauchy_rig.core.study import About, Result

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


def _replay(*, error: float | None = 1.5, together_s: float = 10.0) -> dict[str, Any]:
    return {BELIEVED: error, "together [s]": together_s, "peak memory [MiB]": 400.0}


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
    coarse, fine = measure_growth(_SCENE, depth_m=0.1e-3, refinements=(0.5, 0.8))
    assert coarse["tetrahedra"] < fine["tetrahedra"]
    for row in (coarse, fine):
        assert row["iterations"] > 0
        assert row["processor time [s]"] > 0.0


@pytest.fixture(scope="module")
def rendered() -> list[dict[str, Any]]:
    """Return the images of a coarse ball press."""
    return list(measure_rendering(_SCENE, sensors=("digit",), budget_s=0.1))


@pytest.mark.parametrize(
    ("row", "met"),
    [
        (_replay(), True),
        (_replay(error=2.1), False),
        (_replay(error=None), False),
        (_replay(together_s=20.5), False),
    ],
)
def test_a_replay_counts_if_it_is_close_and_in_time(row: dict[str, Any], met: bool) -> None:
    """A believed error above 2 %, none, or more than 20 s with images: the criterion is missed."""
    assert replay_table([row]).passed is met


def test_a_replay_takes_the_cheapest_settings_that_promise_a_tolerance() -> None:
    """A fifth of the force is more than preset fast promises: longer edges do."""
    scene = replace(_SCENE, sensor="gelsight-mini")
    row = measure_replay(scene, [0.2], _image_of, tolerance=Tolerance(relative=0.2))
    assert row["preset"] == "fast, edges 1.11 times as long"
    assert row[BELIEVED] < 20.0


def test_a_replay_makes_an_image_of_every_press() -> None:
    """Two forces, two images, both in its time."""
    surfaces: list[SurfaceState] = []
    row = measure_replay(
        replace(_SCENE, sensor="gelsight-mini"),
        [0.2, 0.1],
        lambda surface: (surfaces.append(surface), _image_of(surface))[1],
    )
    assert len(surfaces) == row["presses"] == 2
    parts = row["presses and fields [s]"] + row["images [s]"]
    assert row["together [s]"] == pytest.approx(parts)
    assert 0.0 < row["peak memory [MiB]"] <= peak_memory_mib()


def test_a_batch_renders_what_is_rendered_one_by_one(rendered: list[dict[str, Any]]) -> None:
    """With samples, shadows and blur, no value is more than one grey level apart."""
    plain, alone, together, from_nodes = rendered
    assert [row["samples"] for row in (plain, alone, together)] == ["1x1", "2x2", "2x2"]
    assert (alone["renderer"], alone["images"]) == ("one by one", 1)
    for row in (together, from_nodes):
        assert row["images"] > 1
        assert row["shadows"] == 3
        assert row["apart [levels]"] <= 1
        assert row["apart [%]"] < 0.1
        assert 0.0 < row["least [ms]"] <= row["image [ms]"]


def test_tables_hold_every_row(rendered: list[dict[str, Any]]) -> None:
    """One row an image, a mesh; what is absent is said."""
    images, meshes = rendering_table(rendered), growth_table(_GROWTH)
    assert [len(images.rows), len(meshes.rows)] == [4, 3]
    assert all(len(row) == len(table.columns) for table in (images, meshes) for row in table.rows)
    assert "exponent" in meshes.columns[-1]


_GROWTH = [
    {"edges shorter by": 1.0, "tetrahedra": size, "iterations": 10, "processor time [s]": cpu_s}
    for size, cpu_s in ((300, 1.0), (1000, 2.5), (3000, 12.0))
]


def test_a_figure_is_wide_enough_to_print_with_something_on_it(tmp_path: Path) -> None:
    """Growth with elements."""
    file = tmp_path / "bench.png"
    growth_figure(_GROWTH).savefig(file, dpi=300)
    picture = cv2.imread(str(file))
    assert picture is not None
    assert picture.shape[1] > 1200
    assert picture.std() > 5.0


def _bench(*manners: Manner, parts: tuple[Part, ...] = (Part.SCENES,)) -> Bench:
    terms = SceneTerms(indenter="sphere:diameter=8mm", sensor="gelsight-mini", depth="1mm")
    return Bench(
        terms=terms, forces_n=(1.0,), make_images=lambda _: _image_of, chosen=parts, manners=manners
    )


def test_every_manner_is_pressed_and_shown() -> None:
    """Two tolerances: both for each scene, on the page and in JSON; failures too."""
    study = _bench(Manner(), Manner(tolerance="1%"))
    cases = [case for case in study.cases() if case.alias == "punch, tilted"]
    assert [case.name for case in cases] == [
        f"punch, tilted (cpu, alone, tolerance {tolerance})" for tolerance in ("5%", "1%")
    ]
    results = [Result(name=case.name, failure="the press stopped at 0.1 mm") for case in cases]
    page = study.page(results, About("tacauchy-rig study bench", open_count=1), [])
    assert page.count("| the press stopped at 0.1 mm |") == 2
    assert "Interrupted: 1 selected cases were not measured." in " ".join(page.split())
    assert [len(rows) for rows in study.facts(results)["groups"]] == [1, 1]
    assert study.name == "scenes"


def test_parts_and_scenes_share_a_page() -> None:
    """A part's rows come back from JSON; a scene's row has its speed."""
    study = _bench(Manner(), parts=(Part.GROWTH, Part.SCENES))
    results = [Result(name="growth", found=_GROWTH), Result(name="ball, shallow", failure="no")]
    assert study.page(results, About("x"), []).count("## ") >= 4
    assert study.facts(results)["growth"] == _GROWTH


def test_options_that_do_not_fit_together_are_refused() -> None:
    """Before anything is pressed, with the remedy."""
    with pytest.raises(ConfigError, match="for batches"):
        _bench(Manner(images=True))


WASTE = "sum(range(3_000_000)); print(42)"


def test_a_process_is_charged_with_its_own_time() -> None:
    """Time that it computes counts, time that this process computes does not."""
    cpu_s, wall_s, told = parts.process_spent([sys.executable, "-c", WASTE])
    assert told == "42\n"
    assert 0.0 < cpu_s < 10.0 * wall_s


def test_a_command_that_fails_gives_no_number() -> None:
    """Its error is told instead."""
    with pytest.raises(RigError, match="no_such_module"):
        parts.process_spent([sys.executable, "-c", "import no_such_module"])


@pytest.mark.slow
def test_threads_are_measured_by_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each size has a row for one thread and for two."""
    monkeypatch.setattr(parts, "_BUDGET_S", 0.0)
    scene = scene_from(
        "--pad box:10x10x3mm --young 0.1MPa --poisson 0.48 --indenter plane --depth 0.1mm"
    )
    rows = list(parts.measure_threads(scene, refinements=(0.5,)))
    assert {row["threads"] for row in rows} >= {1, 2}
    assert len({row["unknowns"] for row in rows}) == 1
    assert all(row["factor [ms]"] > 0.0 and row["solution [ms]"] > 0.0 for row in rows)


def test_processor_time_is_told_by_a_clock_of_ticks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Work shorter than the clock's tick is charged with its share of the ticks, not with none."""
    monkeypatch.setattr(parts, "_BUDGET_S", 1.0)
    spent_ms = [0]

    def work() -> None:
        spent_ms[0] += 3

    clock = SimpleNamespace(
        perf_counter=lambda: 1e-3 * spent_ms[0], process_time=lambda: 1e-2 * (spent_ms[0] // 10)
    )
    monkeypatch.setattr(parts, "time", clock)
    wall_s, cpu_s = parts.work_spent(work)
    assert wall_s == pytest.approx(0.003)
    assert cpu_s == pytest.approx(0.003, rel=0.02)
