"""The study of five objects: each pressed into sensors, drawn as their cameras see it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

from sim.scene.scene import Preset
from sim.sensor.sensor import load_sensor
from sim.studies.objects.figures import draw_objects
from sim.studies.objects.runs import DEPTH_M, ObjectPress, press_object
from sim.studies.objects.shapes import OBJECTS
from tacauchy_rig.core.page import page
from tacauchy_rig.core.study import About, Case, Result, Study, failures_table, founds
from tacauchy_rig.core.tables import Table, table_of_rows


class Objects(Study):
    """Five objects, from sharp edges to smooth curves, in each sensor.

    Args:
        sensors: Names or files, with commas between.
        preset: Of the presses.
    """

    name, title, kind = "objects", "Five objects", "press"
    is_resumable = False

    def __init__(self, sensors: str, preset: Preset) -> None:
        names = [name.strip() for name in sensors.split(",") if name.strip()]
        self._sensors = {name: load_sensor(name) for name in names}
        self._preset = preset

    def cases(self) -> Sequence[Case]:
        """Return every object in every sensor."""
        return [
            Case(
                name=f"{label} in {name}",
                measure=partial(press_object, label, sensor, preset=self._preset),
                process=name,
            )
            for name, sensor in self._sensors.items()
            for label in OBJECTS
        ]

    def line(self, result: Result) -> str:
        """Return the force."""
        return result.failure or f"{result.found.force_n:.3f} N"

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return the presses; no pixel of a height map may lie above its object."""
        rows = [
            {
                "sensor": press.sensor,
                "object": press.name,
                "F_z [N]": press.force_n,
                "highest pixel above the object [um]": _seen_um(press),
                "time [s]": round(press.processor_s),
            }
            for press in founds(results)
        ]
        title = f"{DEPTH_M * 1e3:g} mm deep, preset {self._preset.value}, nominal optics"
        pressed = [table_of_rows(rows, title=title)] if rows else []
        return [*pressed, *failures_table(results, kind=self.kind)]

    def facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the presses."""
        rows = [
            {
                "sensor": press.sensor,
                "object": press.name,
                "force_n": press.force_n,
                "highest_over_object_m": press.highest_over_m,
                "processor_s": press.processor_s,
            }
            for press in founds(results)
        ]
        return {"preset": self._preset, "depth_m": DEPTH_M, "presses": rows}

    def draw(self, results: Sequence[Result], folder: Path, page_folder: Path) -> list[Path]:
        """Draw the objects, one a column, in the sensors that have them all."""
        groups = [list(rows) for _, rows in groupby(founds(results), key=lambda run: run.sensor)]
        most = max(map(len, groups))
        whole = [rows for rows in groups if len(rows) == most]
        return draw_objects(whole, folder, page_folder=page_folder)

    def page(self, results: Sequence[Result], about: About, images: Sequence[str]) -> str:
        """Return the page: the figure, the objects and their presses."""
        del images
        facts = {
            "command": about.command,
            "depth_m": DEPTH_M,
            "preset": self._preset,
            "bodies": OBJECTS,
            "presses": founds(results),
            "tables": self.tables(results),
        }
        return page("sim.studies.objects", "page.md.jinja", facts)


def _seen_um(press: ObjectPress) -> float:
    """Return the highest pixel above an object [um]; below a picometre it is rounding."""
    return 0.0 if press.highest_over_m < 1e-12 else 1e6 * press.highest_over_m
