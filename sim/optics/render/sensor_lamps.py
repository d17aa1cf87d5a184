"""The optics of a sensor's file, as the renderer wants them."""

from __future__ import annotations

from sim.optics.render.grey_depth import GreyDepthModel, nominal_grey
from sim.optics.render.nominal import Lamp, nominal_photometric
from sim.optics.render.photometric.model import PhotometricModel
from sim.optics.render.photometric.shading_terms import MOST_LAMPS
from sim.optics.render.shadows.shadow import ShadowCaster
from sim.sensor.sensor import Sensor
from sim.sensor.tables import OpticsKind
from tacauchy_rig.errors import ConfigError


def lamps_of(sensor: Sensor) -> list[Lamp]:
    """Return the nominal lamps, none where the file names none."""
    return [
        Lamp(azimuth_rad=lamp.azimuth_rad, elevation_rad=lamp.elevation_rad, colour=lamp.colour)
        for lamp in sensor.optics.lamps
    ]


def lamp_count_of(sensor: Sensor) -> int:
    """Return how many lamps a calibration looks for: as many as the file names, by colour only."""
    if sensor.optics.kind is not OpticsKind.PHOTOMETRIC:
        return 0
    return min(len(sensor.optics.lamps), MOST_LAMPS)


def shadows_of(sensor: Sensor) -> ShadowCaster | None:
    """Return the lamps that cast shadows; None unless the sensor's file asks for shadows."""
    softness = sensor.optics.shadow_softness_m
    return None if softness is None else ShadowCaster(lamps=lamps_of(sensor), softness_m=softness)


def nominal_model(sensor: Sensor) -> PhotometricModel | GreyDepthModel:
    """Return the optics that a sensor's file gives.

    Raises:
        ConfigError: It gives none.
    """
    optics = sensor.optics
    if optics.kind is OpticsKind.GREY_DEPTH:
        return nominal_grey(optics.grey_depth_m, optics.grey_change)
    if not optics.lamps:
        raise ConfigError(
            f"sensor {sensor.name} has no nominal lamps, and sensor.optics_calibration is empty",
            remedy="calibrate: `tacauchy-rig calibrate optics`, and name the file it writes",
        )
    return nominal_photometric(lamps_of(sensor))
