"""The photometric model over the pixels of one image, made ready for many surfaces.

What depends on a pixel's place alone is summed beforehand: the polynomial's powers of v for each
row, and each near lamp's direction and colours for each pixel or row.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from sim.arrays import IntArray
from sim.optics.height.tilt import Float32Array
from sim.optics.render.photometric.colour_kernel import Colours, colour_blocks
from sim.optics.render.photometric.polynomial import RealArray
from sim.optics.render.pixel_kernel import LANES, Block
from sim.optics.render.pixel_planes import CPU, PixelLayout, Planes, SampledBand

if TYPE_CHECKING:
    from sim.optics.render.photometric.model import PhotometricModel

# Where a pixel's samples are tilted alike to this, the colour of their mean is their mean colour.
_LEVEL_TILT = 0.01
_NO_LIMIT_M = 1e3


class PhotometricPixels:
    """Mean colours of pixels' samples.

    Args:
        model: Colour of a surface.
        position: Normalised place of every pixel, row after row, shape [2, height * width].
        layout: Of the image.
    """

    def __init__(self, model: PhotometricModel, position: RealArray, layout: PixelLayout) -> None:
        columns = layout.geometry.width
        u, v = position[0, :columns], position[1, ::columns]
        degrees = _degrees(model.exponents)
        weights = _row_weights(model, degrees, v)
        lamps = _lamp_planes(model, position, layout)
        colours: Any = Colours()
        colours.tilt_limit = model.tilt_limit
        colours.depth_limit = min(model.indentation_limit_m, _NO_LIMIT_M)
        colours.along_powers, colours.depth_powers = degrees.shape
        colours.degrees = wp.array(degrees.ravel(), dtype=wp.int32, device=CPU)
        colours.weight_count = weights.shape[1] * 3
        colours.weights = wp.array(weights.ravel(), dtype=wp.float32, device=CPU)
        colours.along = wp.array(_in_blocks(u), dtype=Block, device=CPU)
        colours.lamp_count = 0 if model.terms is None else len(model.terms.lamps)
        colours.bend = 0.0 if model.terms is None else model.terms.softness**2
        colours.crease_limit = 0.0 if model.terms is None else model.terms.crease_limit
        colours.lamps = wp.array(lamps.reshape(-1, LANES), dtype=Block, device=CPU)
        colours.lamp_weights = wp.array(
            _lamp_weights(model, v).ravel(), dtype=wp.float32, device=CPU
        )
        self._colours = colours

    def over(self, band: SampledBand, change: Planes) -> Callable[[], None]:
        """Return what writes the change of colour of a band's pixels; see ``PixelColours``."""
        held = band.buffers
        count = (band.rows.stop - band.rows.start) * band.layout.blocks
        whole: Any = change.blocks.reshape((3, -1))
        inputs = [
            self._colours,
            band.band,
            _LEVEL_TILT,
            held.along.shifted,
            held.across.blocks,
            held.dent.blocks,
        ]
        recorded: Any = wp.launch(
            colour_blocks, dim=count, inputs=inputs, outputs=[whole], device=CPU, record_cmd=True
        )
        launch: Callable[[], None] = recorded.launch
        return launch


def _degrees(exponents: IntArray) -> IntArray:
    """Return the highest degree of tilt beside each power of u (falling) and of indentation.

    Returns:
        Shape [powers of u, powers of indentation]; -1 where there is no such term.
    """
    along, deep = exponents[:, 2], exponents[:, 4]
    degrees = np.full((along.max(initial=0) + 1, deep.max(initial=0) + 1), -1, dtype=np.int32)
    np.maximum.at(degrees, (along, deep), exponents[:, 0] + exponents[:, 1])
    return degrees[::-1]


def _row_weights(model: PhotometricModel, degrees: IntArray, v: RealArray) -> Float32Array:
    """Return each row's coefficients in the order in which the kernel comes to the terms.

    Returns:
        Shape [row_count, term_count, 3].
    """
    order = [
        (a, b, len(degrees) - 1 - c, e)
        for c, row in enumerate(degrees.tolist())
        for e, degree in enumerate(row)
        for b in range(degree + 1)
        for a in range(degree - b + 1)
    ]
    place = {term: number for number, term in enumerate(order)}
    weights = np.zeros((len(v), len(order), 3))
    for (a, b, c, d, e), levels in zip(model.exponents.tolist(), model.coefficients, strict=True):
        weights[:, place[a, b, c, e]] += (v.astype(np.float64) ** d)[:, None] * levels
    return weights.astype(np.float32)


def _lamp_planes(model: PhotometricModel, position: RealArray, layout: PixelLayout) -> Float32Array:
    """Return each lamp's direction and light on level gel, shape [4 lamp_count, row, column]."""
    if model.terms is None or not model.terms.lamps:
        return np.zeros((0, LANES), dtype=np.float32)
    place = np.stack([position[0], position[1] * np.float32(model.terms.aspect)])
    lamps = [lamp.seen_from(place, softness=model.terms.softness) for lamp in model.terms.lamps]
    return _in_blocks(np.concatenate(lamps).reshape(-1, layout.geometry.width))


def _lamp_weights(model: PhotometricModel, v: RealArray) -> Float32Array:
    """Return level and slope along each row of the colours of lamps and creases.

    Returns:
        Shape [row_count, lamp_count + 1, 3, 2].
    """
    if model.terms is None:
        return np.zeros((len(v), 1, 3, 2), dtype=np.float32)
    level, along, across = model.term_coefficients.reshape(-1, 3, 3).transpose(1, 0, 2)
    levels = level + v[:, None, None] * across
    return np.stack([levels, np.broadcast_to(along, levels.shape)], axis=-1).astype(np.float32)


def _in_blocks(rows: RealArray) -> Float32Array:
    """Fill rows up to whole blocks, shape [row_count, blocks, LANES] or [blocks, LANES]."""
    short = -rows.shape[-1] % LANES
    widths = [(0, 0)] * (rows.ndim - 1) + [(0, short)]
    return np.pad(rows, widths, mode="edge").reshape(*rows.shape[:-1], -1, LANES).astype(np.float32)
