"""The optics that a sensor's file gives, before any calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sim.optics.colour.photometric import PhotometricModel
from sim.optics.colour.pixel_colours import ColourModel
from sim.optics.colour.polynomial import BALL_EXPONENTS, polynomial_exponents
from sim.optics.colour.shading_terms import MOST_LAMPS
from sim.sensor.optics import Lamp, Renderer
from sim.sensor.sensor import Sensor
from tacauchy_rig.core.arrays import IntArray
from tacauchy_rig.core.errors import ConfigError

# Sine of the steepest slope that a nominal model, an expansion to fourth order, is drawn at.
_STEEPEST_TILT = 0.9
# 1 - sqrt(1 - |t|^2) to fourth order, by the powers of the tilt's components.
_ROOT = {(2, 0): 1 / 2, (0, 2): 1 / 2, (4, 0): 1 / 8, (2, 2): 1 / 4, (0, 4): 1 / 8}


def nominal_photometric(lamps: Sequence[Lamp]) -> PhotometricModel:
    """Build the model of a matte surface: each lamp adds colour times cos(angle of incidence).

    With tilt t the cosine is cos(elevation) t.d + sin(elevation) sqrt(1 - |t|^2); the root is
    expanded to fourth order. Lamps on every side keep the gel lit, so shadows are left out.
    """
    exponents = polynomial_exponents(tilt_degree=4, position_degree=0)
    row = {(int(a), int(b)): i for i, (a, b, _, _, _) in enumerate(exponents)}
    coefficients = np.zeros((len(exponents), 3))
    for lamp in lamps:
        colour = np.array(lamp.colour)
        along, across, facing = lamp.towards
        coefficients[row[1, 0]] += along * colour
        coefficients[row[0, 1]] += across * colour
        for term, weight in _ROOT.items():
            coefficients[row[term]] -= facing * weight * colour
    return PhotometricModel(
        exponents=exponents,
        coefficients=coefficients,
        tilt_limit=_STEEPEST_TILT,
        provenance={"source": "nominal lamp directions", "lamp_count": len(lamps)},
    )


def exponents_for(sensor: Sensor) -> IntArray:
    """Return the terms that a calibration fits to a sensor's images.

    Raises:
        ConfigError: Its renderer brings none.
    """
    optics = sensor.optics
    if optics.renderer.exponents is None:
        raise ConfigError(
            f"sensor {sensor.name}: images of optics.kind {optics.kind} cannot be calibrated",
            remedy="leave the calibration out, or give this renderer the terms that are fitted",
        )
    return optics.renderer.exponents


def lamp_count_of(sensor: Sensor) -> int:
    """Return how many lamps a calibration looks for: as many as the file names, by colour only."""
    lamps = sensor.optics.lamps if sensor.optics.renderer.sees_slope else ()
    return min(len(lamps), MOST_LAMPS)


def nominal_model(sensor: Sensor) -> ColourModel:
    """Return the optics that a sensor's file gives.

    Raises:
        ConfigError: It gives none.
    """
    model: ColourModel | None = sensor.optics.model
    if model is None:
        raise ConfigError(
            f"sensor {sensor.name} has no nominal lamps, and sensor.optics_calibration is empty",
            remedy="calibrate: `tacauchy-rig calibrate optics`, and name the file it writes",
        )
    return model


def _read(_table: Mapping[str, Any], lamps: tuple[Lamp, ...], _origin: str) -> ColourModel | None:
    return nominal_photometric(lamps) if lamps else None


PHOTOMETRIC = Renderer(read=_read, optional=("shadow_softness", "source"), exponents=BALL_EXPONENTS)
