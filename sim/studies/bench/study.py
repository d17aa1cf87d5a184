"""The benchmark: how long the simulator's work takes, in parts, and presses of every kind."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.error import Tolerance, parse_tolerance
from sim.press_command import scene_of
from sim.scene.scene import Preset, Scene, SceneTerms
from sim.sensor.sensor import Sensor, load_sensor
from sim.studies.bench import Part
from sim.studies.bench.alone import alone_table, measure_alone
from sim.studies.bench.parts import (
    FORCE_ERROR_MAX,
    ImageOf,
    Row,
    draw_growth,
    growth_table,
    measure_growth,
    measure_replay,
    measure_start,
    measure_threads,
    replay_table,
    start_table,
    threads_table,
)
from sim.studies.bench.press import press_reference, press_scene
from sim.studies.bench.rendering import measure_rendering, rendering_table
from sim.studies.bench.scene_tables import draw_scenes, scene_tables
from sim.studies.bench.scenes import (
    BenchScene,
    Manner,
    Reference,
    ScenePress,
    SceneRow,
    all_scenes,
    drawn_scenes,
    read_references,
)
from sim.studies.bench.unlike import measure_unlike, unlike_table
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.parallel import IsolatedWorker, ProcessFailedError
from tacauchy_rig.core.study import Case, Result, Study, failures_table
from tacauchy_rig.core.tables import Table

REFERENCE_FILE = Path("docs/results/benchmarks/scenes_reference.json")
SCENE_LIMIT_S = 1800.0
_GROWTH_DEPTH_M, _WARM_M = 0.5e-3, 0.02e-3
_TABLES: dict[Part, Callable[[Sequence[Row]], Table]] = {
    Part.REPLAY: replay_table,
    Part.GROWTH: growth_table,
    Part.START: start_table,
    Part.THREADS: threads_table,
    Part.RENDERING: rendering_table,
    Part.UNLIKE: unlike_table,
    Part.ALONE: alone_table,
}
_press: Callable[[Any], ScenePress] = TypeAdapter(ScenePress).validate_python
# Presets of references; the next is taken where one does not come to its end.
_REFERENCES = (Preset.REFERENCE, Preset.ACCURATE, Preset.BALANCED)
_REFERENCE = "reference: "


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchOptions:
    """What is measured.

    Attributes:
        terms: What parts but the scenes press.
        forces_n: Of the replay [N].
        make_images: Makes, of a sensor, what turns a pressed surface into a replay's image.
        drawn: Seed of scenes that are drawn in place of the table's.
        manners: How the scenes are pressed.
        reference: Press them with preset reference first.
        against: References that are kept; ``REFERENCE_FILE`` if not given.
    """

    terms: SceneTerms
    forces_n: Sequence[float]
    make_images: Callable[[Sensor], ImageOf]
    parts: Sequence[Part] = tuple(Part)
    drawn: int | None = None
    manners: Sequence[Manner] = (Manner(),)
    reference: bool = False
    against: Path | None = None


class Bench(Study):
    """Parts in this process, every scene in one of its own.

    Raises:
        ConfigError: A tolerance is none, or options of batches are given without a batch.
    """

    name, title, kind = "bench", "Benchmark", "part"

    def __init__(self, options: BenchOptions) -> None:
        for manner in options.manners:
            parse_tolerance(manner.tolerance, field="--tolerance")
            if manner.extras and manner.environments is None:
                raise ConfigError(
                    "--images and --own-mesh are for batches", remedy="give --environments too"
                )
        self._options = options
        if list(options.parts) == [Part.SCENES]:
            self.name, self.title = "scenes", "Benchmark: scenes"  # type: ignore[misc]

    @property
    def _scenes(self) -> tuple[BenchScene, ...]:
        if Part.SCENES not in self._options.parts:
            return ()
        drawn = self._options.drawn
        return all_scenes() if drawn is None else drawn_scenes(drawn)

    def pattern(self, text: str) -> str:
        """Return a pattern that is met by every name that has the text in it."""
        return f"*{text}*"

    def cases(self) -> Sequence[Case]:
        """Return the parts, then the scenes' references, then the scenes in every manner."""
        options = self._options
        cases = [
            Case(name=part.value, measure=partial(_measured, part, options))
            for part in Part
            if part in options.parts and part is not Part.SCENES
        ]
        if options.reference:
            cases += [
                Case(name=f"{_REFERENCE}{each.name}", measure=partial(_reference, each.stated))
                for each in self._scenes
            ]
        return cases + [
            Case(
                name=_named(scene, manner, options.manners),
                alias=scene.name,
                shows=f"{manner.text}: {', '.join(f'{k} {v}' for k, v in scene.stated.items())}",
                measure=partial(_pressed, scene.stated, manner),
                limit_s=SCENE_LIMIT_S,
                is_isolated=True,
                # Batches share a pilot.
                process=scene.name if manner.environments else "",
            )
            for scene in self._scenes
            for manner in options.manners
        ]

    def line(self, result: Result) -> str:
        """Return the speed of a scene, or how long a part took."""
        rows = [row for rows in self.groups([result]) for row in rows]
        return rows[0].text if rows else super().line(result)

    def groups(self, results: Sequence[Result]) -> list[list[SceneRow]]:
        """Return the scenes that were pressed, by manner."""
        known = {result.name: result for result in results}
        found = []
        for manner in self._options.manners:
            names = {_named(each, manner, self._options.manners): each for each in self._scenes}
            rows = [
                SceneRow(
                    scene=scene.name,
                    manner=manner,
                    press=None if known[name].failure else _press(known[name].found),
                    failure=known[name].failure,
                )
                for name, scene in names.items()
                if name in known
            ]
            found += [rows] if rows else []
        return found

    def references(self, results: Sequence[Result]) -> dict[str, Reference]:
        """Return what the scenes' forces are compared with: kept, and measured now."""
        scenes = (*all_scenes(), *self._scenes)
        found = read_references(self._options.against or REFERENCE_FILE, scenes)
        stated = {f"{_REFERENCE}{each.name}": each for each in self._scenes}
        for result in results:
            if result.name in stated and not result.failure:
                scene = stated[result.name]
                found[scene.name] = Reference(stated=scene.stated, press=_press(result.found))
        return found

    def rows(self, results: Sequence[Result], part: Part) -> list[Row]:
        """Return the rows of a part; none where it was not measured."""
        found = [each.found for each in results if each.name == part and not each.failure]
        return found[0] if found else []

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return a table for each part, and several for the scenes in each manner."""
        tables = [table(rows) for p, table in _TABLES.items() if (rows := self.rows(results, p))]
        references = self.references(results)
        for group in self.groups(results):
            tables += scene_tables(group, references)
        return [*tables, *failures_table(results, kind=self.kind)]

    def facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the parts' rows, the scenes' groups and references, and one row a press."""
        references, groups = self.references(results), self.groups(results)
        return {
            **{part.value: rows for part in _TABLES if (rows := self.rows(results, part))},
            "groups": [[row.as_json() for row in rows] for rows in groups],
            "references": references,
            "rows": list(_speed_rows((row for rows in groups for row in rows), references)),
        }

    def draw(self, results: Sequence[Result], folder: Path, page_folder: Path) -> list[Path]:
        """Draw growth with elements, and the scenes' speed."""
        grown = self.rows(results, Part.GROWTH)
        drawn = draw_growth(grown, folder, page_folder=page_folder) if grown else []
        return drawn + draw_scenes(self.groups(results), folder, page_folder=page_folder)

    def note(self, results: Sequence[Result]) -> str:
        """Return what the parts press."""
        del results
        terms = self._options.terms
        return f"{terms.indenter} into {terms.sensor}." if self.name == "bench" else ""


