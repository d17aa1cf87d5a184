"""The effects study: scenes, stated or drawn, under their plans and with everything on."""

import math
import statistics
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from sim.effects.depth_and_inertia_scales import expected_force
from sim.effects.effect_choice import plan_effects
from sim.effects.planned_effects import EffectPlan, full_plan
from sim.effects.press_outputs import PressOutputs, outputs_of
from sim.effects.press_with_effects import follow, forget, path_for
from sim.error_estimate import estimated
from sim.press_arguments import scene_from
from sim.scene.indenter import Cylinder, Indenter, Sphere, describe
from sim.scene.material import Layer, Material, RelaxationTerm
from sim.scene.pad import BoxPad
from sim.scene.scene import ContactMode, Effect, Motion, Output, Preset, Scene, Target
from sim.studies import from_file
from tacauchy_rig.core.study import Case, Result, Study, founds
from tacauchy_rig.core.tables import Cell, Table, table_of

_TOUCH_M = 5e-6

# Kernels are the same on any mesh: they are loaded on a coarse one.
_TOUCH_REFINEMENT = 0.5

# What errors are judged by: everything on and edges so many times shorter, and what that tends
# to where an error falls with the edge length to the power of two.
_FINER = 1.5

# A size that is none; it keeps a quotient finite.
_NOTHING = 1e-300


class EffectCase(NamedTuple):
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


EFFECT_CASES = tuple(_case(**each) for each in from_file("effects/cases.toml")["case"])

_FROM = from_file("effects/drawn.toml")
# Of a ball's radius: no deeper, as its side would overhang.
_BALL_DEPTH = 0.8


class _Draw:
    """Draws by the names of ``drawn.toml``, always the same for a seed and a number."""

    def __init__(self, seed: int, number: int) -> None:
        self.rng = np.random.default_rng([seed, number])

    def has(self, name: str) -> bool:
        return bool(self.rng.random() < _FROM["shares"][name])

    def evenly(self, name: str) -> float:
        return float(self.rng.uniform(*_FROM["evenly"][name]))

    def size(self, name: str) -> float:
        low, high = _FROM["sizes"][name]
        return math.exp(self.rng.uniform(math.log(low), math.log(high)))

    def offset(self, name: str) -> tuple[float, float]:
        """Return a size along x, y or both."""
        size, way = self.size(name), self.rng.integers(3)
        if way == 2:
            angle = self.rng.uniform(0.0, 2.0 * math.pi)
            return size * math.cos(angle), size * math.sin(angle)
        return (size, 0.0) if way == 0 else (0.0, size)


def drawn_scene(seed: int, number: int) -> Scene:
    """Return a scene, always the same for a seed and a number."""
    draw = _Draw(seed, number)
    height = draw.size("height_m")
    half_x, half_y = (draw.evenly("half_m") for _ in range(2))
    indenter = _indenter(draw)
    depth = draw.size("depth_share") * height
    if isinstance(indenter, Sphere):
        depth = min(depth, _BALL_DEPTH * indenter.radius_m)
    contact, friction = _contact(draw)
    motion = _motion(draw, indenter, can_slide=contact is not ContactMode.BONDED)
    material = _material(draw)
    layers = _layers(draw, material)
    scene = Scene(
        pad=BoxPad(size_x_m=2.0 * half_x, size_y_m=2.0 * half_y, height_m=height),
        material=layers[-1].material if layers else material,
        layers=layers,
        indenter=indenter,
        target=Target(depth_m=depth),
        centre_m=draw.offset("offset_m") if draw.has("off_centre") else (0.0, 0.0),
        contact=contact,
        friction=friction,
        motion=motion,
        duration_s=draw.size("duration_s"),
        outputs=frozenset(output for output in Output if draw.has("asked")),
        tolerance=draw.size("tolerance"),
        preset=Preset.FAST if draw.has("fast") else Preset.BALANCED,
    )
    if not draw.has("forced"):
        return scene
    return replace(scene, target=Target(force_n=expected_force(scene)))


def described(scene: Scene) -> str:
    """Return what was drawn in a few words."""
    target, motion, height = scene.target, scene.motion, scene.pad.height_m
    goal = f"{target.force_n:.3g} N" if target.depth_m is None else f"{target.depth_m / height:.0%}"
    friction = f" {scene.friction:.2g}" if scene.contact is ContactMode.FRICTION else ""
    extras = {
        "layered": scene.layers,
        "relaxing": scene.material.relaxation,
        "off centre": any(scene.centre_m),
        "slid": any(motion.shift_m),
        "twisted": motion.twist_rad,
        "tilted": any(motion.tilt_rad),
    }
    return (
        f"{scene.preset.value}, {describe(scene.indenter)}, to {goal} of {height * 1e3:.2g} mm, "
        f"nu {scene.material.poisson:.3g}, {scene.contact.value}{friction}, "
        f"in {scene.duration_s:.2g} s"
    ) + "".join(f", {name}" for name, present in extras.items() if present)


