"""A renderer of the laboratory: a milky gel that brightens where it is thin, and towards a window.

``[optics]`` of a sensor's file names the brightest change, and how fast it is reached::

    [optics]
    kind = "press-lab-haze"
    brightest = 60
    depth = "0.2 mm"
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sim.optics.colour.model_interface_and_response import PixelColours
from sim.optics.pixels.pixel_blocks import PixelBlocks
from sim.sensor.lamps_and_optics import Lamp, Renderer
from tacauchy_rig.core.arrays import Float32Array, RealArray
from tacauchy_rig.core.quantities import Dimension, parse_quantity

_WINDOW = 20.0  # grey levels between a slope that faces the window and a level one


@dataclass(frozen=True)
class Haze:
    """Obeys ``sim.optics.colour.model_interface_and_response.ColourModel``."""

    brightest: float
    depth_m: float
    provenance: Mapping[str, object] = field(default_factory=lambda: {"source": "the press lab"})

    def over(self, frame: Float32Array, _layout: PixelBlocks) -> PixelColours:
        """Change the light of a no-contact frame by a function of NumPy."""
        return PixelColours(light=frame, function=self.change)

    def change(self, tilt: Float32Array, indentation_m: Float32Array) -> RealArray:
        """Return the change of red, green and blue [grey levels]; the window is blue."""
        haze = self.brightest * (1.0 - np.exp(-indentation_m / self.depth_m))
        return np.stack([haze, haze, haze + _WINDOW * tilt[0]])


def _read(table: Mapping[str, Any], _lamps: tuple[Lamp, ...], origin: str) -> Haze:
    depth_m = parse_quantity(
        table["depth"], dimension=Dimension.LENGTH, field=f"{origin}: optics.depth"
    )
    return Haze(brightest=float(table["brightest"]), depth_m=depth_m)


RENDERER = Renderer(read=_read, needed=("brightest", "depth"), sees_slope=False)
