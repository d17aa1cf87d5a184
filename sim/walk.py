"""A press to the largest of some forces, which tells how a stiffer gel goes to any of them.

A law's energy, the contact's and friction's all scale with Young's modulus: at k times the force, a
gel k times as stiff stands where the other one did. So one walk tells depths, from these the gel's
modulus, and from where it passed the stiffer gel goes on, with a step to each force.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from sim.effects.effect_plan import EffectPlan
from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.error.tolerance import setting_of
from sim.scene.scene import Drive, Effect, Output, Scene
from sim.solve.force_search import ForceMatch, push_to_force
from sim.solve.loading_path import LoadingPath
from sim.solve.path_point import PathPoint

History = tuple[tuple[float, float], ...]
"""(depth [m], F_z [N])."""
# Of a force: so much at least is left to be pushed.
_FORCE_LEFT_SHARE = 1e-3
_OWN_WAY = (Effect.GRAVITY, Effect.INERTIA, Effect.VISCOELASTICITY)


@dataclass(frozen=True, slots=True, kw_only=True)
class Walk:
    """A press on its way to forces.

    Attributes:
        history: On the way; of a gel that relaxes, which is pressed anew for each force, at the
            forces alone.
        took_s: Time by the wall or the processor's, whichever is less [s]: others may have worked.
    """

    scene: Scene
    plan: EffectPlan
    path: LoadingPath
    history: History
    took_s: float

    def serves(self, scene: Scene, plan: EffectPlan) -> bool:
        """Return whether a press of another stiffness may go on from this one."""
        return (
            scene.drive is Drive.LOAD
            and setting_of(scene) == setting_of(self.scene)
            and plan.switches == self.plan.switches
            and not goes_its_own_way(plan)
        )

    def on_from(
        self, path: LoadingPath, force_n: float, *, stiffer: float, above_n: float
    ) -> ForceMatch:
        """Push a stiffer gel's path to a force [N], on from where this one passed below it.

        Args:
            path: ``stiffer`` of this one's.
            above_n: The force before [N]: what passed since is told with the match.

        Raises:
            ConvergenceError: The force was not reached.
        """
        start = self._below(force_n / stiffer)
        taken = None if start is None else path.taken_over(start, stiffer=stiffer)
        match = push_to_force(path, force_n, start=taken)
        way = ((depth, stiffer * force) for depth, force in self.history)
        passed = tuple(each for each in way if above_n < each[1] < force_n)
        return replace(match, history=passed + match.history[-1:])

    def _below(self, force_n: float) -> PathPoint | None:
        # From the very force there would be no way to go but what rounding leaves.
        most_n = (1.0 - _FORCE_LEFT_SHARE) * force_n
        known = [point for point in self.path.points if 0.0 < point.force_n[2] <= most_n]
        return max(known, key=lambda point: float(point.force_n[2]), default=None)


def goes_its_own_way(plan: EffectPlan) -> bool:
    """Return whether a stiffer gel, or one pressed in another time, goes another way."""
    return any(plan.is_on(effect) for effect in _OWN_WAY)


def walked(scene: Scene, forces_n: Sequence[float], *, to_go_on: bool) -> Walk:
    """Press a scene's indenter to the largest of some forces [N], without any fields.

    Args:
        scene: As ``replay_scene`` makes it; its plan is kept.
        to_go_on: Go as a replay does and keep where it passed. Else steps are as long as the force
            allows: what shear and markers would ask of them is not asked.

    Raises:
        ConvergenceError: A force cannot be reached.
    """
    started, plan = (time.perf_counter(), time.process_time()), plan_effects(scene)
    if not to_go_on:
        scene = replace(scene, outputs=frozenset({Output.FORCE}))
    relaxes = plan.is_on(Effect.VISCOELASTICITY)
    path = path_for(scene, plan, keeps_all=to_go_on and not relaxes)
    history: History = ()
    if not relaxes:
        history = push_to_force(path, max(forces_n)).history
    # On its way a gel that relaxes is pressed quicker than at its end.
    for force_n in sorted(forces_n) if relaxes else ():
        path = path_for(scene, plan, model=path.model)
        history += push_to_force(path, force_n, duration_s=scene.duration_s).history[-1:]
    took_s = min(time.perf_counter() - started[0], time.process_time() - started[1])
    return Walk(scene=scene, plan=plan, path=path, history=history, took_s=took_s)
