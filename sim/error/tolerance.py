"""The cheapest settings that keep a tolerance, and what their neighbours would have cost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile

from sim.effects.effect_plan import EffectPlan
from sim.effects.estimates import expected_depth, expected_force
from sim.effects.plan import plan_effects
from sim.error.measured_errors import FAST, SETTINGS, Setting, indenter_kind, setting_of
from sim.error.prior_error import (
    force_error,
    is_measured,
    time_ratio,
    typical_error,
    why_unknown,
)
from sim.error.section_error import section_depth, section_force
from sim.scene.scene import Effect, Preset, Scene
from tacauchy_rig.errors import ConfigError
from tacauchy_rig.quantities import UNITS, Dimension, parse_quantity, split_quantity
from tacauchy_rig.replayed import Alternative

# Preset paper's error was measured with its linear element.
_MEASURED_WITH = {Effect.LOCKING_FREE_ELEMENT}


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """How far off F_z may be: relative to F_z, or in newtons; exactly one of the two.

    Attributes:
        force_n: Of the largest force where there are several [N].
    """

    relative: float | None = None
    force_n: float | None = None

    def __post_init__(self) -> None:
        value = self.relative if self.force_n is None else self.force_n
        if (self.relative is None) == (self.force_n is None) or value is None or not value > 0.0:
            raise ConfigError(
                f"a tolerance of {value} is none", remedy="write it as 0.02N or 1%, above 0"
            )

    def of(self, force_n: float) -> float:
        """Return the tolerance relative to a force [N]; infinite for none."""
        if self.force_n is None:
            return self.relative or 0.0
        return self.force_n / force_n if force_n > 0.0 else float("inf")

    def __str__(self) -> str:
        return (
            f"{1e2 * (self.relative or 0.0):g}% of F_z"
            if self.force_n is None
            else f"{self.force_n:g} N"
        )


def parse_tolerance(text: str, *, field: str) -> Tolerance:
    """Read ``0.02N`` or ``1%``; a number without a unit could be meant as either.

    Raises:
        ConfigError: Neither a force nor a share in percent, or not above zero.
    """
    parts = split_quantity(text)
    unit = "" if parts is None else parts[1]
    is_force = unit in UNITS[Dimension.FORCE]
    if not is_force and unit != "%":
        problem = "is no tolerance" if parts is None or unit else "has no unit"
        raise ConfigError(f'{field}: "{text}" {problem}', remedy="give 0.02N or 1%")
    dimension = Dimension.FORCE if is_force else Dimension.RATIO
    value = parse_quantity(text, dimension=dimension, field=field)
    return Tolerance(force_n=value) if is_force else Tolerance(relative=value)


def settings_by_cost(kind: str | None = None) -> tuple[Setting, ...]:
    """Return the settings that were measured, the cheapest first.

    Args:
        kind: Of the indenter that is pressed; None takes them all together.
    """
    measured = [setting for setting in SETTINGS if is_measured(setting)]
    return tuple(sorted(measured, key=lambda setting: time_ratio(setting, FAST, kind=kind)))


def expected_error(scene: Scene, plan: EffectPlan, *, depth_m: float) -> tuple[float | None, str]:
    """Return the prior relative error of F_z, of the mesh and of what is left out; and why."""
    error, basis = force_error(scene, depth_m=depth_m)
    left_out = sum(
        row.estimated_error or 0.0
        for row in plan.effects
        if not row.on and not (scene.preset is Preset.PAPER and row.effect in _MEASURED_WITH)
    )
    if error is None or not left_out:
        return error, basis
    return error + left_out, f"{basis}; {left_out:.2%} for effects left out"


def keeping(scene: Scene, tolerance: Tolerance) -> Scene:
    """Return a scene with the cheapest settings whose prior error keeps a tolerance.

    They are looked for from preset fast upwards, or downwards where that keeps it. Effects are left
    out within what the mesh leaves of the tolerance.

    Raises:
        ConfigError: No settings keep it, or nothing is known about such a scene.
    """
    depth = _depth(scene)
    force = scene.target.force_n or _force(scene, depth)
    search = _Search(scene, tolerance.of(force), depth)
    order = settings_by_cost(indenter_kind(scene.indenter))
    start = order.index(FAST)
    found = next((kept for each in order[start:] if (kept := search.kept_by(each))), None)
    if found is not None and setting_of(found) == FAST:
        cheaper = (each for each in reversed(order[:start]) if each.preset is FAST.preset)
        *_, found = (found, *takewhile(bool, map(search.kept_by, cheaper)))
    if found is not None:
        return found
    if not any(setting.preset is not Preset.PAPER for setting in search.known):
        raise ConfigError(
            f"no preset promises {tolerance} here: {search.reason}",
            remedy="choose a preset instead; `press --estimate-error` says what it was worth",
        )
    best = min(search.known, key=lambda setting: search.known[setting])
    nearest = f"{search.known[best]:.2%} ({search.known[best] * force:.2g} N)"
    raise ConfigError(
        f"no preset promises {tolerance}, {search.allowed:.2%} of the force expected; preset "
        f"{best} comes nearest with {nearest}",
        remedy=f"allow {nearest}, or choose preset {best.preset} without a tolerance",
    )


@dataclass(slots=True)
class _Search:
    """Tries settings on a scene.

    Attributes:
        allowed: The tolerance, relative.
        depth_m: Where the error is judged [m].
        known: The prior error of every setting that was tried.
        reason: Why the last without a prior error had none.
    """

    scene: Scene
    allowed: float
    depth_m: float
    known: dict[Setting, float] = field(default_factory=dict)
    reason: str = ""

    def kept_by(self, setting: Setting) -> Scene | None:
        """Return the scene with settings, effects left out, if its prior error is small enough."""
        tried = setting.applied(self.scene)
        error, basis = force_error(tried, depth_m=self.depth_m)
        if error is None:
            self.reason = basis
            return None
        spared = replace(tried, tolerance=max(0.0, self.allowed - error))
        self.known[setting] = _error(spared, self.depth_m) or error
        return spared if self.known[setting] <= self.allowed else None


def _depth(scene: Scene) -> float:
    """Return the depth of a scene's target [m], the better known where its section is."""
    known = _is_known(scene)
    return section_depth(scene) if known else expected_depth(scene)