def _indenter(draw: _Draw) -> Indenter:
    if draw.has("ball"):
        return Sphere(diameter_m=draw.size("ball_m"))
    diameter = draw.size("punch_m")
    fillet = 0.0 if draw.has("sharp") else 0.5 * draw.evenly("fillet_share") * diameter
    return Cylinder(diameter_m=diameter, fillet_m=fillet)


def _contact(draw: _Draw) -> tuple[ContactMode, float]:
    kind, friction, shares = draw.rng.random(), draw.evenly("friction"), _FROM["shares"]
    if kind < shares["frictionless"]:
        return ContactMode.FRICTIONLESS, 0.0
    if kind < shares["frictionless"] + shares["bonded"]:
        return ContactMode.BONDED, 0.0
    return ContactMode.FRICTION, friction


def _motion(draw: _Draw, indenter: Indenter, *, can_slide: bool) -> Motion:
    is_tilted = isinstance(indenter, Cylinder) and draw.has("tilted")
    tilt = draw.offset("tilt_rad") if is_tilted else (0.0, 0.0)
    if not can_slide or not draw.has("moved"):
        return Motion(tilt_rad=tilt)
    if draw.has("turned"):
        return Motion(twist_rad=draw.size("twist_rad"), tilt_rad=tilt)
    draw.rng.random()  # keeps the scenes of a seed what they were
    return Motion(shift_m=draw.offset("shift_m"), tilt_rad=tilt)


def _material(draw: _Draw) -> Material:
    count = draw.rng.integers(1, 3) if draw.has("lossy") else 0
    terms = tuple(
        RelaxationTerm(share=draw.size("term_share"), time_s=draw.size("term_s"))
        for _ in range(count)
    )
    young_pa = draw.size("young_pa")
    return Material(young_pa=young_pa, poisson=draw.evenly("poisson"), relaxation=terms)


def _layers(draw: _Draw, base: Material) -> tuple[Layer, ...]:
    if not draw.has("layered"):
        return ()
    skin = Material(
        young_pa=draw.size("skin_stiffness") * base.young_pa,
        poisson=draw.evenly("poisson"),
        relaxation=base.relaxation,
    )
    share = draw.size("skin_share")
    return (Layer(share=1.0 - share, material=base), Layer(share=share, material=skin))


Check = dict[str, Any]
"""A scene under its plan and with everything on; what is of an output is by its name.

``name`` and ``shows``: Of the scene. ``added``: What was off and is on in the full press.
``tolerances``, ``expected``, ``differences``: Of each output that is asked for, what it may differ
by, what the plan said, and what was found. ``errors``: What the press states, and what finer meshes
tell; empty where that was not asked. ``planned_s``: Processor time of planning, meshing, pressing
and estimating errors, of which ``tried_s`` went into trying effects; ``full_s``: the same with
everything on and nothing planned [s]. ``passed``: Every output is within its tolerance.
"""


def shares(check: Check) -> dict[str, float]:
    """Return difference over tolerance of each output that is asked for; above 1 is a miss."""
    return {name: found / check["tolerances"][name] for name, found in check["differences"].items()}


def worst(check: Check) -> tuple[str, float]:
    """Return the output that came nearest to its tolerance or went furthest beyond; its share."""
    return max(shares(check).items(), key=lambda item: item[1])


def time_ratio(check: Check) -> float:
    """Return the processor time of everything on over that of the plan."""
    return float(check["full_s"] / check["planned_s"])


