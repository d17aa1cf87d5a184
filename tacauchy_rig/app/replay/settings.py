"""The settings of a configuration as objects of the simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from typing import TypeVar

from sim.error import Tolerance, parse_tolerance
from sim.optics.colour.nominal import nominal_model
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.scene import Drive, Preset
from sim.scene.terms import parse_indenter
from sim.sensor.sensor import Sensor, load_sensor
from tacauchy_rig.app.replay.optics import calibrated_optics
from tacauchy_rig.core.config.model import IndenterKind, RigConfig
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.registry import Kind, names, unknown

_Closed = TypeVar("_Closed", bound=StrEnum)

AUTO = "auto"
"""In place of a preset: the cheapest with a stated accuracy of F_z of 3 %, or else ``balanced``."""
OF_AUTO = Tolerance(relative=0.03)


def check_names(config: RigConfig) -> None:
    """Refuse an unknown sensor, law, indenter, preset, tolerance or drive.

    Raises:
        ConfigError: The field, and what there is.
    """
    sensor_of(config)
    preset_of(config)
    tolerance_of(config)
    drive_of(config)
    indenter_of(config)


def check_optics(config: RigConfig, sensor: Sensor, given: str | None = None) -> str:
    """Refuse unusable optics before the simulation.

    Args:
        given: Calibration file in place of the configured one.

    Returns:
        Which optics they are, in words.

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
    layers = tuple(
        replace(layer, material=replace(layer.material, law=law)) for layer in sensor.layers
    )
    sensor = replace(sensor, material=replace(material, law=law), layers=layers)
    return sensor if config.replay.relaxation else sensor.relaxing(())


def preset_of(config: RigConfig) -> Preset:
    """Return the configured preset; of ``auto`` the one that is used if none is accurate enough.

    Raises:
        ConfigError: There is none of that name.
    """
    if config.replay.preset == AUTO:
        return Preset.BALANCED
    return _member(Preset, config.replay.preset, "replay.preset", "preset", others=[AUTO])


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
