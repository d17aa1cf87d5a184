"""The effects study: scenes under their plans and with everything on, and the page."""

from __future__ import annotations

import math
import statistics
import time
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib import resources
from typing import Any

from pydantic import TypeAdapter

from sim.effects.effect_plan import EffectPlan, full_plan
from sim.effects.outputs import PressOutputs, outputs_of
from sim.effects.plan import plan_effects
from sim.effects.scene_path import follow, forget, path_for
from sim.error import estimated
from sim.press_command import scene_from
from sim.scene.material import RelaxationTerm
from sim.scene.scene import Effect, Output, Scene, Target
from sim.studies.effects.drawn import described, drawn_scene
from tacauchy_rig.core.page import page
from tacauchy_rig.core.study import About, Case, Result, Study, founds
from tacauchy_rig.core.tables import Cell, Table, table_of

_TOUCH_M = 5e-6

# Kernels are the same on any mesh: they are loaded on a coarse one.
_TOUCH_REFINEMENT = 0.5

# What errors are judged by: everything on and edges so many times shorter, and what that tends
# to where an error falls with the edge length to the power of two.
_FINER = 1.5

# A size that is none; it keeps a quotient finite.
_NOTHING = 1e-300


@dataclass(frozen=True, slots=True)
class EffectCase:
    """A scene and what sets it apart."""

    name: str
    shows: str
    scene: Scene


def _case(
    name: str,
    shows: str,
    press: str,
    *,
    relaxation: Sequence[dict[str, float]] = (),
    density_kg_m3: float = 1000.0,
) -> EffectCase:
    """Return a case of ``cases.toml``; relaxation and density are no words of a press."""
    scene = scene_from(press)
    terms = tuple(RelaxationTerm(**term) for term in relaxation)
    material = replace(scene.material, relaxation=terms, density_kg_m3=density_kg_m3)
    return EffectCase(name, shows, replace(scene, material=material))


_FILE = resources.files("sim.studies.effects").joinpath("cases.toml")
EFFECT_CASES = tuple(_case(**each) for each in tomllib.loads(_FILE.read_text("utf-8"))["case"])


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectCheck:
    """A scene under its plan and with everything on.

    Attributes:
        name: Of the scene; ``shows`` says what sets it apart.
        added: What was off and is on in the full press.
        tolerances: Of each output that is asked for.
        expected: What the plan said that each of them changes by.
        differences: What each changed by.
        errors: Of each output what the press states, and what finer meshes tell; empty where
            that was not asked.
        planned_s: Processor time of planning, meshing, pressing and estimating errors [s].
        tried_s: What of it went into trying effects [s].
        full_s: The same with everything on and nothing planned [s].
    """

    name: str
    shows: str
    added: tuple[Effect, ...]
    tolerances: dict[Output, float]
    expected: dict[Output, float]
    differences: dict[Output, float]
    errors: dict[Output, tuple[float, float]]
    planned_s: float
    tried_s: float
    full_s: float

    @property
    def shares(self) -> dict[Output, float]:
        """Difference over tolerance of each output that is asked for; above 1 is a miss."""
        return {each: found / self.tolerances[each] for each, found in self.differences.items()}

    @property
    def worst(self) -> tuple[Output, float]:
        """The output that came nearest to its tolerance or went furthest beyond, and its share."""
        return max(self.shares.items(), key=lambda item: item[1])

    @property
    def passed(self) -> bool:
        """Every output is within its tolerance."""
        return self.worst[1] <= 1.0

    @property
    def time_ratio(self) -> float:
        """Processor time of everything on over that of the plan."""
        return self.full_s / self.planned_s


def check_effects(case: EffectCase, *, errors: bool = False) -> EffectCheck:
    """Press a scene under its plan and with everything on.

    Args:
        errors: Judge the stated errors too, by a press on a finer mesh.

    Raises:
        ConvergenceError: A press has no equilibrium.
    """
    scene = case.scene
    every_effect = full_plan(scene)
    plan = plan_effects(scene)
    for each in {plan.switches, every_effect.switches}:
        _touch(scene, each)
    plan_effects.cache_clear()
    forget()
    started = time.process_time()
    plan = plan_effects(scene)
    planned = _pressed(scene, plan)
    stated = estimated(scene, plan, planned).relative
    planned_s = time.process_time() - started
    forget()
    started = time.process_time()
    full = _pressed(scene, every_effect)
    estimated(scene, every_effect, full)
    full_s = time.process_time() - started
    found, true = planned.differences(full), {}
    if errors:
        # What inertia changes follows from the press with everything on, at a fraction of the time.
        inertia = (Effect.INERTIA, plan.is_on(Effect.INERTIA))
        shorter = replace(
            scene, refinement=_FINER * scene.refinement, effects=(*scene.effects, inertia)
        )
        true = _true_errors(planned, full, _pressed(shorter, full_plan(shorter)))
    return EffectCheck(
        name=case.name,
        shows=case.shows,
        added=tuple(e for e, on in every_effect.switches if on and not plan.is_on(e)),
        tolerances=dict(plan.tolerances),
        expected={output: plan.left_out(output) for output in plan.tolerances},
        differences={output: found[output] for output in plan.tolerances},
        errors={each: (stated[each], true[each]) for each in stated if each in true},
        planned_s=planned_s,
        tried_s=plan.tried_s,
        full_s=full_s,
    )


def _true_errors(
    planned: PressOutputs, full: PressOutputs, finer: PressOutputs
) -> dict[Output, float]:
    """Return how far a press is from what everything on tends to where edges go to zero.

    Only the mesh's part is extrapolated: what is left out differs by as much on every mesh.
    """
    errors = {}
    for output, size in planned.sizes.items():
        coarse, fine = full.sizes[output], finer.sizes[output]
        limit = fine + (fine - coarse) / (_FINER**2 - 1.0)
        scale = 1.0 if output is Output.SHEAR else max(abs(limit), _NOTHING)
        errors[output] = abs(size - limit) / scale
    return errors


def _pressed(scene: Scene, plan: EffectPlan) -> PressOutputs:
    path = path_for(scene, plan)
    return outputs_of(path, follow(scene, path))


def _touch(scene: Scene, switches: tuple[tuple[Effect, bool], ...]) -> None:
    """Touch the gel once with some effects, so that loading kernels is not timed later."""
    still = tuple(
        (effect, on and effect is not Effect.INERTIA)
        for effect, on in switches
        if effect is not Effect.SYMMETRY  # which planes there are depends on the depth
    )
    bare = replace(
        scene,
        target=Target(depth_m=_TOUCH_M),
        refinement=_TOUCH_REFINEMENT * scene.refinement,
        effects=still,
    )
    _pressed(bare, full_plan(bare))


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
