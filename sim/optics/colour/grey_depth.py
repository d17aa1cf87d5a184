"""Grey level by depth: the optics of a sensor that sees a translucent gel grow thinner (9DTact).

Before a calibration the sensor's file gives a table; ball presses give a polynomial in the
indentation alone, with ``GREY_EXPONENTS`` in place of the terms of slope and place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from sim.optics.colour.colour_kernel import grey_pixels
from sim.optics.colour.pixel_colours import PixelColours
from sim.optics.colour.polynomial import polynomial_exponents
from sim.optics.pixels.pixel_blocks import PixelBlocks
from sim.sensor.optics import Lamp, Renderer
from tacauchy_rig.core.arrays import Float32Array
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.quantities import Dimension, parse_quantity

GREY_EXPONENTS = polynomial_exponents(
    tilt_degree=0, position_degree=0, indentation_degree=4, indentation_tilt_degree=0
)


@dataclass(frozen=True, slots=True)
class GreyDepthModel:
    """Change of the grey level as a table of indentation, the same for all channels.

    The table has the camera's response in it, and holds over any no-contact frame.

    Attributes:
        depth_m: Rising indentations from 0 [m].
        change: Grey levels added at each; beyond the last the change stays.
    """

    depth_m: Sequence[float]
    change: Sequence[float]
    provenance: Mapping[str, object] = field(
        default_factory=lambda: {"source": "nominal table of the sensor's file"}
    )

    def over(self, frame: Float32Array, layout: PixelBlocks) -> PixelColours:
        """Make it ready for a no-contact frame [grey levels], shape [3, height, width]."""
        depth, change = np.array(self.depth_m), np.array(self.change)
        table = depth[:-1], 1.0 / np.diff(depth), np.diff(change)
        inputs = [*(layout.array(values) for values in table), float(self.change[0])]
        return PixelColours(light=frame, kernel=grey_pixels, inputs=inputs)


def _read(table: Mapping[str, Any], _lamps: tuple[Lamp, ...], origin: str) -> GreyDepthModel:
    depth = tuple(
        parse_quantity(str(entry), dimension=Dimension.LENGTH, field=f"{origin}: optics.depth")
        for entry in table["depth"]
    )
    change = tuple(float(level) for level in table["change"])
    rising = all(a < b for a, b in pairwise(depth))
    if len(depth) < 2 or len(depth) != len(change) or depth[0] != 0.0 or not rising:
        raise ConfigError(
            f"{origin}: optics.depth and optics.change are no table",
            remedy='write depth = ["0 mm", "0.5 mm", "1 mm"] and change = [0, -40, -60], rising '
            "from 0 mm",
        )
    return GreyDepthModel(depth, change)


GREY_DEPTH = Renderer(
    read=_read,
    needed=("depth", "change", "source"),
    optional=(),
    exponents=GREY_EXPONENTS,
    sees_slope=False,
)
