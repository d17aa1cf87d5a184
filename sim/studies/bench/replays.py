"""A whole replay: six forces met on one loading path, with fields and images."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sim.error.settings import setting_of
from sim.error.tolerance import Tolerance, keeping
from sim.fields.surface import SurfaceState
from sim.replay import replay_forces, replay_scene
from sim.scene.scene import Scene
from sim.sensor.sensor import load_sensor
from tacauchy_rig.core.arrays import ImageArray

FORCE_ERROR_MAX = 0.02
TIME_MAX_S = 20.0
_KIB, _MIB = 1024.0, 1024.0**2
MEMORY_MAX_MIB = 2e9 / _MIB

ImageOf = Callable[[SurfaceState], ImageArray]


def peak_memory_mib() -> float:
    """Return the largest resident set so far [MiB]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1.0 if sys.platform == "darwin" else _KIB) / _MIB


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayRow:
    """A replay of a run's forces.

    Attributes:
        setting: A preset, or a mesh between two.
        presses_s: Mesh, presses and fields [s].
        images_s: Height maps and images of all trials [s].
        force_error: Believed relative error of F_z, the largest; None where nothing is known.
        memory_mib: The process's peak so far [MiB].
    """

    setting: str
    trial_count: int
    newton_iterations: int
    presses_s: float
    images_s: float
    force_error: float | None
    memory_mib: float

    @property
    def wall_s(self) -> float:
        """All of it [s]."""
        return self.presses_s + self.images_s

    @property
    def is_within(self) -> bool:
        """F_z is believed to within 2 %."""
        return self.force_error is not None and self.force_error <= FORCE_ERROR_MAX


def measure_replay(
    scene: Scene,
    forces_n: Sequence[float],
    image_of: ImageOf,
    *,
    tolerance: Tolerance | None = None,
) -> ReplayRow:
    """Replay forces [N] on a scene's sensor and indenter.

    Args:
        scene: Its preset counts where there is no tolerance.
        image_of: Makes the image of a pressed surface, from its height maps on.
        tolerance: Of F_z; the cheapest settings that promise it are taken, and choosing them is in
            the time.

    Raises:
        ConfigError: No settings promise the tolerance.
        ConvergenceError: A force cannot be reached.
    """
    started = time.perf_counter()
    sensor = load_sensor(scene.sensor)
    asked = replay_scene(sensor, scene.indenter, forces_n, preset=scene.preset)
    if tolerance is not None:
        asked = keeping(asked, tolerance)
    found, fields = replay_forces(asked, forces_n)
    pressed = time.perf_counter()
    for trial in fields:
        image_of(trial.surface)
    errors = [trial.force_error_estimate for trial in found.trials]
    known = [error for error in errors if error is not None]
    return ReplayRow(
        setting=str(setting_of(asked)),
        trial_count=len(found.trials),
        newton_iterations=sum(trial.newton_iterations for trial in found.trials),
        presses_s=pressed - started,
        images_s=time.perf_counter() - pressed,
        force_error=max(known) if len(known) == len(errors) else None,
        memory_mib=peak_memory_mib(),
    )
