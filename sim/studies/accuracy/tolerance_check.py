"""Does a tolerance keep its promise, on scenes that had no part in making it?"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from sim.effects.coarse import coarse_press
from sim.effects.plan import plan_effects
from sim.effects.scene_path import follow, path_for
from sim.error.estimate import estimated
from sim.error.settings import FAST, WORTH, Setting, setting_of
from sim.error.tolerance import keeping
from sim.scene.scene import Preset, Scene, Target
from sim.studies.accuracy.force_limit import PressStore, pressed_path
from sim.studies.accuracy.scenes import HELD_OUT, HeldOut
from tacauchy_rig.core.errors import ConfigError

COST_WANTED = 2.0
_EVERYTHING_ON = 2e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class ToleranceOutcome:
    """What a tolerance chose for a scene, and what that was worth.

    Attributes:
        allowed: The tolerance relative to the force that was found.
        setting: The one that was chosen; None where none was promised, and then there are no
            numbers.
        believed: Relative error that was stated.
        true_error: Relative to the limit of finer meshes, with its sign.
        doubt: Relative error that the limit may have.
        cheapest: The cheapest setting whose true error is within the tolerance; None if none is.
        cost_ratio: Processor time of the choice and of the chosen setting over that of the
            cheapest.
        choice_ratio: Of the choice alone.
    """

    asked: HeldOut
    refusal: str = ""
    allowed: float = 0.0
    setting: Setting | None = None
    force_n: float = 0.0
    depth_m: float = 0.0
    believed: float = 0.0
    true_error: float = 0.0
    doubt: float = 0.0
    cheapest: Setting | None = None
    cost_ratio: float | None = None
    choice_ratio: float | None = None

    @property
    def is_kept(self) -> bool:
        """The true error is within the tolerance."""
        return self.setting is not None and abs(self.true_error) <= self.allowed

    @property
    def is_thrifty(self) -> bool:
        """It cost no more than twice what the cheapest would have."""
        return self.cost_ratio is not None and self.cost_ratio <= COST_WANTED

    @property
    def is_thrifty_once_chosen(self) -> bool:
        """The same without the time that the choice took."""
        if self.cost_ratio is None or self.choice_ratio is None:
            return False
        return self.cost_ratio - self.choice_ratio <= COST_WANTED


def check_tolerance(asked: HeldOut, store: PressStore) -> ToleranceOutcome:
    """Choose settings for a scene, press with them, and find out what they were worth.

    All presses go to one depth, for a force that at which preset fast reaches it, so that times
    are alike and another choice needs few other presses.

    Args:
        store: Keeps every press, so that what was killed goes on.

    Raises:
        RigError: A press does not go through.
    """
    started = time.process_time()
    try:
        scene = keeping(asked.scene, asked.tolerance)
    except ConfigError as refused:
        return ToleranceOutcome(asked=asked, refusal=refused.message)
    choosing = time.process_time() - started
    depth = judged_depth(asked.scene)
    # The limit is that of the mesh that the scene's own target asks for.
    (limit,) = store.limits(_everything_on(scene), [depth])
    allowed = asked.tolerance.of(limit.force_n)

    def trial(setting: Setting) -> tuple[Setting, float, float]:
        """Return a setting, its relative error, and its processor time [s]."""
        own = setting == setting_of(scene)
        tried = scene if own else _everything_on(setting.applied(scene))
        found = store.pressed_path(tried, [depth])
        return setting, limit.error(found.forces_n[0]), found.cpu_s

    setting, error, spent = trial(setting_of(scene))
    # Preset paper is left out: its error is 70 % or more.
    trials = (trial(other) for other in WORTH if other.preset is not Preset.PAPER)
    cheapest, _, least = next(
        (found for found in trials if abs(found[1]) <= allowed), (None, 0.0, 0.0)
    )
    believed = _believed(scene, depth)
    return ToleranceOutcome(
        asked=asked,
        allowed=allowed,
        setting=setting,
        force_n=limit.force_n,
        depth_m=depth,
        believed=believed,
        true_error=error,
        doubt=limit.doubt,
        cheapest=cheapest,
        cost_ratio=None if cheapest is None else (choosing + spent) / least,
        choice_ratio=None if cheapest is None else choosing / least,
    )


def _believed(scene: Scene, depth_m: float) -> float:
    """Return the relative error that a press to a depth is said to have."""
    held = replace(scene, target=Target(depth_m=depth_m))
    plan = plan_effects(held)
    found = coarse_press(held, plan, 1.0).outputs
    return estimated(held, plan, found).force or 0.0


def judged_depth(scene: Scene) -> float:
    """Return the depth of a scene's target, for a force with preset fast [m]."""
    if scene.target.depth_m is not None:
        return scene.target.depth_m
    fast = FAST.applied(scene)
    plan = plan_effects(fast)
    return follow(fast, path_for(fast, plan)).depth_m


def _everything_on(scene: Scene) -> Scene:
    return replace(scene, tolerance=_EVERYTHING_ON)


def check_tolerances(
    store: PressStore,
    scenes: Sequence[HeldOut] = HELD_OUT,
    *,
    on_progress: Callable[[str], None] = lambda _text: None,
) -> list[ToleranceOutcome]:
    """Check every scene; ten take a quarter of an hour on one core.

    Raises:
        RigError: A press does not go through.
    """
    for preset in (Preset.FAST, Preset.PAPER):  # compiles the kernels, which no time should hold
        pressed_path(Setting(preset, 0.5).applied(scenes[0].scene), [1e-5])
    found = []
    for asked in scenes:
        on_progress(asked.name)
        found.append(check_tolerance(asked, store))
    return found
