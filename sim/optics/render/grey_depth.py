"""Grey level by depth: the optics of a sensor that sees a translucent gel grow thinner (9DTact).

Before a calibration the sensor's file gives a table; ball presses give a polynomial in the
indentation alone, with ``GREY_EXPONENTS`` in place of the terms of slope and place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sim.arrays import FloatArray
from sim.optics.render.photometric.polynomial import RealArray, polynomial_exponents
from sim.optics.render.pixel_kernel import LANES
from sim.optics.render.pixel_planes import PixelLayout, Planes, SampledBand
from sim.optics.render.response import LINEAR, Response

GREY_EXPONENTS = polynomial_exponents(
    tilt_degree=0, position_degree=0, indentation_degree=4, indentation_tilt_degree=0
)


@dataclass(frozen=True, slots=True, kw_only=True)
class GreyDepthModel:
    """Change of the grey level as a table of indentation, the same for all channels.

    Attributes:
        depth_m: Rising indentations from 0 [m], shape [entry_count].
        change: Grey levels added at each; beyond the last the change stays, shape [entry_count].
        provenance: Where the table comes from, as JSON values with units in the keys.
    """

    depth_m: FloatArray
    change: FloatArray
    provenance: Mapping[str, object] = field(default_factory=dict)

    @property
    def response(self) -> Response:
        """The table has the camera's response in it."""
        return LINEAR

    def gain(self, light: RealArray) -> None:
        """Return None: the change is the same over any no-contact frame."""
        del light

    def evaluate(
        self,
        tilt: RealArray,
        position: RealArray,
        indentation_m: RealArray,
        curvature: RealArray | None = None,
    ) -> RealArray:
        """Return the change of red, green and blue [grey levels], shape [3, n].

        Args:
            tilt: Not used: light that went through the gel does not tell slopes.
            position: Not used.
            indentation_m: Unloaded minus loaded height [m], shape [n].
            curvature: Not used.
        """
        del position, curvature
        level = np.interp(indentation_m, self.depth_m, self.change).astype(tilt.dtype)
        return np.broadcast_to(level, (3, len(level)))

    def of_pixels(self, position: RealArray, layout: PixelLayout) -> GreyPixels:
        """Return it made ready for the pixels of an image."""
        del position, layout
        return GreyPixels(model=self)


@dataclass(frozen=True, slots=True, kw_only=True)
class GreyPixels:
    """Mean grey levels of pixels' samples, wherever the pixels lie; see ``PhotometricPixels``."""

    model: GreyDepthModel

    def over(self, band: SampledBand, change: Planes) -> Callable[[], None]:
        """Return what writes the change of grey of a band's pixels; see ``PixelColours``."""

        def shade() -> None:
            dent = band.of_pixels(band.buffers.dent)
            levels = np.interp(dent, self.model.depth_m, self.model.change)
            rows = change.values[:, band.rows]
            rows[..., LANES : LANES + dent.shape[2]] = levels.mean(axis=0)

        return shade


def nominal_grey(depth_m: Sequence[float], change: Sequence[float]) -> GreyDepthModel:
    """Return the table that a sensor's file gives, before any calibration."""
    return GreyDepthModel(
        depth_m=np.asarray(depth_m, dtype=np.float64),
        change=np.asarray(change, dtype=np.float64),
        provenance={"source": "nominal table of the sensor's file"},
    )
