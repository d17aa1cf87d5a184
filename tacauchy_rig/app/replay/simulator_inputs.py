"""What a run is replayed with: its settings as objects of the simulator, checked before a press."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TypeVar

from sim.cheapest_setting import keeping, setting_of
from sim.effects.effect_choice import PRESET_TOLERANCE
from sim.optics.colour.nominal_optics import nominal_model
from sim.replay import replay_scene
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.scene import Drive, Output, Preset, Scene, Target
from sim.scene.scene_parsing import parse_indenter
from sim.sensor.sensor import Sensor, load_sensor
from sim.tolerance import Tolerance, parse_tolerance
from tacauchy_rig.app.replay.chosen_optics import calibrated_optics
from tacauchy_rig.core.config.settings import IndenterKind, RigConfig
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.registry import Kind, names, unknown

_Closed = TypeVar("_Closed", bound=StrEnum)

AUTO = "auto"
"""In place of a preset: the cheapest with a stated accuracy of F_z of 3 %, or else ``balanced``."""
OF_AUTO = Tolerance(relative=0.03)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayInputs:
    """What a run's measured forces are pressed with."""

    sensor: Sensor
    indenter: Indenter
    preset: Preset
    drive: Drive
    force_tolerance_n: float  # largest |F_z simulated - measured| [N]
    # Take the cheapest preset that keeps it; None takes ``preset``
    tolerance: Tolerance | None = None
    # ``preset`` counts only until forces are known, or if no cheaper one is accurate enough for
    # them
    is_auto: bool = False
    refinement: float = 1.0  # every edge is this many times shorter than the preset's
    # Relative error of F_z that omitted effects may cause; None is the preset's
    effects_error: float | None = None
    # The tolerance that preset and refinement were chosen for
    stated_accuracy: Tolerance | None = None
    friction: float = 0.0  # Coulomb coefficient between indenter and gel
    # How far the indenter's axis is tilted towards x and y of the pad, from the tip upwards [rad];
    # a scene states the same tilt as rotations (-y, x) about x and y
    tilt_rad: tuple[float, float] = (0.0, 0.0)
    # Where its tip comes down, from the pad's centre along x and y [m]
    offset_m: tuple[float, float] = (0.0, 0.0)
    duration_s: float = 1.0  # time from touch to dwell [s], for a gel that relaxes

    def scene(self, forces_n: Sequence[float]) -> Scene:
        """Return the press to the largest of some forces [N]."""
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
        scene = replace(self, tolerance=None, refinement=1.0, effects_error=None).scene([])
        outputs = frozenset(Output) - {Output.SHEAR, Output.MARKERS}
        return replace(scene, target=target, outputs=outputs)

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
        ConfigError: It names a sensor, law, indenter, preset, tolerance or drive that there is
            not; the message has the field and what there is.
    """
    asked = config.replay
    is_auto = asked.preset == AUTO
    return ReplayInputs(
        sensor=sensor_of(config),
        indenter=indenter_of(config),
        preset=Preset.BALANCED
        if is_auto
        else _member(Preset, asked.preset, "replay.preset", "preset", others=[AUTO]),
        drive=_member(Drive, asked.drive, "replay.drive", "way to reach a force"),
        force_tolerance_n=asked.force_tolerance,
        tolerance=parse_tolerance(asked.tolerance, field="replay.tolerance")
        if asked.tolerance is not None
        else None,
        is_auto=is_auto and asked.tolerance is None,
        friction=asked.friction,
        tilt_rad=asked.tilt or (0.0, 0.0),
        offset_m=asked.offset or (0.0, 0.0),
    )


def sensor_of(config: RigConfig) -> Sensor:
    """Load the configured sensor with the configured material.

    Raises:
        ConfigError: There is no such sensor or law, or the sensor has layers and one material is
            configured.
    """
    sensor = load_sensor(config.sensor.name)
    material = sensor.material
    if sensor.layers and (config.replay.young, config.replay.poisson) != (None, None):
        raise ConfigError(
            f"replay.young and replay.poisson do not say which layer of {sensor.title} is meant",
            remedy="leave them out, and name a sensor file of your own with its layers",
        )
    if config.replay.young is not None:
        material = replace(material, young_pa=config.replay.young)
    if config.replay.poisson is not None:
        material = replace(material, poisson=config.replay.poisson)
    law = config.replay.law or material.law
    if unknown(Kind.LAW, law):
        raise ConfigError(
            f"replay.law: {law!r} is no law", remedy=f"one of: {', '.join(names(Kind.LAW))}"
        )
    sensor = replace(sensor, material=material).with_law(law)
    return sensor if config.replay.relaxation else sensor.relaxing(())


def indenter_of(config: RigConfig) -> Indenter:
    """Return the configured indenter for the simulator.

    Raises:
        ConfigError: ``replay.indenter`` is not understood, or its file bounds no body.
    """
    if config.replay.indenter is not None:
        try:
            return parse_indenter(config.replay.indenter)
        except ConfigError as error:
            message = f"replay.indenter: {error.message.removeprefix('--indenter ')}"
            raise ConfigError(message, remedy=error.remedy) from error
    given = config.indenter
    if given.kind is IndenterKind.SPHERE:
        return Sphere(diameter_m=given.diameter)
    return Cylinder(diameter_m=given.diameter, fillet_m=given.fillet)


def _member(
    kind: type[_Closed], value: str, field: str, what: str, *, others: Sequence[str] = ()
) -> _Closed:
    try:
        return kind(value)
    except ValueError as error:
        raise ConfigError(
            f"{field}: {value!r} is no {what}",
            remedy=f"one of: {', '.join([*others, *(known.value for known in kind)])}",
        ) from error


def check_optics(config: RigConfig, sensor: Sensor, given: str | None = None) -> str:
    """Refuse unusable optics before the simulation; return in words which they are.

    Args:
        given: Calibration file in place of the configured one.

    Raises:
        ConfigError: The calibration file is missing or damaged, or of images of another size or
            scale; or there is none, nothing of the rig is emulated, and the sensor's file names
            no lamps.
    """
    given = config.sensor.optics_calibration if given is None else given
    if given:
        calibrated_optics(given, sensor)
        return f"optics from {given}"
    if config.has_emulated_devices and sensor.optics.renderer.exponents is not None:
        return "optics calibrated on the emulated sensor"
    nominal_model(sensor)
    return "nominal optics of the sensor's file, not calibrated"


def check_replay(config: RigConfig) -> str:
    """Refuse what cannot be replayed before anything is pressed; return what a replay would use.

    Raises:
        ConfigError: As ``inputs_of`` and ``check_optics`` do, and if no preset keeps the tolerance.
    """
    inputs = inputs_of(config)
    scene = inputs.scene(config.protocol.force_targets)
    chosen = AUTO if inputs.is_auto else setting_of(scene)
    kept = "" if inputs.tolerance is None else f" for a tolerance of {inputs.tolerance}"
    return f"{inputs.sensor.title}, preset {chosen}{kept}, {check_optics(config, inputs.sensor)}"


DEPTH_SHARE = 0.8
"""Of the gel's height in the middle: what is left of a DIGIT's 2.5 mm over the window is 0.5 mm."""
PRESSURE_MODULI = 5.0
"""Young's moduli that the mean pressure may reach: silicones tear at a few times their modulus."""


