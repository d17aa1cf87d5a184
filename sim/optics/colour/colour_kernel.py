"""Warp kernels of the change of light that a surface brings, a block of pixels in each thread."""

from typing import Any

import warp as wp

from sim.optics.colour.model_interface_and_response import CREASE_UNIT_M, INDENTATION_UNIT_M
from sim.optics.pixels.blur_and_exposure_kernel import Layout, bend_of, place_of

# Where pixels' samples are tilted alike to this, the colour of their mean is their mean colour.
_LEVEL_TILT = wp.constant(wp.float32(0.01))


@wp.struct
class Colours:
    """A photometric model for the pixels of an image; rows of weights are rows of pixels."""

    tilt_limit: wp.float32
    depth_limit: wp.float32
    along_powers: wp.int32  # of the place along a row
    depth_powers: wp.int32
    degrees: wp.array(dtype=wp.int32)  # of tilt, for each power of place (falling) and depth
    weight_count: wp.int32  # in a row
    weights: wp.array(dtype=wp.float32)
    lamp_count: wp.int32
    bend: wp.float32  # softness squared
    crease_limit: wp.float32
    lamp_weights: wp.array(dtype=wp.float32)  # level and slope along a row, of each colour


@wp.func
def _polynomial(model: Colours, row: int, u: Any, p: Any, q: Any, w: Any):
    """Sum monomials from one to the next, and powers of the place along the row by Horner."""
    total_red, total_green, total_blue = type(u)(), type(u)(), type(u)()
    at = row * model.weight_count
    for c in range(model.along_powers):
        red, green, blue = type(u)(), type(u)(), type(u)()
        power = type(u)(wp.float32(1.0))
        for e in range(model.depth_powers):
            degree = model.degrees[c * model.depth_powers + e]
            column = power
            for b in range(degree + 1):
                term = column
                for _a in range(degree - b + 1):
                    red += model.weights[at] * term
                    green += model.weights[at + 1] * term
                    blue += model.weights[at + 2] * term
                    at += 3
                    term = wp.cw_mul(term, p)
                column = wp.cw_mul(column, q)
            power = wp.cw_mul(power, w)
        total_red = wp.cw_mul(total_red, u) + red
        total_green = wp.cw_mul(total_green, u) + green
        total_blue = wp.cw_mul(total_blue, u) + blue
    return total_red, total_green, total_blue


@wp.func
def _bounded(size: Any, limit: wp.float32):
    """Return by what tilts are multiplied that are no steeper than a limit then."""
    bound = type(size)()
    for n in range(len(size)):
        bound[n] = limit / wp.max(wp.sqrt(size[n]), limit)
    return bound


@wp.func
def _lit(
    lamps: wp.array(dtype=Any),
    softness_squared: wp.float32,
    at: int,
    plane: int,
    p: Any,
    q: Any,
    upright: Any,
):
    """Return the light of a near lamp less that on level gel, see ``shading_terms``."""
    cosine = wp.cw_mul(p, lamps[at]) + wp.cw_mul(q, lamps[at + plane])
    cosine += wp.cw_mul(upright, lamps[at + 2 * plane])
    root = wp.cw_mul(cosine, cosine)
    for n in range(len(root)):
        root[n] = wp.sqrt(root[n] + softness_squared)
    return (cosine + root) * wp.float32(0.5) - lamps[at + 3 * plane]


@wp.func
def _colour(
    model: Colours,
    lamps: wp.array(dtype=Any),
    layout: Layout,
    row: int,
    k: int,
    u: Any,
    p: Any,
    q: Any,
    dent: Any,
    bend: Any,
):
    """Return the change of red, green and blue of a block of samples [grey levels]."""
    size = wp.cw_mul(p, p) + wp.cw_mul(q, q)
    upright, depth, crease = type(p)(), type(p)(), type(p)()
    for n in range(len(p)):
        upright[n] = wp.sqrt(wp.max(wp.float32(1.0) - size[n], wp.float32(0.0)))
        depth[n] = wp.min(dent[n], model.depth_limit)
        crease[n] = wp.clamp(bend[n], -model.crease_limit, model.crease_limit)
    bound = _bounded(size, model.tilt_limit)
    depth = depth * wp.float32(1.0 / INDENTATION_UNIT_M)
    red, green, blue = _polynomial(model, row, u, wp.cw_mul(p, bound), wp.cw_mul(q, bound), depth)
    plane = layout.rows * layout.blocks
    for m in range(model.lamp_count + 1):
        value = crease * wp.float32(CREASE_UNIT_M)
        if m < model.lamp_count:
            place = 4 * m * plane + row * layout.blocks + k
            value = _lit(lamps, model.bend, place, plane, p, q, upright)
        shifted = wp.cw_mul(value, u)
        at = 6 * (row * (model.lamp_count + 1) + m)
        weights = model.lamp_weights
        red += weights[at] * value + weights[at + 1] * shifted
        green += weights[at + 2] * value + weights[at + 3] * shifted
        blue += weights[at + 4] * value + weights[at + 5] * shifted
    return red, green, blue


