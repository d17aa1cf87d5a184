"""The cheapest settings that keep a tolerance, and what their neighbours would have cost."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sim.effect_estimates import expected_depth, expected_force
from sim.effects import EffectPlan, plan_effects
from sim.force_error import force_error, is_measured, time_ratio, typical_error
from sim.scene import Effect, Preset, Scene
from sim.settings import FAST, SETTINGS, Setting, setting_of
from tacauchy_rig.errors import ConfigError

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Alternative:
    """Settings beside those that were used.

    Attributes:
        role: ``cheaper`` or ``better``.
        setting: A preset, or a mesh between two.
        error_relative: Believed relative error of F_z; None where nothing is known.
        time_ratio: Its time over that of the settings used.
        wall_s: The time it would have taken here [s]; None where nothing was pressed.
    """

    role: str
    setting: str
    error_relative: float | None
    time_ratio: float
    wall_s: float | None

    def __str__(self) -> str:
        error = "unknown" if self.error_relative is None else f"{self.error_relative:.1%}"
        seconds = "" if self.wall_s is None else f" ({self.wall_s:.2g} s)"
        return (
            f"preset {self.setting}: about {self.time_ratio:.2g} times the time{seconds}, force "
            f"error {error}"
        )


def settings_by_cost() -> tuple[Setting, ...]:
    """Return the settings that were measured, the cheapest first."""
    measured = [setting for setting in SETTINGS if is_measured(setting)]
    return tuple(sorted(measured, key=lambda setting: time_ratio(setting, FAST)))


def expected_error(scene: Scene, plan: EffectPlan, *, depth_m: float) -> tuple[float | None, str]:
    """Return the believed relative error of F_z, of the mesh and of what is left out; and why."""
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
    """Return a scene with the cheapest settings whose believed error keeps a tolerance.

    Effects are left out within what the mesh leaves of it.

    Raises:
        ConfigError: No settings keep it, or nothing is known about such a scene.
    """
    allowed = tolerance.of(expected_force(scene))
    depth = expected_depth(scene)
    known: dict[Setting, float] = {}
    reason = ""
    for setting in settings_by_cost():
        tried = setting.applied(scene)
        error, reason = force_error(tried, depth_m=depth)
        if error is None:
            continue
        spared = replace(tried, tolerance=max(0.0, allowed - error))
        known[setting] = _error(spared, depth) or error
        if known[setting] <= allowed:
            return spared
    if not known:
        raise ConfigError(
            f"no preset promises {tolerance} here: {reason}",
            remedy="choose a preset instead; `press --estimate-error` says what it was worth",
        )
    best = min(known, key=lambda setting: known[setting])
    nearest = f"{known[best]:.2%} ({known[best] * expected_force(scene):.2g} N)"
    raise ConfigError(
        f"no preset promises {tolerance}, {allowed:.2%} of the force expected; preset {best} comes "
        f"nearest with {nearest}",
        remedy=f"allow {nearest}, or choose preset {best.preset} without a tolerance",
    )


def alternatives(scene: Scene, *, depth_m: float, wall_s: float | None) -> tuple[Alternative, ...]:
    """Return the next cheaper settings, and the cheapest of those that are better.

    Args:
        depth_m: Where the press ended [m].
        wall_s: What it took [s]; None before it is made.
    """
    own, order = setting_of(scene), settings_by_cost()
    if own not in order:
        return ()
    errors = {each: _error(each.applied(scene), depth_m) for each in order}
    ranks = {each: typical_error(each) if errors[each] is None else errors[each] for each in order}
    cheaper = order[: order.index(own)][-1:]
    better = tuple(each for each in order if (ranks[each] or 0.0) < (ranks[own] or 0.0))[:1]
    return tuple(
        Alternative(
            role=role,
            setting=str(each),
            error_relative=errors[each],
            time_ratio=time_ratio(each, own),
            wall_s=None if wall_s is None else time_ratio(each, own) * wall_s,
        )
        for role, found in (("cheaper", cheaper), ("better", better))
        for each in found
    )


def _error(scene: Scene, depth_m: float) -> float | None:
    return expected_error(scene, plan_effects(scene), depth_m=depth_m)[0]