def _force(scene: Scene, depth_m: float) -> float:
    return section_force(scene, depth_m=depth_m) if _is_known(scene) else expected_force(scene)


def _is_known(scene: Scene) -> bool:
    return not why_unknown(FAST.applied(scene), depth_m=expected_depth(scene))


def alternatives(scene: Scene, *, depth_m: float, wall_s: float | None) -> tuple[Alternative, ...]:
    """Return the next cheaper settings worth their time, and the cheapest of those that are better.

    Args:
        depth_m: Where the press ended [m].
        wall_s: What it took [s]; None before it is made.
    """
    kind = indenter_kind(scene.indenter)
    own, order = setting_of(scene), settings_by_cost(kind)
    if own not in order:
        return ()
    errors, ranks = dict[Setting, float | None](), dict[Setting, float]()

    def rank(setting: Setting) -> float:
        if setting not in ranks:
            error = errors[setting] = _error(setting.applied(scene), depth_m)
            ranks[setting] = typical_error(setting) if error is None else error
        return ranks[setting]

    cheaper = _worth_it(order[: order.index(own)], rank)[-1:]
    better = next(((each,) for each in order if rank(each) < rank(own)), ())
    return tuple(
        Alternative(
            role=role,
            setting=str(each),
            error_relative=errors[each],
            time_ratio=time_ratio(each, own, kind=kind),
            wall_s=None if wall_s is None else time_ratio(each, own, kind=kind) * wall_s,
        )
        for role, found in (("cheaper", cheaper), ("better", better))
        for each in found
    )


def _worth_it(order: Sequence[Setting], rank: Callable[[Setting], float]) -> tuple[Setting, ...]:
    """Return the settings than which none that is cheaper errs less.

    Args:
        order: The cheapest first.
        rank: The error of one.
    """
    found: list[Setting] = []
    for setting in order:
        least = min((rank(each) for each in found), default=float("inf"))
        if rank(setting) < least:
            found.append(setting)
    return tuple(found)


def _error(scene: Scene, depth_m: float) -> float | None:
    return expected_error(scene, plan_effects(scene), depth_m=depth_m)[0]
