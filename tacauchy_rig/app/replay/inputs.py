"""What a run is replayed with, from its configuration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from sim.effects.plan import PRESET_TOLERANCE
from sim.error import Tolerance, keeping, setting_of
from sim.replay import replay_scene
from sim.scene.indenter import Indenter
from sim.scene.scene import Drive, Output, Preset, Scene, Target
from sim.sensor.sensor import Sensor
from tacauchy_rig.app.replay.settings import (
    AUTO,
    OF_AUTO,
    check_optics,
    drive_of,
    indenter_of,
    preset_of,
    sensor_of,
    tolerance_of,
)
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayInputs:
    """What a run's measured forces are pressed with.

    Attributes:
        tolerance: Take the cheapest preset that keeps it; None takes ``preset``.
        is_auto: ``preset`` counts only until forces are known, or if no cheaper one is accurate
            enough for them.
        refinement: Every edge is this many times shorter than the preset's.
        effects_error: Relative error of F_z that omitted effects may cause; None is the preset's.
        stated_accuracy: The tolerance that preset and refinement were chosen for.
        force_tolerance_n: Largest |F_z simulated - measured| [N].
        friction: Coulomb coefficient between indenter and gel.
        tilt_rad: How far the indenter's axis is tilted towards x and y of the pad, from the tip
            upwards [rad]; a scene states the same tilt as rotations (-y, x) about x and y.
        offset_m: Where its tip comes down, from the pad's centre along x and y [m].
        duration_s: Time from touch to dwell [s], for a gel that relaxes.
    """

    sensor: Sensor
    indenter: Indenter
    preset: Preset
    drive: Drive
    force_tolerance_n: float
    tolerance: Tolerance | None = None
    is_auto: bool = False
    refinement: float = 1.0
    effects_error: float | None = None
    stated_accuracy: Tolerance | None = None
    friction: float = 0.0
    tilt_rad: tuple[float, float] = (0.0, 0.0)
    offset_m: tuple[float, float] = (0.0, 0.0)
    duration_s: float = 1.0

    def scene(self, forces_n: Sequence[float]) -> Scene:
        """Return the press to the largest of some forces [N].

        Raises:
            ConfigError: No preset keeps the tolerance.
        """
        scene = replay_scene(
            self.sensor,
            self.indenter,
            forces_n,
            preset=self.preset,
            drive=self.drive,
            tolerance_n=self.force_tolerance_n,
            friction=self.friction,
            tilt_rad=(-self.tilt_rad[1], self.tilt_rad[0]),
            centre_m=self.offset_m,
            duration_s=self.duration_s,
        )
        if self.tolerance is not None:
            return keeping(scene, self.tolerance)
        return replace(scene, refinement=self.refinement, tolerance=self.effects_error)

    @property
    def asked_accuracy(self) -> Tolerance | None:
        """What a press alone at its place is to keep; None where a preset was named.

        Nor where its result depends on the path's steps: with printed markers, whose motion is
        scored, or with a gel that relaxes.
        """
        if self.sensor.markers is not None or self.sensor.material.relaxation:
            return None
        return self.tolerance or (OF_AUTO if self.is_auto else None)

    def quick_scene(self, target: Target) -> Scene:
        """Return the press to a target with steps as long as the force allows."""
        named = replace(self, tolerance=None)
        scene = replace(named.scene([]), target=target, refinement=1.0, tolerance=None)
        return replace(scene, outputs=frozenset(Output) - {Output.SHEAR, Output.MARKERS})

    @property
    def upright(self) -> ReplayInputs:
        """The same press with an indenter that is not tilted."""
        return replace(self, tilt_rad=(0.0, 0.0))

    def tilted(self, x_rad: float, y_rad: float) -> ReplayInputs:
        """Return the press with the indenter tilted further towards x and y [rad]."""
        return replace(self, tilt_rad=(self.tilt_rad[0] + x_rad, self.tilt_rad[1] + y_rad))

    def stiffer(self, factor: float) -> ReplayInputs:
        """Return the press of a gel that is this many times as stiff."""
        return replace(self, sensor=self.sensor.stiffer(factor))

    def moved(self, by_m: tuple[float, float]) -> ReplayInputs:
        """Return the press at a place that is shifted along x and y [m]."""
        return replace(self, offset_m=(self.offset_m[0] + by_m[0], self.offset_m[1] + by_m[1]))

    def settled(self, forces_n: Sequence[float]) -> ReplayInputs:
        """Return the inputs with the preset that ``auto`` chooses for some forces [N].

        It chooses the mesh alone: omitted effects may cost what the named preset allows. Without
        a force it is the preset that stands in its place.
        """
        if not self.is_auto:
            return self
        named = replace(self, is_auto=False)
        if not forces_n:
            return named
        try:
            chosen = keeping(named.scene(forces_n), OF_AUTO)
        except ConfigError:
            return named
        return replace(
            named,
            preset=chosen.preset,
            refinement=chosen.refinement,
            effects_error=PRESET_TOLERANCE[self.preset],
            stated_accuracy=OF_AUTO,
        )


def inputs_of(config: RigConfig) -> ReplayInputs:
    """Return what a configuration is replayed with.

    Raises:
        ConfigError: It names something that does not exist.
    """
    return ReplayInputs(
        sensor=sensor_of(config),
        indenter=indenter_of(config),
        preset=preset_of(config),
        drive=drive_of(config),
        force_tolerance_n=config.replay.force_tolerance,
        tolerance=tolerance_of(config),
        is_auto=config.replay.preset == AUTO and config.replay.tolerance is None,
        friction=config.replay.friction,
        tilt_rad=config.replay.tilt or (0.0, 0.0),
        offset_m=config.replay.offset or (0.0, 0.0),
    )


def check_replay(config: RigConfig) -> str:
    """Refuse a configuration that cannot be replayed, before anything is pressed.

    Returns:
        What a replay would use, in words.

    Raises:
        ConfigError: No such sensor, preset, law or indenter, no preset keeps the tolerance, or the
            optics' calibration file is missing or damaged.
    """
    inputs = inputs_of(config)
    scene = inputs.scene(config.protocol.force_targets)
    chosen = AUTO if inputs.is_auto else setting_of(scene)
    kept = "" if inputs.tolerance is None else f" for a tolerance of {inputs.tolerance}"
    optics = check_optics(config, inputs.sensor)
    return f"{inputs.sensor.title}, preset {chosen}{kept}, {optics}"