@wp.kernel(enable_backward=False, module="unique")
def colour_pixels(
    layout: Layout,
    first: wp.int32,
    # Model:
    model: Colours,
    columns: wp.array(dtype=Any),
    lamps: wp.array(dtype=Any),
    gain: wp.array2d(dtype=Any),
    # Data in:
    along: wp.array2d(dtype=Any),
    across: wp.array(dtype=Any),
    dent: wp.array(dtype=Any),
    # Data out:
    change_out: wp.array2d(dtype=Any),
):
    """Mean change of colour of pixels' samples; of their mean where a block's are tilted alike."""
    image, i, k = wp.tid()
    row = first + i
    u = columns[k]
    p, q, w, bend = type(u)(), type(u)(), type(u)(), type(u)()
    begin = place_of(layout, image, row, k)
    at = begin
    for a in range(layout.samples):
        for c in range(layout.samples):
            p += along[1, at]
            q += across[at]
            w += dent[at]
            bend += bend_of(layout, along, across, at, a, c)
            at += layout.plane
    share = wp.float32(1.0) / wp.float32(layout.samples * layout.samples)
    p, q, w, bend = p * share, q * share, w * share, bend * share
    apart = wp.float32(0.0)
    at = begin
    for _s in range(layout.samples * layout.samples):
        p_off, q_off = along[1, at] - p, across[at] - q
        apart = wp.max(apart, wp.max(wp.max(wp.abs(p_off), wp.abs(q_off))))
        at += layout.plane
    red, green, blue = type(u)(), type(u)(), type(u)()
    if apart > _LEVEL_TILT:
        at = begin
        for a in range(layout.samples):
            for c in range(layout.samples):
                bend = bend_of(layout, along, across, at, a, c)
                one_red, one_green, one_blue = _colour(
                    model, lamps, layout, row, k, u, along[1, at], across[at], dent[at], bend
                )
                red += share * one_red
                green += share * one_green
                blue += share * one_blue
                at += layout.plane
    else:
        red, green, blue = _colour(model, lamps, layout, row, k, u, p, q, w, bend)
    to, of = (image * layout.rows + row) * layout.blocks + k, row * layout.blocks + k
    change_out[0, to] = wp.cw_mul(red, gain[0, of])
    change_out[1, to] = wp.cw_mul(green, gain[1, of])
    change_out[2, to] = wp.cw_mul(blue, gain[2, of])


@wp.kernel(enable_backward=False, module="unique")
def grey_pixels(
    layout: Layout,
    first: wp.int32,
    # Model:
    starts: wp.array(dtype=wp.float32),
    per_length: wp.array(dtype=wp.float32),
    rises: wp.array(dtype=wp.float32),
    level: wp.float32,
    # Data in:
    along: wp.array2d(dtype=Any),  # noqa: ARG001 - a model of light reads the tilts
    across: wp.array(dtype=Any),  # noqa: ARG001
    dent: wp.array(dtype=Any),
    # Data out:
    change_out: wp.array2d(dtype=Any),
):
    """Mean change of grey of pixels' samples: a table of indentation, as a sum of bounded ramps."""
    image, i, k = wp.tid()
    row = first + i
    at = place_of(layout, image, row, k)
    total = type(dent[at])()
    for _s in range(layout.samples * layout.samples):
        total += dent[at] - dent[at]  # what is not a number stays so, which a clamp would hide
        for m in range(starts.shape[0]):
            share = (dent[at] - type(total)(starts[m])) * per_length[m]
            for n in range(len(share)):
                share[n] = wp.clamp(share[n], wp.float32(0.0), wp.float32(1.0))
            total += rises[m] * share
        at += layout.plane
    total = total * (wp.float32(1.0) / wp.float32(layout.samples * layout.samples))
    to = (image * layout.rows + row) * layout.blocks + k
    for channel in range(3):
        change_out[channel, to] = total + type(total)(level)
