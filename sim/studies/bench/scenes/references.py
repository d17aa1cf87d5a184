"""F_z that the scenes are compared with: the same frames with preset reference, kept as JSON."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import Any

from sim.scene.scene import Preset
from sim.studies.bench.scenes.catalogue import BenchScene
from sim.studies.bench.scenes.own_process import Order, commit, pressed
from sim.studies.bench.scenes.press import ScenePress
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.store.codec import from_json, loads

# The next is taken where one does not come to its end in time.
_PRESETS = (Preset.REFERENCE, Preset.ACCURATE, Preset.BALANCED)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """What a scene is compared with.

    Attributes:
        stated: The scene's options: another scene of the same name has no reference.
        command: That made it.
        commit: Of the program that made it.
    """

    stated: dict[str, Any]
    press: ScenePress
    command: str
    commit: str

    def force_error(self, found: ScenePress) -> float:
        """Return how far F_z is off, relative.

        Where the load is given, it is what F_z would be off by at the reference's depth.
        """
        force = found.force_n[2]
        if "force" in self.stated:
            force += found.stiffness_n_m * (self.press.depth_m - found.depth_m)
        return force / self.press.force_n[2] - 1.0

    def sideways_error(self, found: ScenePress) -> float | None:
        """Return how far the motion's resistance is off: M_z of a twist, F_xy of a shift."""
        if found.moment_nm is None or self.press.moment_nm is None:
            return None
        if "twist" in self.stated:
            return found.moment_nm[2] / self.press.moment_nm[2] - 1.0
        if "shift" in self.stated:
            return hypot(*found.force_n[:2]) / hypot(*self.press.force_n[:2]) - 1.0
        return None


def measure_references(
    scenes: Sequence[BenchScene],
    *,
    limit_s: float,
    command: str,
    on_progress: Callable[[str], None] = lambda _text: None,
) -> Iterator[tuple[str, Reference]]:
    """Press every scene with the finest preset that comes to its end in time [s]."""
    for scene in scenes:
        for preset in _PRESETS:
            row = pressed(scene, Order(preset=preset.value, limit_s=limit_s, is_timed=False))
            on_progress(f"  {scene.name}, preset {preset}: {row.failure or f'{row.spent_s:.1f} s'}")
            if row.press is not None:
                yield (
                    scene.name,
                    Reference(
                        stated=scene.stated, press=row.press, command=command, commit=commit()
                    ),
                )
                break


def read_references(file: Path, scenes: Sequence[BenchScene]) -> dict[str, Reference]:
    """Return what is known of these very scenes; nothing where there is no file.

    Raises:
        ConfigError: The file is damaged.
    """
    if not file.exists():
        return {}
    try:
        stored = loads(file.read_bytes(), source=str(file))
        found = from_json(dict[str, Reference], stored, source=str(file))
    except (OSError, RecordError) as error:
        raise ConfigError(
            f"{file} holds no references: {error}", remedy="make it again with --reference"
        ) from error
    stated = {scene.name: scene.stated for scene in scenes}
    return {name: each for name, each in found.items() if stated.get(name) == each.stated}
