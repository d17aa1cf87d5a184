"""Warp kernels that render one image on a processor, a block of pixels of a row at a time.

Whole blocks are added and multiplied, so that an instruction of the processor works on many pixels.
A plane has ``pitch`` blocks for each row of pixels: those of the image and one of room at each end.
A sample (a, b) of a pixel lies in a plane of its own, the ``a * samples + b``-th. Where an array
has two indices, the first says by how many pixels the block lies further right, less those of room.
"""

# Device code: Warp compiles it, and Python type checkers do not speak its dialect.
# mypy: ignore-errors

from __future__ import annotations

import warp as wp

from sim.optics.polynomial import INDENTATION_UNIT_M
from sim.optics.shading_terms import CREASE_UNIT_M
from sim.warp_start import start_warp

start_warp()

LANES = 16
ROOM_ROWS = 2
Block = wp.types.vector(length=LANES, dtype=wp.float32)
ByteBlock = wp.types.vector(length=LANES, dtype=wp.uint8)
# With Warp's own flags the compiler does not put a whole block into an instruction.
wp.set_module_options({"cpu_compiler_flags": "-march=native"})


@wp.struct
class Band:
    """A band of rows of pixels, and where its samples lie."""

    rows: wp.int32  # of the image
    blocks: wp.int32  # of pixels in a row
    plane: wp.int32  # blocks of it
    samples: wp.int32
    first: wp.int32  # row of the image
    half_per_x: wp.float32  # over twice the spacing of samples [1/m]
    per_y: wp.float32  # over the spacing [1/m]


@wp.func
def _place(band: Band, fine: int, block: int) -> int:
    """Return where a block of a row of samples lies."""
    row = fine / band.samples
    part = fine - row * band.samples
    local = row - band.first + ROOM_ROWS
    return part * band.samples * band.plane + local * (band.blocks + 2) + 1 + block


@wp.func
def _besides(band: Band, planes: wp.array2d(dtype=Block), at: int, b: int, side: int) -> Block:
    """Return the samples left (-1) or right (1) of a block of the ``b``-th samples."""
    aside = b + side
    if aside < 0:
        return planes[0, at + (band.samples - 1) * band.plane]
    if aside == band.samples:
        return planes[2, at - (band.samples - 1) * band.plane]
    return planes[1, at + side * band.plane]


@wp.kernel(enable_backward=False)
def continue_rows(
    band: Band,
    columns: wp.int32,
    start: wp.int32,
    # Data in and out:
    planes: wp.array(dtype=wp.float32),
):
    """Go on linearly by a sample at both ends of rows: differences are one-sided there."""
    row = start + wp.tid()
    for a in range(band.samples):
        first = LANES * _place(band, row * band.samples + a, 0)
        plane = LANES * band.plane
        end = first + (band.samples - 1) * plane + columns - 1
        after, before = first + 1, end - 1
        if band.samples > 1:
            after, before = first + plane, end - plane
        planes[first - 1 + (band.samples - 1) * plane] = (
            wp.float32(2.0) * planes[first] - planes[after]
        )
        planes[first + columns] = wp.float32(2.0) * planes[end] - planes[before]


@wp.kernel(enable_backward=False)
def tilt_samples(
    band: Band,
    start: wp.int32,
    rest: wp.array(dtype=Block),
    # Data in:
    height: wp.array2d(dtype=Block),
    # Data out:
    along_out: wp.array(dtype=Block),
    across_out: wp.array(dtype=Block),
    dent_out: wp.array(dtype=Block),
):
    """Tilt by central differences, one-sided at the border, and indentation, from a row on."""
    t = wp.tid()
    i = t / band.blocks
    k = t - i * band.blocks
    for a in range(band.samples):
        fine = (start + i) * band.samples + a
        above, below = wp.max(fine - 1, 0), wp.min(fine + 1, band.rows * band.samples - 1)
        per_y = band.per_y / wp.float32(below - above)
        here = _place(band, fine, k)
        up, down = _place(band, above, k), _place(band, below, k)
        for b in range(band.samples):
            aside = b * band.plane
            at = here + aside
            p = _besides(band, height, at, b, 1) - _besides(band, height, at, b, -1)
            p = p * band.half_per_x
            q = (height[1, down + aside] - height[1, up + aside]) * per_y
            scale = wp.cw_mul(p, p) + wp.cw_mul(q, q)
            for n in range(LANES):
                scale[n] = wp.float32(1.0) / wp.sqrt(wp.float32(1.0) + scale[n])
            along_out[at] = wp.cw_mul(p, scale)
            across_out[at] = wp.cw_mul(q, scale)
            dent_out[at] = rest[at] - height[1, at]


