"""Warp kernel of a photometric model over one image, a block of pixels of a row at a time."""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors

from __future__ import annotations

import warp as wp

from sim.optics.render.photometric.polynomial import INDENTATION_UNIT_M
from sim.optics.render.photometric.shading_terms import CREASE_UNIT_M
from sim.optics.render.pixel_kernel import BLOCK_FLAGS, LANES, Band, Block, bend_of, place_of

wp.set_module_options({"cpu_compiler_flags": BLOCK_FLAGS})


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
    along: wp.array(dtype=Block)  # places in a row
    lamp_count: wp.int32
    bend: wp.float32  # softness squared
    crease_limit: wp.float32
    lamps: wp.array(dtype=Block)  # directions and light on level gel: planes without room
    lamp_weights: wp.array(dtype=wp.float32)  # level and slope along a row, of each colour


@wp.struct
class Rgb:
    """Change of colour of a block of pixels [grey levels]."""

    red: Block
    green: Block
    blue: Block


@wp.func
def _polynomial(model: Colours, row: int, u: Block, p: Block, q: Block, w: Block) -> Rgb:
    """Sum monomials from one to the next, and powers of the place along the row by Horner."""
    total = Rgb()
    at = row * model.weight_count
    for c in range(model.along_powers):
        red, green, blue = Block(), Block(), Block()
        power = Block(wp.float32(1.0))
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
        total.red = wp.cw_mul(total.red, u) + red
        total.green = wp.cw_mul(total.green, u) + green
        total.blue = wp.cw_mul(total.blue, u) + blue
    return total


@wp.func
def _bounded(size: Block, limit: wp.float32) -> Block:
    """Return by what tilts are multiplied that are no steeper than a limit then."""
    bound = Block()
    for n in range(LANES):
        bound[n] = limit / wp.max(wp.sqrt(size[n]), limit)
    return bound


@wp.func
def _lit(model: Colours, at: int, plane: int, p: Block, q: Block, upright: Block) -> Block:
    """Return the light of a near lamp less that on level gel, see ``shading_terms``."""
    cosine = wp.cw_mul(p, model.lamps[at]) + wp.cw_mul(q, model.lamps[at + plane])
    cosine += wp.cw_mul(upright, model.lamps[at + 2 * plane])
    root = wp.cw_mul(cosine, cosine)
    for n in range(LANES):
        root[n] = wp.sqrt(root[n] + model.bend)
    return (cosine + root) * wp.float32(0.5) - model.lamps[at + 3 * plane]


@wp.func
def _colour(
    model: Colours, band: Band, row: int, k: int, p: Block, q: Block, dent: Block, bend: Block
) -> Rgb:
    u = model.along[k]
    size = wp.cw_mul(p, p) + wp.cw_mul(q, q)
    upright, depth, crease = Block(), Block(), Block()
    for n in range(LANES):
        upright[n] = wp.sqrt(wp.max(wp.float32(1.0) - size[n], wp.float32(0.0)))
        depth[n] = wp.min(dent[n], model.depth_limit)
        crease[n] = wp.clamp(bend[n], -model.crease_limit, model.crease_limit)
    bound = _bounded(size, model.tilt_limit)
    depth = depth * wp.float32(1.0 / INDENTATION_UNIT_M)
    total = _polynomial(model, row, u, wp.cw_mul(p, bound), wp.cw_mul(q, bound), depth)
    plane = band.rows * band.blocks
    for m in range(model.lamp_count + 1):
        value = crease * wp.float32(CREASE_UNIT_M)
        if m < model.lamp_count:
            value = _lit(model, 4 * m * plane + row * band.blocks + k, plane, p, q, upright)
        shifted = wp.cw_mul(value, u)
        at = 6 * (row * (model.lamp_count + 1) + m)
        weights = model.lamp_weights
        total.red += weights[at] * value + weights[at + 1] * shifted
        total.green += weights[at + 2] * value + weights[at + 3] * shifted
        total.blue += weights[at + 4] * value + weights[at + 5] * shifted
    return total


@wp.func
def _chosen(apart: Block, level: wp.float32, sample: Block, middle: Block) -> Block:
    """Return the sample's values where samples are apart, and their mean elsewhere."""
    chosen = Block()
    for n in range(LANES):
        chosen[n] = wp.where(apart[n] > level, sample[n], middle[n])
    return chosen


@wp.kernel(enable_backward=False)
def colour_blocks(
    model: Colours,
    band: Band,
    level_tilt: wp.float32,
    # Data in:
    along: wp.array2d(dtype=Block),
    across: wp.array(dtype=Block),
    dent: wp.array(dtype=Block),
    # Data out:
    change_out: wp.array2d(dtype=Block),
):
    """Mean change of colour of pixels' samples; of their mean where they are tilted alike."""
    t = wp.tid()
    i = t / band.blocks
    k = t - i * band.blocks
    row = band.first + i
    p, q, w, bend = Block(), Block(), Block(), Block()
    at = place_of(band, row, k)
    for a in range(band.samples):
        for b in range(band.samples):
            p += along[1, at]
            q += across[at]
            w += dent[at]
            bend += bend_of(band, along, across, row, a, b, at)
            at += band.plane
    share = wp.float32(1.0) / wp.float32(band.samples * band.samples)
    p, q, w, bend = p * share, q * share, w * share, bend * share
    apart = Block()
    if band.samples > 1:
        at = place_of(band, row, k)
        for _s in range(band.samples * band.samples):
            p_off, q_off = along[1, at] - p, across[at] - q
            apart = wp.max(apart, wp.max(wp.abs(p_off), wp.abs(q_off)))
            at += band.plane
    total = Rgb()
    if band.samples > 1 and wp.max(apart) > level_tilt:
        at = place_of(band, row, k)
        for a in range(band.samples):
            for b in range(band.samples):
                p_one = _chosen(apart, level_tilt, along[1, at], p)
                q_one = _chosen(apart, level_tilt, across[at], q)
                w_one = _chosen(apart, level_tilt, dent[at], w)
                bend_one = bend_of(band, along, across, row, a, b, at)
                bend_one = _chosen(apart, level_tilt, bend_one, bend)
                one = _colour(model, band, row, k, p_one, q_one, w_one, bend_one)
                total.red += share * one.red
                total.green += share * one.green
                total.blue += share * one.blue
                at += band.plane
    else:
        total = _colour(model, band, row, k, p, q, w, bend)
    to = row * (band.blocks + 2) + 1 + k
    change_out[0, to] = total.red
    change_out[1, to] = total.green
    change_out[2, to] = total.blue