def _named(scene: BenchScene, manner: Manner, manners: Sequence[Manner]) -> str:
    return scene.name if len(manners) == 1 else f"{scene.name} ({manner.text})"


def _speed_rows(
    rows: Iterable[SceneRow], references: Mapping[str, Reference]
) -> Iterable[dict[str, Any]]:
    for row in rows:
        if row.press is None:
            continue
        known = references.get(row.scene)
        yield {
            "name": row.scene,
            "device": row.manner.device,
            "environments": row.manner.environments or 1,
            "ms_per_frame": 1e3 / row.frames_per_s,
            "frames_per_s": row.frames_per_s,
            "force_error_relative": None if known is None else known.error(row.press),
            "balance_relative": row.press.balance,
        }


def _measured(part: Part, options: BenchOptions) -> list[Row]:
    scene = scene_of(options.terms)
    _warm_up(scene)
    measures: dict[Part, Callable[[], Iterable[Row]]] = {
        Part.REPLAY: lambda: _replays(scene, options),
        Part.GROWTH: lambda: measure_growth(scene, depth_m=_GROWTH_DEPTH_M),
        Part.START: measure_start,
        Part.THREADS: lambda: measure_threads(scene),
        Part.RENDERING: lambda: measure_rendering(scene),
        Part.UNLIKE: lambda: measure_unlike(scene),
        Part.ALONE: lambda: measure_alone(scene),
    }
    return list(measures[part]())


def _replays(scene: Scene, options: BenchOptions) -> list[Row]:
    replayed = partial(
        measure_replay, scene, options.forces_n, options.make_images(load_sensor(scene.sensor))
    )
    return [replayed(), replayed(tolerance=Tolerance(relative=FORCE_ERROR_MAX))]


@cache
def _warm_up(scene: Scene) -> None:
    """Compile and load the kernels, which no time should hold."""
    small = replace(scene, preset=Preset.FAST)
    path_for(small, plan_effects(small), refinement=0.5).advance(_WARM_M)


def _pressed(stated: Mapping[str, Any], manner: Manner) -> dict[str, Any]:
    return asdict(press_scene(stated, manner))


def _reference(stated: Mapping[str, Any]) -> dict[str, Any]:
    """Press a scene with the finest preset that comes to its end in time."""
    failure = ProcessFailedError("no preset was tried")
    for preset in _REFERENCES:
        with IsolatedWorker() as process:
            press = partial(press_reference, stated, preset.value)
            try:
                return asdict(process.call(press, limit_s=SCENE_LIMIT_S))
            except ProcessFailedError as error:
                failure = error
    raise failure
