"""The optics that a sensor's file gives, before any calibration: lamps, or grey by depth (9DTact).

For grey by depth a file gives a table; ball presses give a polynomial in the indentation alone,
with ``GREY_EXPONENTS`` in place of the terms of slope and place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.optics.colour import photometric
from sim.optics.colour.model_interface_and_response import ColourModel, PixelColours
from sim.sensor.lamps_and_optics import Lamp, Renderer, grey_levels
from sim.sensor.sensor import Sensor
from tacauchy_rig.core.arrays import Float32Array, IntArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import Dimension, parse_quantity

if TYPE_CHECKING:
    from sim.optics.pixels.pixel_blocks import PixelBlocks

_STEEPEST_TILT = 0.9  # that an expansion to fourth order is drawn at
# 1 - sqrt(1 - |t|^2) to fourth order, by the powers of the tilt's components.
_ROOT = {(2, 0): 1 / 2, (0, 2): 1 / 2, (4, 0): 1 / 8, (2, 2): 1 / 4, (0, 4): 1 / 8}


def nominal_photometric(lamps: Sequence[Lamp]) -> photometric.PhotometricModel:
    """Build the model of a matte surface: each lamp adds colour times cos(angle of incidence).

    With tilt t the cosine is cos(elevation) t.d + sin(elevation) sqrt(1 - |t|^2); the root is
    expanded to fourth order. Lamps on every side keep the gel lit, so shadows are left out.
    """
    exponents = photometric.polynomial_exponents(tilt_degree=4, position_degree=0)
    row = {(int(a), int(b)): i for i, (a, b, _, _, _) in enumerate(exponents)}
    coefficients = np.zeros((len(exponents), 3))
    for lamp in lamps:
        colour = np.array(lamp.colour)
        along, across, facing = lamp.towards
        coefficients[row[1, 0]] += along * colour
        coefficients[row[0, 1]] += across * colour
        for term, weight in _ROOT.items():
            coefficients[row[term]] -= facing * weight * colour
    return photometric.PhotometricModel(
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
    exponents = sensor.optics.renderer.exponents
    if exponents is None:
        raise ConfigError(
            f"sensor {sensor.name}: images of optics.kind {sensor.optics.table['kind']} "
            "cannot be calibrated",
            remedy="leave the calibration out, or give this renderer the terms that are fitted",
        )
    grazed = exponents is photometric.BALL_EXPONENTS and sensor.optics.shadows is not None
    return photometric.GRAZED_EXPONENTS if grazed else exponents


def lamp_count_of(sensor: Sensor) -> int:
    """Return how many lamps a calibration looks for: as many as the file names, by colour only."""
    lamps = sensor.optics.lamps if sensor.optics.renderer.sees_slope else ()
    return min(len(lamps), photometric.MOST_LAMPS)


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


PHOTOMETRIC = Renderer(
    read=_read, optional=("shadow_softness", "source"), exponents=photometric.BALL_EXPONENTS
)


GREY_EXPONENTS = photometric.polynomial_exponents(0, 0, indentation_degree=4)


@dataclass(frozen=True, slots=True)
class GreyDepthModel:
    """Change of the grey level as a table of indentation, the same for all channels.

    The table has the camera's response in it, and holds over any no-contact frame.
    """

    depth_m: Sequence[float]  # rising indentations from 0 [m]
    change: Sequence[float]  # grey levels added at each; beyond the last the change stays
    provenance: Mapping[str, object] = field(
        default_factory=lambda: {"source": "nominal table of the sensor's file"}
    )

    def over(self, frame: Float32Array, layout: PixelBlocks) -> PixelColours:
        """Make it ready for a no-contact frame [grey levels], shape [3, height, width]."""
        from sim.optics.colour.colour_kernel import grey_pixels  # noqa: PLC0415 - Warp

        depth, change = np.array(self.depth_m), np.array(self.change)
        table = depth[:-1], 1.0 / np.diff(depth), np.diff(change)
        inputs = [*(layout.array(values) for values in table), float(self.change[0])]
        return PixelColours(light=frame, kernel=grey_pixels, inputs=inputs)


def _read_grey(table: Mapping[str, Any], _lamps: tuple[Lamp, ...], origin: str) -> GreyDepthModel:
    depth = tuple(
        parse_quantity(str(entry), dimension=Dimension.LENGTH, field=f"{origin}: optics.depth")
        for entry in (table["depth"] if isinstance(table["depth"], list) else ())
    )
    change = grey_levels(table["change"], f"{origin}: optics.change")
    rising = all(a < b for a, b in pairwise(depth))
    if len(depth) < 2 or len(depth) != len(change) or depth[0] != 0.0 or not rising:
        raise ConfigError(
            f"{origin}: optics.depth and optics.change are no table",
            remedy='write depth = ["0 mm", "0.5 mm", "1 mm"] and change = [0, -40, -60], rising '
            "from 0 mm",
        )
    return GreyDepthModel(depth, change)


GREY_DEPTH = Renderer(
    read=_read_grey,
    needed=("depth", "change", "source"),
    optional=(),
    exponents=GREY_EXPONENTS,
    sees_slope=False,
)