def check_gel(config: RigConfig) -> str:
    """Refuse limits beyond what the sensor's gel bears.

    Returns:
        The gel and what the limits leave of it, in words.

    Raises:
        ConfigError: ``limits.max_depth`` goes through the gel, or ``limits.hard_force`` tears it;
            each is named.
    """
    sensor = sensor_of(config)
    height_m = sensor.pad.height_m
    stiffest_pa = max(
        (layer.material.young_pa for layer in sensor.layers), default=sensor.material.young_pa
    )
    pressure_pa = config.limits.hard_force / (math.pi * config.indenter.diameter**2 / 4.0)
    problems = []
    if config.limits.max_depth > DEPTH_SHARE * height_m:
        problems.append(
            f"limits.max_depth: {config.limits.max_depth * 1e3:g} mm is more than "
            f"{DEPTH_SHARE:.0%} of the gel of {sensor.title}, {height_m * 1e3:g} mm high; write at "
            f'most "{DEPTH_SHARE * height_m * 1e3:.3g} mm"'
        )
    if pressure_pa > PRESSURE_MODULI * stiffest_pa:
        most_n = config.limits.hard_force * PRESSURE_MODULI * stiffest_pa / pressure_pa
        problems.append(
            f"limits.hard_force: {config.limits.hard_force:g} N under an indenter of "
            f"{config.indenter.diameter * 1e3:g} mm are {pressure_pa * 1e-6:.2g} MPa, more than "
            f"{PRESSURE_MODULI:g} times the modulus of the gel of {sensor.title}, "
            f'{stiffest_pa * 1e-6:g} MPa: it tears; write at most "{most_n:.3g} N"'
        )
    if problems:
        raise ConfigError(
            "\n".join(problems), remedy="correct the limit, sensor.name or indenter.diameter"
        )
    return (
        f"{sensor.title}, {height_m * 1e3:g} mm high: max_depth leaves "
        f"{(height_m - config.limits.max_depth) * 1e3:.3g} mm of it, hard_force presses with "
        f"{pressure_pa * 1e-6:.2g} MPa on {stiffest_pa * 1e-6:g} MPa"
    )
