"""The benchmark's parts."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sim.fields.saved_press import SurfaceState
from sim.scene.indenter import Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Preset, Scene, SceneTerms, Target
from sim.studies.bench import Part
from sim.studies.bench.rendering import (
    BELIEVED,
    measure_rendering,
    measure_replay,
    peak_memory_mib,
    rendering_table,
    replay_table,
)
from sim.studies.bench.scenes import Manner
from sim.studies.bench.study import Bench
from sim.tolerance import Tolerance
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.errors import ConfigError
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
    assert len(rendering_table(rendered).rows) == 4
    for row in (together, from_nodes):
        assert row["images"] > 1
        assert row["shadows"] == 3
        assert row["apart [levels]"] <= 1
        assert row["apart [%]"] < 0.1
        assert 0.0 < row["least [ms]"] <= row["image [ms]"]


def test_an_image_alone_has_its_markers() -> None:
    """Those that the sensor's file gives."""
    first = next(measure_rendering(_SCENE, sensors=("gelsight-mini",), budget_s=0.1))
    assert (first["renderer"], first["markers"]) == ("one by one", 63)


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
    study = _bench(Manner(), parts=(Part.REPLAY, Part.SCENES))
    replays = [_replay()]
    results = [Result(name="replay", found=replays), Result(name="ball, shallow", failure="no")]
    assert study.page(results, About("x"), []).count("## ") >= 4
    assert study.facts(results)["replay"] == replays


def test_options_that_do_not_fit_together_are_refused() -> None:
    """Before anything is pressed, with the remedy."""
    with pytest.raises(ConfigError, match="for batches"):
        _bench(Manner(images=True))
