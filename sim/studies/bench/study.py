"""The benchmark: how long the simulator's work takes, in parts, and presses of every kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sim.effects.effect_choice import plan_effects
from sim.effects.press_with_effects import path_for
from sim.press_arguments import scene_of
from sim.scene.scene import Preset, Scene, SceneTerms
from sim.sensor.sensor import Sensor, load_sensor
from sim.studies.bench import Part, rendering, scenes, sensor_batches
from sim.studies.bench.timed_press import press_reference, press_scene
from sim.tolerance import Tolerance, parse_tolerance
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.study import Case, Result, Study, failures_table
from tacauchy_rig.core.tables import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REFERENCE_FILE = Path("docs/results/benchmarks/scenes_reference.json")
SCENE_LIMIT_S = 1800.0
_WARM_M = 0.02e-3
# What measures a part but the scenes, and what shows its rows.
_PARTS: dict[Part, tuple[Callable[..., Any], Callable[[Sequence[rendering.Row]], Table]]] = {
    Part.REPLAY: (rendering.measure_replay, rendering.replay_table),
    Part.RENDERING: (rendering.measure_rendering, rendering.rendering_table),
    Part.UNLIKE: (sensor_batches.measure_unlike, sensor_batches.unlike_table),
    Part.MOVING: (sensor_batches.measure_moving, sensor_batches.moving_table),
    Part.ALONE: (sensor_batches.measure_alone, sensor_batches.alone_table),
}
_DRAWN = (Part.UNLIKE, Part.MOVING)
_REFERENCE = "reference: "


@dataclass(kw_only=True)
class Bench(Study):
    """Parts in this process, every scene in one of its own."""

    terms: SceneTerms  # what parts but the scenes press
    forces_n: Sequence[float]  # of the replay [N]
    # Makes, of a sensor, what turns a pressed surface into a replay's image
    make_images: Callable[[Sensor], rendering.ImageOf]
    chosen: Sequence[Part] = tuple(Part)  # parts that are measured
    # Seed of scenes that are drawn in place of the table's, and of unlike presses and moving tools
    drawn: int | None = None
    manners: Sequence[scenes.Manner] = (scenes.Manner(),)  # how the scenes are pressed
    reference: bool = False  # press them with preset reference first
    against: Path = REFERENCE_FILE  # references that are kept

    name, title, kind = "bench", "Benchmark", "part"

    def __post_init__(self) -> None:
        for manner in self.manners:
            parse_tolerance(manner.tolerance, field="--tolerance")
            if manner.images and manner.environments is None:
                raise ConfigError("--images is for batches", remedy="give --environments too")
        if list(self.chosen) == [Part.SCENES]:
            self.name, self.title = "scenes", "Benchmark: scenes"  # type: ignore[misc]

    @property
    def _scenes(self) -> scenes.Scenes:
        if Part.SCENES not in self.chosen:
            return {}
        return scenes.all_scenes() if self.drawn is None else scenes.drawn_scenes(self.drawn)

    def pattern(self, text: str) -> str:
        """Return a pattern that is met by every name that has the text in it."""
        return f"*{text}*"

    def cases(self) -> Sequence[Case]:
        """Return the parts, then the scenes' references, then the scenes in every manner."""
        cases = [
            Case(name=part.value, measure=partial(self._measured, part))
            for part in _PARTS
            if part in self.chosen
        ]
        if self.reference:
            cases += [
                Case(
                    name=f"{_REFERENCE}{name}",
                    measure=partial(press_reference, stated),
                    limit_s=SCENE_LIMIT_S,
                    is_isolated=True,
                )
                for name, stated in self._scenes.items()
            ]
        return cases + [
            Case(
                name=self._named(scene, manner),
                alias=scene,
                shows=f"{manner.text}: {', '.join(f'{k} {v}' for k, v in stated.items())}",
                measure=partial(press_scene, stated, manner),
                limit_s=SCENE_LIMIT_S,
                is_isolated=True,
                # Batches share a pilot.
                process=scene if manner.environments else "",
            )
            for scene, stated in self._scenes.items()
            for manner in self.manners
        ]

    def _named(self, scene: str, manner: scenes.Manner) -> str:
        return scene if len(self.manners) == 1 else f"{scene} ({manner.text})"

    def line(self, result: Result) -> str:
        """Return the speed of a scene, or how long a part took."""
        rows = [row for rows in self._groups([result], {}) for row in rows]
        return rows[0].text if rows else super().line(result)

    def _groups(
        self, results: Sequence[Result], references: Mapping[str, scenes.Reference]
    ) -> list[list[scenes.SceneRow]]:
        """Return the scenes that were pressed, by manner."""
        known = {result.name: result for result in results}
        groups = [
            [
                scenes.SceneRow(
                    scene=scene,
                    manner=manner,
                    press=None if found.failure else scenes.read_press(found.found),
                    failure=found.failure,
                    reference=references.get(scene),
                )
                for scene in self._scenes
                if (found := known.get(self._named(scene, manner)))
            ]
            for manner in self.manners
        ]
        return list(filter(None, groups))

    def _references(self, results: Sequence[Result]) -> dict[str, scenes.Reference]:
        """Return what the scenes' forces are compared with: kept, and measured now."""
        found = scenes.read_references(self.against, {**scenes.all_scenes(), **self._scenes})
        for result in results:
            name = result.name.removeprefix(_REFERENCE)
            if name != result.name and not result.failure:
                found[name] = scenes.Reference(
                    stated=self._scenes[name], press=scenes.read_press(result.found)
                )
        return found

    def _rows(self, results: Sequence[Result], part: Part) -> list[rendering.Row]:
        """Return the rows of a part; none where it was not measured."""
        found = [each.found for each in results if each.name == part and not each.failure]
        return found[0] if found else []

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return a table for each part, and several for the scenes in each manner."""
        tables = [show(rows) for p, (_, show) in _PARTS.items() if (rows := self._rows(results, p))]
        for group in self._groups(results, self._references(results)):
            tables += scenes.scene_tables(group)
        return [*tables, *failures_table(results, kind=self.kind)]

    def facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the parts' rows, the scenes' groups and references, and one row a press."""
        references = self._references(results)
        groups = self._groups(results, references)
        return {
            **{part.value: rows for part in _PARTS if (rows := self._rows(results, part))},
            "groups": [[row.as_json() for row in rows] for rows in groups],
            "references": references,
            "rows": [
                {
                    "name": row.scene,
                    "device": row.manner.device,
                    "environments": row.manner.environments or 1,
                    "ms_per_frame": 1e3 / row.frames_per_s,
                    "frames_per_s": row.frames_per_s,
                    "force_error_relative": row.error(),
                    "balance_relative": row.press.balance,
                }
                for rows in groups
                for row in rows
                if row.press is not None
            ],
        }

    def figures(self, results: Sequence[Result]) -> Mapping[str, Figure]:
        """Draw the scenes' speed."""
        groups = [g for g in self._groups(results, {}) if any(row.press for row in g)]
        return {"scenes": scenes.scenes_figure(groups)} if groups else {}

    def note(self, results: Sequence[Result]) -> str:
        """Return what the parts press."""
        del results
        return f"{self.terms.indenter} into {self.terms.sensor}." if self.name == "bench" else ""

    def _measured(self, part: Part) -> list[rendering.Row]:
        scene = scene_of(self.terms)
        _warm_up(scene)
        measure, _ = _PARTS[part]
        if part is not Part.REPLAY:
            given = {"seed": self.drawn} if self.drawn and part in _DRAWN else {}
            if part is Part.UNLIKE:
                given["count"] = self.manners[0].environments or 0
            return list(measure(scene, **given))
        replayed = partial(
            measure, scene, self.forces_n, self.make_images(load_sensor(scene.sensor))
        )
        return [replayed(), replayed(tolerance=Tolerance(relative=rendering.FORCE_ERROR_MAX))]


@cache
def _warm_up(scene: Scene) -> None:
    """Compile and load the kernels, which no time should hold."""
    small = replace(scene, preset=Preset.FAST)
    path_for(small, plan_effects(small), refinement=0.5).advance(_WARM_M)