@wp.func
def _bend(
    band: Band,
    along: wp.array2d(dtype=Block),
    across: wp.array(dtype=Block),
    row: int,
    block: int,
    s: int,
) -> Block:
    """Divergence of the tilt by central differences, one-sided at the border."""
    a = s / band.samples
    b = s - a * band.samples
    fine = row * band.samples + a
    above, below = wp.max(fine - 1, 0), wp.min(fine + 1, band.rows * band.samples - 1)
    at = _place(band, fine, block) + b * band.plane
    up = _place(band, above, block) + b * band.plane
    down = _place(band, below, block) + b * band.plane
    right, left = _besides(band, along, at, b, 1), _besides(band, along, at, b, -1)
    per_y = band.per_y / wp.float32(below - above)
    return (right - left) * band.half_per_x + (across[down] - across[up]) * per_y


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
    count = band.samples * band.samples
    at = _place(band, row * band.samples, k)
    p, q, w, bend = Block(), Block(), Block(), Block()
    for s in range(count):
        p += along[1, at + s * band.plane]
        q += across[at + s * band.plane]
        w += dent[at + s * band.plane]
        bend += _bend(band, along, across, row, k, s)
    share = wp.float32(1.0) / wp.float32(count)
    p, q, w, bend = p * share, q * share, w * share, bend * share
    apart = Block()
    for s in range(count):
        p_off, q_off = along[1, at + s * band.plane] - p, across[at + s * band.plane] - q
        for n in range(LANES):
            further = wp.max(wp.abs(p_off[n]), wp.abs(q_off[n]))
            apart[n] = wp.max(apart[n], further)
    total = Rgb()
    if wp.max(apart) > level_tilt:
        for s in range(count):
            sample = at + s * band.plane
            one = _colour(
                model,
                band,
                row,
                k,
                _chosen(apart, level_tilt, along[1, sample], p),
                _chosen(apart, level_tilt, across[sample], q),
                _chosen(apart, level_tilt, dent[sample], w),
                _chosen(apart, level_tilt, _bend(band, along, across, row, k, s), bend),
            )
            total.red += share * one.red
            total.green += share * one.green
            total.blue += share * one.blue
    else:
        total = _colour(model, band, row, k, p, q, w, bend)
    to = row * (band.blocks + 2) + 1 + k
    change_out[0, to] = total.red
    change_out[1, to] = total.green
    change_out[2, to] = total.blue


@wp.func
def _reflected(place: int, count: int) -> int:
    """The border's pixel is the mirror."""
    return wp.where(place < 0, -place, wp.where(place >= count, 2 * count - 2 - place, place))


@wp.kernel(enable_backward=False)
def expose_rows(
    blocks: wp.int32,
    columns: wp.int32,
    start: wp.int32,
    weights: wp.array(dtype=wp.float32),
    base: wp.array2d(dtype=Block),
    # Data in:
    change: wp.array2d(dtype=Block),
    # Scratch:
    row_single: wp.array(dtype=wp.float32),
    row_blocks: wp.array(dtype=Block),
    row_shifted: wp.array2d(dtype=Block),
    # Data out:
    image_out: wp.array2d(dtype=ByteBlock),
):
    """Weigh neighbours along columns and rows, add what does not change, and round."""
    i = wp.tid() + start
    reach = weights.shape[0] / 2
    rows = change.shape[1] / (blocks + 2)
    for channel in range(3):
        for k in range(blocks):
            total = Block()
            for d in range(weights.shape[0]):
                row = _reflected(i + d - reach, rows)
                total += weights[d] * change[channel, row * (blocks + 2) + 1 + k]
            row_blocks[1 + k] = total
        for d in range(1, reach + 1):
            row_single[LANES - d] = row_single[LANES + d]
            row_single[LANES + columns - 1 + d] = row_single[LANES + columns - 1 - d]
        for k in range(blocks):
            levels = base[channel, i * blocks + k]
            for d in range(weights.shape[0]):
                levels += weights[d] * row_shifted[d, 1 + k]
            exposed = ByteBlock()
            for n in range(LANES):
                bounded = wp.clamp(levels[n] + wp.float32(0.5), wp.float32(0.0), wp.float32(255.0))
                exposed[n] = wp.uint8(bounded)
            image_out[channel, i * blocks + k] = exposed
