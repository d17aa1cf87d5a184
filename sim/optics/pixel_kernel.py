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
# Warp's own flags keep the compiler from putting a whole block into an instruction.
BLOCK_FLAGS = (
    "-march=native -ffp-contract=fast -mllvm=-inline-threshold=9000"
    " -mllvm=-slp-recursion-max-depth=12"
)
wp.set_module_options({"cpu_compiler_flags": BLOCK_FLAGS})


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
def place_of(band: Band, row: int, block: int) -> int:
    """Return where a block of the first samples of a row of pixels lies."""
    return (row - band.first + ROOM_ROWS) * (band.blocks + 2) + 1 + block


@wp.func
def _above(band: Band, row: int, a: int, at: int) -> int:
    """Return where the samples above those at a place lie; the border's are themselves."""
    if a > 0:
        return at - band.samples * band.plane
    if row > 0:
        return at + (band.samples - 1) * band.samples * band.plane - (band.blocks + 2)
    return at


@wp.func
def _below(band: Band, row: int, a: int, at: int) -> int:
    """Return where the samples below lie."""
    if a < band.samples - 1:
        return at + band.samples * band.plane
    if row < band.rows - 1:
        return at - (band.samples - 1) * band.samples * band.plane + (band.blocks + 2)
    return at


@wp.func
def _per_distance(band: Band, row: int, a: int) -> wp.float32:
    """Return one over the distance between the samples above and below [1/m]."""
    if row == 0 and a == 0:
        return band.per_y
    if row == band.rows - 1 and a == band.samples - 1:
        return band.per_y
    return wp.float32(0.5) * band.per_y


@wp.func
def _across_row(band: Band, planes: wp.array2d(dtype=Block), at: int, b: int) -> Block:
    """Return the samples right of a block of the ``b``-th samples less those left of it."""
    wrap = (band.samples - 1) * band.plane
    first, last = b == 0, b == band.samples - 1
    left = planes[wp.where(first, 0, 1), wp.where(first, at + wrap, at - band.plane)]
    right = planes[wp.where(last, 2, 1), wp.where(last, at - wrap, at + band.plane)]
    return right - left


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
    plane = LANES * band.plane
    for a in range(band.samples):
        first = LANES * place_of(band, row, 0) + a * band.samples * plane
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
    row = start + i
    for a in range(band.samples):
        per_y = _per_distance(band, row, a)
        for b in range(band.samples):
            at = place_of(band, row, k) + (a * band.samples + b) * band.plane
            p = _across_row(band, height, at, b) * band.half_per_x
            q = (height[1, _below(band, row, a, at)] - height[1, _above(band, row, a, at)]) * per_y
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
    a: int,
    b: int,
    at: int,
) -> Block:
    """Divergence of the tilt by central differences, one-sided at the border."""
    p = _across_row(band, along, at, b) * band.half_per_x
    q = across[_below(band, row, a, at)] - across[_above(band, row, a, at)]
    return p + q * _per_distance(band, row, a)


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
            bend += _bend(band, along, across, row, a, b, at)
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
                bend_one = _bend(band, along, across, row, a, b, at)
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


@wp.func
def _reflected(place: int, count: int) -> int:
    """The border's pixel is the mirror."""
    return wp.where(place < 0, -place, wp.where(place >= count, 2 * count - 2 - place, place))


@wp.func
def _compressed(levels: Block, knee: wp.float32) -> Block:
    """Return light as the camera shows it, see ``response``."""
    shown = Block()
    room = wp.float32(255.0) - knee
    for n in range(LANES):
        shown[n] = levels[n]
        if levels[n] > knee:
            shown[n] = knee + room * (wp.float32(1.0) - wp.exp((knee - levels[n]) / room))
    return shown


@wp.kernel(enable_backward=False)
def expose_rows(
    blocks: wp.int32,
    columns: wp.int32,
    start: wp.int32,
    knee: wp.float32,
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
    """Weigh neighbours along columns and rows, add what does not change, compress and round."""
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
            if wp.max(levels) > knee and knee < wp.float32(255.0):
                levels = _compressed(levels, knee)
            for n in range(LANES):
                bounded = wp.clamp(levels[n] + wp.float32(0.5), wp.float32(0.0), wp.float32(255.0))
                exposed[n] = wp.uint8(bounded)
            image_out[channel, i * blocks + k] = exposed
