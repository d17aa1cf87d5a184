"""What a configuration says of the replay, for the simulator; and whether one can be made."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from typing import TypeVar

from sim.error.settings import setting_of
from sim.error.tolerance import Tolerance, parse_tolerance
from sim.optics.colour.nominal import nominal_model
from sim.replay import replay_scene
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.scene import Drive, Preset
from sim.sensor.sensor import Sensor, load_sensor
from tacauchy_rig.config.model import IndenterKind, RigConfig
from tacauchy_rig.errors import ConfigError
from tacauchy_rig.loop.optics import calibrated_optics

_Closed = TypeVar("_Closed", bound=StrEnum)


def check_names(config: RigConfig) -> None:
    """Refuse a sensor, a preset, a tolerance or a drive that nothing is known by.

    Raises:
        ConfigError: The field, and what there is.
    """
    sensor_of(config)
    preset_of(config)
    tolerance_of(config)
    drive_of(config)


def check_replay(config: RigConfig) -> str:
    """Refuse what no replay could be made with, before six presses are done for it.

    Returns:
        What a replay would be made with, in words.

    Raises:
        ConfigError: No such sensor or preset, no preset keeps the tolerance, or the optics'
            calibration file is missing or damaged.
    """
    sensor, tolerance = sensor_of(config), tolerance_of(config)
    scene = replay_scene(
        sensor,
        indenter_of(config),
        config.protocol.force_targets,
        preset=preset_of(config),
        tolerance=tolerance,
        drive=drive_of(config),
    )
    kept = "" if tolerance is None else f" for a tolerance of {tolerance}"
    return f"{sensor.title}, preset {setting_of(scene)}{kept}, {check_optics(config, sensor)}"


def check_optics(config: RigConfig, sensor: Sensor) -> str:
    """Refuse optics that nothing can be rendered with, before the simulation.

    Returns:
        Which optics they are, in words.

    Raises:
        ConfigError: The calibration file is missing or damaged, or of images of another size or
            scale; or there is none, nothing of the rig is emulated, and the sensor's file names
            no lamps.
    """
    given = config.sensor.optics_calibration
    if given:
        calibrated_optics(given, sensor)
        return f"optics from {given}"
    if config.has_emulated_devices and sensor.optics.renderer.exponents is not None:
        return "optics calibrated on the emulated sensor"
    nominal_model(sensor)
    return "nominal optics of the sensor's file, not calibrated"


def sensor_of(config: RigConfig) -> Sensor:
    """Load the configured sensor with the configured material.

    Raises:
        ConfigError: There is no such sensor, or it has layers and one material is configured.
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
    return replace(sensor, material=material)


def preset_of(config: RigConfig) -> Preset:
    """Return the configured preset.

    Raises:
        ConfigError: There is none of that name.
    """
    return _member(Preset, config.replay.preset, "replay.preset", "preset")


def tolerance_of(config: RigConfig) -> Tolerance | None:
    """Return the tolerance that chooses the preset, if one is configured.

    Raises:
        ConfigError: It is neither a force nor a share.
    """
    text = config.replay.tolerance
    return None if text is None else parse_tolerance(text, field="replay.tolerance")


def drive_of(config: RigConfig) -> Drive:
    """Return how the replay reaches a force.

    Raises:
        ConfigError: There is no such way.
    """
    return _member(Drive, config.replay.drive, "replay.drive", "way to reach a force")


def _member(kind: type[_Closed], value: str, field: str, what: str) -> _Closed:
    try:
        return kind(value)
    except ValueError as error:
        raise ConfigError(
            f"{field}: {value!r} is no {what}",
            remedy=f"one of: {', '.join(known.value for known in kind)}",
        ) from error


def indenter_of(config: RigConfig) -> Indenter:
    """Return the configured indenter for the simulator."""
    given = config.indenter
    if given.kind is IndenterKind.SPHERE:
        return Sphere(diameter_m=given.diameter)
    return Cylinder(diameter_m=given.diameter, fillet_m=given.fillet)
