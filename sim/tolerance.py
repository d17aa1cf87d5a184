"""The cheapest settings that keep a tolerance, and what their neighbours would have cost."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from sim.effect_estimates import expected_depth, expected_force
from sim.effects import EffectPlan, plan_effects
from sim.force_error import force_error, is_measured, middle_error, time_ratio, typical_error
from sim.force_error_fit import fits
from sim.force_error_rows import indenter_kind
from sim.pilot import ANCHOR, Pilot, is_piloted, pilot_depth
from sim.scene import Effect, Preset, Scene
from sim.settings import FAST, SETTINGS, Setting, setting_of
from tacauchy_rig.errors import ConfigError

# Up to here a press takes no longer than looking for something cheaper.
ENOUGH = Setting(Preset.FAST, 1.15)
# What the table believes to err this many times too much is not tried.
_HOPELESS = 3.0
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


def settings_by_cost(kind: str | None = None) -> tuple[Setting, ...]:
    """Return the settings that were measured, the cheapest first.

    Args:
        kind: Of the indenter that is pressed; None takes them all together.
    """
    measured = [setting for setting in SETTINGS if is_measured(setting)]
    return tuple(sorted(measured, key=lambda setting: time_ratio(setting, FAST, kind=kind)))


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

    Where the table alone asks for more than ``ENOUGH``, the scene's own meshes are tried at small
    strains first, which tells more of them and takes a fraction of what it may save: against an
    anchor, and where that leaves only what is finer, against the limit of finer meshes. Effects are
    left out within what the mesh leaves of the tolerance.

    Raises:
        ConfigError: No settings keep it, or nothing is known about such a scene.
    """
    order = settings_by_cost(indenter_kind(scene.indenter))
    search = _Search(scene, tolerance.of(expected_force(scene)), expected_depth(scene))
    by_table = search.first(order)
    if by_table is not None and order.index(setting_of(by_table)) <= order.index(ENOUGH):
        return by_table
    if search.reason and not search.known:
        raise ConfigError(
            f"no preset promises {tolerance} here: {search.reason}",
            remedy="choose a preset instead; `press --estimate-error` says what it was worth",
        )
    found = search.after_pilot(order, by_table) or by_table
    if found is not None:
        return found
    best = min(search.known, key=lambda setting: search.known[setting])
    nearest = f"{search.known[best]:.2%} ({search.known[best] * expected_force(scene):.2g} N)"
    raise ConfigError(
        f"no preset promises {tolerance}, {search.allowed:.2%} of the force expected; preset "
        f"{best} comes nearest with {nearest}",
        remedy=f"allow {nearest}, or choose preset {best.preset} without a tolerance",
    )


@dataclass(slots=True)
class _Search:
    """Tries settings on a scene until one is believed to keep a tolerance.

    Attributes:
        allowed: The tolerance, relative.
        known: The believed error of every setting that was tried.
        reason: Why nothing was believed of the last that was tried.
    """

    scene: Scene
    allowed: float
    depth_m: float
    known: dict[Setting, float] = field(default_factory=dict)
    reason: str = ""

    def first(self, order: Sequence[Setting]) -> Scene | None:
        """Return the scene with the first settings that keep the tolerance."""
        for setting in order:
            found = self._kept_by(setting.applied(self.scene))
            if found is not None:
                return found
        return None

    def after_pilot(self, order: Sequence[Setting], by_table: Scene | None) -> Scene | None:
        """Return the same after presses at small strains, which reach up to preset accurate.

        Only what is cheaper than the table's choice is tried.
        """
        fit = fits()[indenter_kind(self.scene.indenter)]
        pilot = Pilot(self.scene, pilot_depth(self.scene))
        own = middle_error(ANCHOR.applied(self.scene)) or 0.0
        end = len(order) if by_table is None else order.index(setting_of(by_table))
        tried = [each for each in order[:end] if is_piloted(each) and self._hopes(each)]
        near = [each for each in tried if order.index(each) < order.index(ANCHOR)]
        found = self._first_tried(
            near, lambda each: fit.believed_over_anchor(pilot.over_anchor(each), own)
        )
        if found is not None:
            return found
        if by_table is not None and order.index(setting_of(by_table)) <= order.index(ANCHOR):
            return by_table
        return self._first_tried(tried, lambda each: fit.believed_after(pilot.error(each)))

    def _hopes(self, setting: Setting) -> bool:
        return self.known.get(setting, 0.0) <= _HOPELESS * self.allowed

    def _first_tried(
        self, settings: Sequence[Setting], believed: Callable[[Setting], float]
    ) -> Scene | None:
        for setting in settings:
            errors = ((setting.preset, setting.refinement, believed(setting)),)
            found = self._kept_by(replace(setting.applied(self.scene), tried_errors=errors))
            if found is not None:
                return found
        return None

    def _kept_by(self, tried: Scene) -> Scene | None:
        setting = setting_of(tried)
        error, self.reason = force_error(tried, depth_m=self.depth_m)
        if error is None:
            return None
        spared = replace(tried, tolerance=max(0.0, self.allowed - error))
        self.known[setting] = _error(spared, self.depth_m) or error
        return spared if self.known[setting] <= self.allowed else None


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
    errors = {each: _error(each.applied(scene), depth_m) for each in order}
    ranks = {each: typical_error(each) if errors[each] is None else errors[each] for each in order}
    cheaper = _worth_it(order[: order.index(own)], ranks)[-1:]
    better = tuple(each for each in order if (ranks[each] or 0.0) < (ranks[own] or 0.0))[:1]
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


def _worth_it(
    order: Sequence[Setting], ranks: Mapping[Setting, float | None]
) -> tuple[Setting, ...]:
    """Return the settings than which none that is cheaper errs less.

    Args:
        order: The cheapest first.
        ranks: Their errors.
    """
    found: list[Setting] = []
    for setting in order:
        least = min((ranks[each] or 0.0 for each in found), default=float("inf"))
        if (ranks[setting] or 0.0) < least:
            found.append(setting)
    return tuple(found)


def _error(scene: Scene, depth_m: float) -> float | None:
    return expected_error(scene, plan_effects(scene), depth_m=depth_m)[0]
