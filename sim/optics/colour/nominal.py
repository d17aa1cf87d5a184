"""The optics that a sensor's file gives, before any calibration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim.optics.colour.grey_depth import GreyDepthModel
from sim.optics.colour.lamps import ShadowCaster
from sim.optics.colour.photometric import PhotometricModel
from sim.optics.colour.polynomial import polynomial_exponents
from sim.optics.colour.shading_terms import MOST_LAMPS
from sim.sensor.sensor import Sensor
from sim.sensor.tables import Lamp, OpticsKind
from tacauchy_rig.errors import ConfigError

# Sine of the steepest slope that a nominal model, an expansion to fourth order, is drawn at.
_STEEPEST_TILT = 0.9


def nominal_photometric(
    lamps: Sequence[Lamp], *, gain: float = 1.0, source: str = "nominal lamp directions"
) -> PhotometricModel:
    """Build the model of a matte surface: each lamp adds colour times cos(angle of incidence).

    With tilt t the cosine is cos(elevation) t.d + sin(elevation) sqrt(1 - |t|^2); the root is
    expanded to fourth order. Lamps on every side keep the gel lit, so shadows are left out.

    Args:
        lamps: Lamps of the sensor.
        gain: Factor on all colours.
        source: Said in the provenance.
    """
    exponents = polynomial_exponents(tilt_degree=4, position_degree=0)
    row = {(int(a), int(b)): i for i, (a, b, _, _, _) in enumerate(exponents)}
    coefficients = np.zeros((len(exponents), 3))
    for lamp in lamps:
        colour = gain * np.array(lamp.colour)
        along, across, facing = lamp.towards
        coefficients[row[1, 0]] += along * colour
        coefficients[row[0, 1]] += across * colour
        for term, weight in (((2, 0), 1 / 2), ((0, 2), 1 / 2)):
            coefficients[row[term]] -= facing * weight * colour
        for term, weight in (((4, 0), 1 / 8), ((2, 2), 1 / 4), ((0, 4), 1 / 8)):
            coefficients[row[term]] -= facing * weight * colour
    return PhotometricModel(
        exponents=exponents,
        coefficients=coefficients,
        tilt_limit=_STEEPEST_TILT,
        provenance={"source": source, "gain": gain, "lamp_count": len(lamps)},
    )


def lamp_count_of(sensor: Sensor) -> int:
    """Return how many lamps a calibration looks for: as many as the file names, by colour only."""
    if sensor.optics.kind is not OpticsKind.PHOTOMETRIC:
        return 0
    return min(len(sensor.optics.lamps), MOST_LAMPS)


def shadows_of(sensor: Sensor) -> ShadowCaster | None:
    """Return the lamps that cast shadows; None unless the sensor's file asks for shadows."""
    softness = sensor.optics.shadow_softness_m
    return (
        None if softness is None else ShadowCaster(lamps=sensor.optics.lamps, softness_m=softness)
    )


def nominal_model(sensor: Sensor) -> PhotometricModel | GreyDepthModel:
    """Return the optics that a sensor's file gives.

    Raises:
        ConfigError: It gives none.
    """
    optics = sensor.optics
    if optics.kind is OpticsKind.GREY_DEPTH:
        return GreyDepthModel(optics.grey_depth_m, optics.grey_change)
    if not optics.lamps:
        raise ConfigError(
            f"sensor {sensor.name} has no nominal lamps, and sensor.optics_calibration is empty",
            remedy="calibrate: `tacauchy-rig calibrate optics`, and name the file it writes",
        )
    return nominal_photometric(sensor.optics.lamps)
