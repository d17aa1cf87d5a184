"""Nominal photometric model of a sensor lit by coloured lamps, before any calibration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.optics.render.photometric.model import PhotometricModel
from sim.optics.render.photometric.polynomial import polynomial_exponents


@dataclass(frozen=True, slots=True, kw_only=True)
class Lamp:
    """A far lamp of one colour.

    Attributes:
        azimuth_rad: Direction in which it stands, from growing columns towards growing rows [rad].
        elevation_rad: Angle of its light to the unloaded surface [rad].
        colour: Grey levels that it adds to red, green and blue of a surface that faces it.
    """

    azimuth_rad: float
    elevation_rad: float
    colour: tuple[float, float, float]


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
        grazing, facing = math.cos(lamp.elevation_rad), math.sin(lamp.elevation_rad)
        coefficients[row[1, 0]] += grazing * math.cos(lamp.azimuth_rad) * colour
        coefficients[row[0, 1]] += grazing * math.sin(lamp.azimuth_rad) * colour
        for term, weight in (((2, 0), 1 / 2), ((0, 2), 1 / 2)):
            coefficients[row[term]] -= facing * weight * colour
        for term, weight in (((4, 0), 1 / 8), ((2, 2), 1 / 4), ((0, 4), 1 / 8)):
            coefficients[row[term]] -= facing * weight * colour
    return PhotometricModel(
        exponents=exponents,
        coefficients=coefficients,
        tilt_limit=0.9,
        provenance={"source": source, "gain": gain, "lamp_count": len(lamps)},
    )
