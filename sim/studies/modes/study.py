"""The study of contact modes: a punch pressed, slid and turned, and a ball in three sensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import InitVar, dataclass
from functools import cache, partial
from typing import Any

from matplotlib.figure import Figure

from sim.scene.indenter import Cylinder, Sphere, describe
from sim.scene.scene import Preset
from sim.scene.terms import parse_indenter
from sim.sensor.sensor import load_sensor
from sim.studies.modes.figures import modes_figure, sensors_figure
from sim.studies.modes.runs import (
    BALL,
    BALL_PRESET,
    FRICTION,
    ModeRun,
    press_in,
    slide_mode,
    twist_mode,
)
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.study import Case, Result, Study, failures_table, founds
from tacauchy_rig.core.tables import Table, table_of

_MOVED_ON = "gelsight-mini"
_SENSORS = ("gelsight-mini", "digit", "9dtact")
_BALL = "ball on "


@dataclass
class Modes(Study):
    """A cylinder's or a sphere's modes on one sensor, then a ball's press on three.

    Raises:
        ConfigError: The indenter is not round.
    """

    indenter: InitVar[str]
    preset: Preset

    name, title, kind = "contact_modes", "Contact modes", "run"
    is_together, is_resumable, is_framed = True, False, True
    template = "page.md.jinja"

    def __post_init__(self, indenter: str) -> None:
        body = parse_indenter(indenter)
        if not isinstance(body, Cylinder | Sphere):
            raise ConfigError(
                f"--indenter {describe(body)}: only round bodies can be slid and turned here",
                remedy="give a cylinder with a fillet, or a sphere",
            )
        self._body = body

    def cases(self) -> Sequence[Case]:
        """Return the modes, which go on from the press, and the ball's presses."""

        @cache
        def pressed() -> ModeRun:
            return press_in(load_sensor(_MOVED_ON), self._body, preset=self.preset)

        modes: dict[str, Callable[[], ModeRun]] = {
            "press": pressed,
            "slide": lambda: slide_mode(pressed()),
            "twist": lambda: twist_mode(pressed()),
            **{
                f"{_BALL}{name}": partial(press_in, load_sensor(name), BALL, preset=BALL_PRESET)
                for name in _SENSORS
            },
        }
        return [Case(name=name, measure=measure) for name, measure in modes.items()]

    def line(self, result: Result) -> str:
        """Return the forces of a run."""
        if result.failure:
            return result.failure
        seen = result.found.signature
        return f"F_n {seen.normal_size_n:.4f} N, tangential {seen.tangential_sum_n:.4f} N in sum"

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return the criteria of every run."""
        return [*map(_criteria, founds(results)), *failures_table(results, kind=self.kind)]

    def facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the runs with their signatures and criteria."""
        return {"preset": self.preset, "modes": [run.as_json() for run in founds(results)]}

    def figures(self, results: Sequence[Result]) -> Mapping[str, Figure]:
        """Draw the modes, and the ball in its sensors."""
        moved, pressed = _parted(results)
        found = {"contact_modes": modes_figure(moved)} if moved else {}
        return found | ({"three_sensors": sensors_figure(pressed)} if pressed else {})

    def page_facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the runs with their criteria and signatures."""
        moved, pressed = _parted(results)
        return {
            "preset": self.preset,
            "friction": FRICTION,
            "missed": [run.title for run in (*moved, *pressed) if not run.passed],
            "ball_preset": BALL_PRESET.value,
            "moved": moved,
            "pressed": pressed,
        }


def _parted(results: Sequence[Result]) -> tuple[list[ModeRun], list[ModeRun]]:
    """Return the modes of the moved body, and the ball's presses."""
    is_ball = [result.name.startswith(_BALL) for result in results if not result.failure]
    runs = list(zip(founds(results), is_ball, strict=True))
    return [run for run, ball in runs if not ball], [run for run, ball in runs if ball]


def _criteria(run: ModeRun) -> Table:
    return table_of(
        run.criteria,
        {
            "criterion": lambda row: row.name,
            "measured": lambda row: row.measured,
            "limit": lambda row: row.limit,
            "verdict": lambda row: row.verdict,
        },
        title=run.title,
        criterion="every number is within its limit",
        passed=run.passed,
    )
