"""A model of colours over the pixels of one camera, made ready for many surfaces.

What depends on a pixel's place alone is summed beforehand: the polynomial's powers of v for each
row, and each near lamp's direction and colours for each pixel or row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from sim.arrays import Float32Array, IntArray, RealArray
from sim.optics.colour.grey_depth import GreyDepthModel
from sim.optics.colour.photometric import PhotometricModel, normalised_positions
from sim.optics.colour.response import LINEAR, Response
from sim.optics.render.colour_kernel import Colours, colour_pixels, grey_pixels
from sim.optics.render.pixel_blocks import BlockMemory, PixelBlocks

ColourModel = PhotometricModel | GreyDepthModel

_NO_LIMIT_M = 1e3  # deeper than any gel


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelColours:
    """What kernels take of a model over a no-contact frame.

    Attributes:
        light: Of the no-contact frame [grey levels], shape [3, height, width].
        response: How the camera shows light.
        kernel: Writes the mean change of light of the pixels' samples.
        inputs: Of the kernel, but for samples.
        needs_tilt: Whether the samples that it takes are tilts and indentations, not those alone.
    """

    light: Float32Array
    response: Response
    kernel: Any
    inputs: list[Any]
    needs_tilt: bool

    def samples(self, along: BlockMemory, across: BlockMemory, dent: BlockMemory) -> list[Any]:
        """Return the samples that the kernel takes."""
        tilt = [along.shifted[:, 0], across.blocks[0]] if self.needs_tilt else []
        return [*tilt, dent.blocks[0]]


def pixel_colours(
    model: ColourModel, background: Float32Array, layout: PixelBlocks
) -> PixelColours:
    """Make a model ready for a no-contact frame [grey levels], shape [3, height, width]."""
    if isinstance(model, GreyDepthModel):
        table = [layout.array(model.depth_m), layout.array(model.change)]
        return PixelColours(
            light=background, response=LINEAR, kernel=grey_pixels, inputs=table, needs_tilt=False
        )
    light = model.response.light(background)
    gain = model.gain(light)
    position = normalised_positions(layout.geometry.height, layout.geometry.width)
    columns = layout.pixel_rows(position[:1, : layout.geometry.width])
    inputs = [
        _colours(model, position, layout),
        columns[0],
        layout.array(_lamp_planes(model, position, layout), layout.block),
        layout.pixel_rows(np.ones_like(light) if gain is None else gain),
    ]
    return PixelColours(
        light=np.asarray(light, dtype=np.float32),
        response=model.response,
        kernel=colour_pixels,
        inputs=inputs,
        needs_tilt=True,
    )


def _colours(model: PhotometricModel, position: Float32Array, layout: PixelBlocks) -> Any:
    v = position[1, :: layout.geometry.width]
    degrees = _degrees(model.exponents)
    weights = _row_weights(model, degrees, v)
    colours: Any = Colours()
    colours.tilt_limit = model.tilt_limit
    colours.depth_limit = min(model.indentation_limit_m, _NO_LIMIT_M)
    colours.along_powers, colours.depth_powers = degrees.shape
    colours.degrees = wp.array(degrees.ravel(), dtype=wp.int32, device=layout.device)
    colours.weight_count = weights.shape[1] * 3
    colours.weights = layout.array(weights.ravel())
    colours.lamp_count = 0 if model.terms is None else len(model.terms.lamps)
    colours.bend = 0.0 if model.terms is None else model.terms.softness**2
    colours.crease_limit = 0.0 if model.terms is None else model.terms.crease_limit
    colours.lamp_weights = layout.array(_lamp_weights(model, v).ravel())
    return colours


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


def _lamp_planes(model: PhotometricModel, position: RealArray, layout: PixelBlocks) -> RealArray:
    """Return each lamp's direction and light on level gel, shape [4 lamp_count blocks, lanes]."""
    if model.terms is None or not model.terms.lamps:
        return np.zeros((0, layout.lanes), dtype=np.float32)
    place = np.stack([position[0], position[1] * np.float32(model.terms.aspect)])
    lamps = [lamp.seen_from(place, softness=model.terms.softness) for lamp in model.terms.lamps]
    rows = np.concatenate(lamps).reshape(-1, layout.geometry.width)
    short = -layout.geometry.width % layout.lanes
    return np.pad(rows, ((0, 0), (0, short)), mode="edge").reshape(-1, layout.lanes)


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