def check_effects(case: EffectCase, *, errors: bool = False) -> Check:
    """Press a scene under its plan and with everything on.

    Args:
        errors: Judge the stated errors too, by a press on a finer mesh.
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
    told = estimated(scene, plan, planned).relative
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
    check: Check = {
        "name": case.name,
        "shows": case.shows,
        "added": [e.value for e, on in every_effect.switches if on and not plan.is_on(e)],
        "tolerances": {output.value: allowed for output, allowed in plan.tolerances.items()},
        "expected": {output.value: plan.left_out(output) for output in plan.tolerances},
        "differences": {output.value: found[output] for output in plan.tolerances},
        "errors": {each.value: (told[each], true[each]) for each in told if each in true},
        "planned_s": planned_s,
        "tried_s": plan.tried_s,
        "full_s": full_s,
    }
    return check | {"passed": worst(check)[1] <= 1.0}


def _true_errors(
    planned: PressOutputs, full: PressOutputs, finer: PressOutputs
) -> dict[Output, float]:
    """Return how far a press is from what everything on tends to where edges go to zero.

    Only the mesh's part is extrapolated: what is left out differs by as much on every mesh.
    """

    def error(output: Output) -> float:
        coarse, fine = full.sizes[output], finer.sizes[output]
        limit = fine + (fine - coarse) / (_FINER**2 - 1.0)
        scale = 1.0 if output is Output.SHEAR else max(abs(limit), _NOTHING)
        return abs(planned.sizes[output] - limit) / scale

    return {output: error(output) for output in planned.sizes}


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


class Effects(Study):
    """Every scene is pressed under its plan and with everything on.

    Args:
        count: Scenes to draw in place of the stated ones; 0 for those.
        seed: What they are drawn with.
        errors: Judge stated errors too, by a finer mesh.
    """

    name, title, kind = "effects", "Effects: plans against everything on", "scene"
    template = "page.md.jinja"

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
                measure=partial(check_effects, each, errors=self._errors),
                limit_s=LIMIT_S,
                is_isolated=True,
            )
            for each in self._cases
        ]

    def line(self, result: Result) -> str:
        """Return the output that came nearest to its tolerance."""
        check = result.found
        output, share = worst(check)
        return (
            f"{'ok' if check['passed'] else 'MISSED'}, {output} "
            f"{check['differences'][output]:.2e}, {share:.0%} of what is allowed, "
            f"{time_ratio(check):.1f} times the time with {_names(check)} on"
        )

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return what was kept and what errors were as stated, by output; then every scene."""
        checks = founds(results)
        if not checks:
            return []
        kept = table_of(
            _by_output([shares(check) for check in checks]),
            {
                "output": itemgetter(0),
                "kept": lambda row: sum(share <= 1.0 for share in row[1]),
                "of": lambda row: len(row[1]),
                "at worst, over the tolerance": lambda row: percent(max(row[1])),
            },
            title="Outputs kept",
            criterion="an output differs by no more than its tolerance",
            passed=all(check["passed"] for check in checks),
        )
        # The shear of a press without friction is zero on every mesh: nothing is stated, nothing
        # found, and nothing judged.
        stated = [{o: pair for o, pair in c["errors"].items() if any(pair)} for c in checks]
        errors = table_of(
            _by_output(stated),
            {
                "output": itemgetter(0),
                "errs as stated": lambda row: sum(found <= told for told, found in row[1]),
                "of": lambda row: len(row[1]),
                "stated over found, median": lambda row: (
                    f"{statistics.median(told / max(found, 1e-12) for told, found in row[1]):.1f}"
                ),
            },
            title="Stated errors",
        )
        scenes = table_of(
            checks,
            {
                "scene": lambda check: check["name"],
                "left out": _names,
                "nearest output": lambda check: worst(check)[0],
                "tolerance": partial(_of_worst, name="tolerances"),
                "expected": partial(_of_worst, name="expected"),
                "found": partial(_of_worst, name="differences"),
                "time": lambda check: f"{time_ratio(check):.1f} x",
                "": lambda check: "kept" if check["passed"] else "**missed**",
            },
            title="Scenes",
            note=f"{percent(time_saved(checks))} of the time saved, geometric mean",
        )
        return [kept, errors, scenes] if errors.rows else [kept, scenes]

    def facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the scenes, and why some were not pressed."""
        return {
            "scenes": founds(results),
            "not_pressed": {r.name: f"{r.failure} ({r.shows})" for r in results if r.failure},
        }

    def page_facts(self, results: Sequence[Result]) -> Mapping[str, Any]:
        """Return the scenes, and what was saved."""
        checks = founds(results)
        return {
            "checks": checks,
            "failed": [result for result in results if result.failure],
            "passed": sum(check["passed"] for check in checks),
            "saved": percent(time_saved(checks)) if checks else "",
        }

    def has_passed(self, results: Sequence[Result]) -> bool:
        """Return whether all that was pressed was kept; what took too long is only named."""
        return all(table.passed for table in self.tables(results))


def _by_output(checks: Sequence[Mapping[str, Any]]) -> list[tuple[str, list[Any]]]:
    """Return what checks have of each output, by its name; outputs that none has are left out."""
    found = [(o.value, [check[o] for check in checks if o in check]) for o in Output]
    return [(name, known) for name, known in found if known]


def time_saved(checks: Sequence[Check]) -> float:
    """Return the geometric mean of the share of everything's time that plans save."""
    return 1.0 - 1.0 / statistics.geometric_mean(map(time_ratio, checks))


def percent(value: float) -> str:
    """Return a share in percent to two digits."""
    return f"{float(f'{value * 100:.2g}'):g} %"


def _of_worst(check: Check, *, name: str) -> Cell:
    return percent(check[name][worst(check)[0]])


def _names(check: Check) -> str:
    return ", ".join(check["added"]) or "nothing"
