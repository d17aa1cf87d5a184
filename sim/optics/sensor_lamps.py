"""The lamps of a sensor's file, as the renderer wants them."""

from __future__ import annotations

from sim.optics.nominal import Lamp
from sim.optics.shadow import ShadowCaster
from sim.sensor import Sensor


def lamps_of(sensor: Sensor) -> list[Lamp]:
    """Return the nominal lamps, none where the file names none."""
    return [
        Lamp(azimuth_rad=lamp.azimuth_rad, elevation_rad=lamp.elevation_rad, colour=lamp.colour)
        for lamp in sensor.optics.lamps
    ]


def shadows_of(sensor: Sensor) -> ShadowCaster | None:
    """Return the lamps that cast shadows; None unless the sensor's file asks for shadows."""
    softness = sensor.optics.shadow_softness_m
    return None if softness is None else ShadowCaster(lamps=lamps_of(sensor), softness_m=softness)
