"""The cheapest settings that keep a tolerance, and what their neighbours would have cost."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sim.effects.coarse import coarse_press
from sim.effects.plan import plan_effects
from sim.error.estimate import estimate_from, rung
from sim.error.settings import FAST, WORTH, setting_of
from sim.scene.scene import Scene
from tacauchy_rig.core.errors import ConfigError, RigError
from tacauchy_rig.core.quantities import UNITS, Dimension, parse_quantity, split_quantity
from tacauchy_rig.core.simulated import Alternative

# Relative error of F_z by which effects are left out where a tolerance is not chosen yet.
_FORESEEN = 1e-3


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


def keeping(scene: Scene, tolerance: Tolerance) -> Scene:
    """Return a scene with the cheapest settings that are believed to keep a tolerance.

    The scene is pressed on preset fast and on edges twice as long; what that is worth, every other
    setting is worth in proportion to its error in presses that were measured. Effects are left out
    within what the mesh leaves of the tolerance.

    Raises:
        ConfigError: No settings keep it, or the scene cannot be pressed on preset fast.
    """
    fast = FAST.applied(replace(scene, tolerance=_FORESEEN))
    try:
        error, force = _foreseen(fast)
    except RigError as failure:
        raise ConfigError(
            f"no preset promises {tolerance} here: {failure.message}",
            remedy="choose a preset instead",
        ) from failure
    allowed = tolerance.of(force)
    believed = {setting: worth.error_ratio * error for setting, worth in WORTH.items()}
    for setting, own in believed.items():
        if own <= allowed:
            return replace(setting.applied(scene), tolerance=allowed - own)
    best = min(believed, key=lambda setting: believed[setting])
    nearest = f"{believed[best]:.2%} ({believed[best] * force:.2g} N)"
    raise ConfigError(
        f"no preset promises {tolerance}, {allowed:.2%} of the force expected; preset "
        f"{best} comes nearest with {nearest}",
        remedy=f"allow {nearest}, or choose preset {best.preset} without a tolerance",
    )


def _foreseen(fast: Scene) -> tuple[float, float]:
    """Return the relative error of F_z on preset fast, and F_z [N].

    Raises:
        RigError: It cannot be pressed, or nothing touches.
    """
    plan = plan_effects(fast)
    own, coarse = coarse_press(fast, plan, 1.0), coarse_press(*rung(fast, plan))
    worth = estimate_from(fast, plan, own.outputs, coarse)
    if worth.force is None:
        raise ConfigError(worth.basis, remedy="press deeper")
    return worth.force, float(own.outputs.force_n[2])


def alternatives(
    scene: Scene, error_relative: float | None, *, wall_s: float | None
) -> tuple[Alternative, ...]:
    """Return the next cheaper settings worth their time, and the cheapest of those that are better.

    Args:
        error_relative: Believed of F_z with the scene's own settings, or None.
        wall_s: What the press took [s]; None before it is made.
    """
    setting = setting_of(scene)
    own = WORTH.get(setting)
    if own is None:
        return ()
    # The dearest of the cheaper settings than which none that is cheaper errs less.
    cheaper = min(
        (each for each, worth in WORTH.items() if worth.time_ratio < own.time_ratio),
        key=lambda each: WORTH[each].error_ratio,
        default=None,
    )
    # Of presets and ladders some are cheaper and better at once: what is dearer must be better yet.
    least = min(own.error_ratio, WORTH[cheaper].error_ratio if cheaper else own.error_ratio)
    better = [
        each
        for each, worth in WORTH.items()
        if worth.error_ratio < least and worth.time_ratio > own.time_ratio
    ]
    found = {"cheaper": cheaper, "better": better[0] if better else None}
    return tuple(
        Alternative(
            role=role,
            setting=str(each),
            error_relative=None
            if error_relative is None
            else error_relative * WORTH[each].error_ratio / own.error_ratio,
            time_ratio=WORTH[each].time_ratio / own.time_ratio,
            wall_s=None if wall_s is None else wall_s * WORTH[each].time_ratio / own.time_ratio,
        )
        for role, each in found.items()
        if each is not None
    )
