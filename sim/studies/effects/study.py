"""The effects study: scenes, what their plans keep and save, and the page."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

from pydantic import TypeAdapter

from sim.scene.scene import Effect, Output
from sim.studies.effects.check import EFFECT_CASES, EffectCase, EffectCheck, check_effects
from sim.studies.effects.drawn import described, drawn_scene
from tacauchy_rig.core.page import page
from tacauchy_rig.core.study import About, Case, Result, Study, founds
from tacauchy_rig.core.tables import Cell, Table, table_of

LIMIT_S = 60.0
_read: Callable[[Any], EffectCheck] = TypeAdapter(EffectCheck).validate_python


class Effects(Study):
    """Every scene is pressed under its plan and with everything on.

    Args:
        count: Scenes to draw in place of the stated ones; 0 for those.
        seed: What they are drawn with.
        errors: Judge stated errors too, by a finer mesh.
    """

    name, title, kind = "effects", "Effects: plans against everything on", "scene"

    def __init__(self, *, count: int = 0, seed: int = 0, errors: bool = False) -> None:
        self._cases: Sequence[EffectCase] = EFFECT_CASES
        if count:
            scenes = [drawn_scene(seed, number) for number in range(count)]
            self._cases = [EffectCase(f"{k}", described(s), s) for k, s in enumerate(scenes)]
        self._errors = errors

    def cases(self) -> Sequence[Case]:
        """Return the stated scenes, or the drawn ones by their numbers."""
        return [
            Case(
                name=each.name,
                shows=each.shows,
                measure=partial(_measured, each, errors=self._errors),
                limit_s=LIMIT_S,
                is_isolated=True,
            )
            for each in self._cases
        ]

    def line(self, result: Result) -> str:
        """Return the output that came nearest to its tolerance."""
        if result.failure:
            return f"not pressed: {result.failure}"
        check = _read(result.found)
        output, share = check.worst
        return (
            f"{'ok' if check.passed else 'MISSED'}, {output.value} "
            f"{check.differences[output]:.2e}, {share:.0%} of what is allowed, "
            f"{check.time_ratio:.1f} times the time with {_names(check.added)} on"
        )

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return what was kept and what errors were as stated, by output; then every scene."""
        checks = list(map(_read, founds(results)))
        if not checks:
            return []
        errors = errors_by_output(checks)
        tables = [
            table_of(
                kept_by_output(checks).items(),
                {
                    "output": lambda row: row[0].value,
                    "kept": lambda row: row[1][0],
                    "of": lambda row: row[1][1],
                    "at worst, over the tolerance": lambda row: percent(row[1][2]),
                },
                title="Outputs kept",
                criterion="an output differs by no more than its tolerance",
                passed=all(check.passed for check in checks),
            ),
            table_of(
                errors.items(),
                {
                    "output": lambda row: row[0].value,
                    "errs as stated": lambda row: row[1][0],
                    "of": lambda row: row[1][1],
                    "stated over found, median": lambda row: f"{row[1][2]:.1f}",
                },
                title="Stated errors",
            ),
            table_of(
                checks,
                {
                    "scene": lambda check: check.name,
                    "left out": lambda check: _names(check.added),
                    "nearest output": lambda check: check.worst[0].value,
                    "tolerance": partial(_of_worst, name="tolerances"),
                    "expected": partial(_of_worst, name="expected"),
                    "found": partial(_of_worst, name="differences"),
                    "time": lambda check: f"{check.time_ratio:.1f} x",
                    "": lambda check: "kept" if check.passed else "**missed**",
                },
                title="Scenes",
                note=f"{percent(time_saved(checks))} of the time saved, geometric mean",
            ),
        ]
        return tables if errors else [tables[0], tables[2]]

    def facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the scenes, and why some were not pressed."""
        return {
            "scenes": founds(results),
            "not_pressed": {r.name: f"{r.failure} ({r.shows})" for r in results if r.failure},
        }

    def page(self, results: Sequence[Result], about: About, images: Sequence[str]) -> str:
        """Return the page."""
        del images
        checks = list(map(_read, founds(results)))
        tables = self.tables(results)
        facts = {
            "command": about.command,
            "checks": checks,
            "failed": [result for result in results if result.failure],
            "passed": sum(check.passed for check in checks),
            "kept": tables[:1],
            "errors": tables[1:-1],
            "scenes": tables[-1:],
            "saved": percent(time_saved(checks)) if checks else "",
        }
        return page("sim.studies.effects", "page.md.jinja", facts)

    def has_passed(self, results: Sequence[Result]) -> bool:
        """Return whether all that was pressed was kept; what took too long is only named."""
        return all(table.passed for table in self.tables(results))


def _measured(case: EffectCase, *, errors: bool) -> dict[str, Any]:
    check = check_effects(case, errors=errors)
    return {**asdict(check), "passed": check.passed}


def kept_by_output(checks: Sequence[EffectCheck]) -> dict[Output, tuple[int, int, float]]:
    """Return how often a tolerance was kept, of how many, and the worst share, by output."""
    found = {}
    for output in Output:
        shares = [each.shares[output] for each in checks if output in each.shares]
        if shares:
            found[output] = sum(share <= 1.0 for share in shares), len(shares), max(shares)
    return found


def errors_by_output(checks: Sequence[EffectCheck]) -> dict[Output, tuple[int, int, float]]:
    """Return how many errors were as stated, of how many, and how wide in the median, by output.

    An estimate is as wide as it is over the error that was found. The shear of a press without
    friction is zero on every mesh: nothing is stated, nothing found, and nothing judged.
    """
    judged = {}
    for output in Output:
        pairs = [each.errors[output] for each in checks if any(each.errors.get(output, ()))]
        widths = [stated / max(found, 1e-12) for stated, found in pairs]
        if pairs:
            inside = sum(found <= stated for stated, found in pairs)
            judged[output] = inside, len(pairs), statistics.median(widths)
    return judged


def time_saved(checks: Sequence[EffectCheck]) -> float:
    """Return the geometric mean of the share of everything's time that plans save."""
    return 1.0 - math.exp(-statistics.fmean(math.log(each.time_ratio) for each in checks))


def percent(value: float) -> str:
    """Return a share in percent to two digits."""
    return f"{float(f'{value * 100:.2g}'):g} %"


def _of_worst(check: EffectCheck, *, name: str) -> Cell:
    return percent(getattr(check, name)[check.worst[0]])


def _names(effects: Sequence[Effect]) -> str:
    return ", ".join(effect.value for effect in effects) or "nothing"
