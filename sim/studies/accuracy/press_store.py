"""Presses that were made before, so that a measurement that was killed goes on where it stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from sim.effects.plan import plan_effects
from sim.effects.presets import mesh_for
from sim.scene.scene import Effect, Scene
from sim.studies.accuracy.force_limit import PressedPath, pressed_path


@dataclass(frozen=True, slots=True, kw_only=True)
class PressStore:
    """A folder of presses, each under a name that changes with all that decides its force.

    A change of the solver alone changes no name: then empty the folder.
    """

    folder: Path

    def pressed_path(self, scene: Scene, depths_m: Sequence[float]) -> PressedPath:
        """Press to several depths in ascending order [m], or take what was found before.

        Raises:
            RigError: It cannot be meshed or solved.
        """
        file = self.folder / f"{_name(scene, depths_m)}.json"
        if file.exists():
            kept = json.loads(file.read_text("utf-8"))
            return PressedPath(forces_n=tuple(kept["forces_n"]), cpu_s=kept["cpu_s"])
        found = pressed_path(scene, depths_m)
        self.folder.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(asdict(found)) + "\n", "utf-8")
        return found


def _posed(scene: Scene) -> Scene:
    return replace(scene, sensor="", barrier_m=scene.contact_distance_m)


def _name(scene: Scene, depths_m: Sequence[float]) -> str:
    plan = plan_effects(scene)
    mesh = mesh_for(scene, symmetric=plan.is_on(Effect.SYMMETRY)).content_hash
    on = sorted(row.effect.value for row in plan.effects if row.on)
    text = repr((_posed(scene), mesh, on, tuple(depths_m)))
    return hashlib.sha256(text.encode()).hexdigest()[:16]
