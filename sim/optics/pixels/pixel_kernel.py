"""Warp kernels from images' samples to bytes, a block of pixels of a row in each thread.

On a processor a block is as wide as its registers: whole blocks are added and multiplied, so that
an instruction works on many pixels. On a GPU a block is one pixel. Kernels are generic in it,
and each is a module of its own: one that they share would be compiled anew for each of them, since
a kernel's first launch tells what blocks there are.

A plane has ``pitch`` blocks for each row of pixels, those of the image and one of room at each end,
and a row of room above and below. A sample (a, c) of a pixel lies in a plane of its own, the
``a * samples + c``-th of its image. Where an array has two indices, the first says by how many
pixels the block lies further right, less those of room.

Shadows are found in sweeps from a lamp. A sweep has its own order of values: step by step as
``whole`` has them, and in a step across the rays, ``room`` blocks of zeros at each end. There the
first of two indices says by how many values a block lies further on, less a block's length.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from sim.device import start_warp

start_warp()


@wp.struct
class Layout:
    """Where the samples of images lie."""

    rows: wp.int32  # of pixels
    columns: wp.int32
    blocks: wp.int32  # of pixels in a row
    pitch: wp.int32  # blocks of a row with its room
    plane: wp.int32  # blocks
    samples: wp.int32  # of a pixel, both ways
    half_per_x: wp.float32  # over twice the spacing of samples [1/m]
    half_per_y: wp.float32


@wp.func
def place_of(layout: Layout, image: int, row: int, block: int) -> int:
    """Return where a block of an image's first samples lies."""
    first = image * layout.samples * layout.samples * layout.plane
    return first + (row + 1) * layout.pitch + 1 + block


@wp.func
def _sample_place(layout: Layout, lanes: int, image: int, row: int, column: int) -> int:
    """Return which value is the sample in a row and column of samples, those of room included."""
    samples = layout.samples
    i, j = (row + samples) / samples - 1, (column + samples) / samples - 1
    plane = (row - i * samples) * samples + column - j * samples
    return lanes * (place_of(layout, image, i, 0) + plane * layout.plane) + j


@wp.func
def _along_row(layout: Layout, planes: wp.array2d(dtype=Any), at: int, c: int):
    """Return the samples right of a block of samples in column ``c`` less those left of it."""
    wrap = (layout.samples - 1) * layout.plane
    first, last = c == 0, c == layout.samples - 1
    left = planes[wp.where(first, 0, 1), wp.where(first, at + wrap, at - layout.plane)]
    right = planes[wp.where(last, 2, 1), wp.where(last, at - wrap, at + layout.plane)]
    return right - left


@wp.func
def _down_column(layout: Layout, planes: wp.array(dtype=Any), at: int, a: int):
    """Return the samples below a block of samples in row ``a`` less those above."""
    step = layout.samples * layout.plane
    wrap = (layout.samples - 1) * step - layout.pitch
    above = wp.where(a == 0, at + wrap, at - step)
    below = wp.where(a == layout.samples - 1, at - wrap, at + step)
    return planes[below] - planes[above]


@wp.kernel(enable_backward=False, module="unique")
def lay_out_samples(
    layout: Layout,
    first: wp.int32,
    rest: wp.array(dtype=Any),
    # Data in:
    dent: wp.array3d(dtype=wp.float32),
    # Data out:
    dent_out: wp.array(dtype=Any),
    height_out: wp.array(dtype=Any),
):
    """Put the indentations of samples into planes, and the heights that they leave [m]."""
    image, i, k = wp.tid()
    row = first + i
    for a in range(layout.samples):
        for c in range(layout.samples):
            plane = (a * layout.samples + c) * layout.plane
            height = rest[place_of(layout, 0, row, k) + plane]
            values = type(height)()
            for n in range(len(height)):
                column = wp.min(k * len(height) + n, layout.columns - 1)
                values[n] = dent[image, row * layout.samples + a, column * layout.samples + c]
            at = place_of(layout, image, row, k) + plane
            dent_out[at] = values
            height_out[at] = height - values


@wp.kernel(enable_backward=False, module="unique")
def continue_samples(
    layout: Layout,
    lanes: wp.int32,
    # Data in and out:
    values: wp.array(dtype=wp.float32),
):
    """Go on linearly by a sample beyond all borders: differences are one-sided there."""
    image, n = wp.tid()
    rows, columns = layout.rows * layout.samples, layout.columns * layout.samples
    for end in range(2):
        row, column = n, wp.where(end == 0, 0, columns - 1)
        row_step, column_step = 0, 2 * end - 1
        if n >= rows:
            row, column = wp.where(end == 0, 0, rows - 1), n - rows
            row_step, column_step = 2 * end - 1, 0
        last = _sample_place(layout, lanes, image, row, column)
        before = _sample_place(layout, lanes, image, row - row_step, column - column_step)
        beyond = _sample_place(layout, lanes, image, row + row_step, column + column_step)
        values[beyond] = wp.float32(2.0) * values[last] - values[before]


@wp.kernel(enable_backward=False, module="unique")
def tilt_samples(
    layout: Layout,
    first: wp.int32,
    # Data in:
    height: wp.array2d(dtype=Any),
    # Data out:
    along_out: wp.array(dtype=Any),
    across_out: wp.array(dtype=Any),
):
    """Tilt along rows and along columns by central differences."""
    image, i, k = wp.tid()
    at = place_of(layout, image, first + i, k)
    for a in range(layout.samples):
        for c in range(layout.samples):
            p = _along_row(layout, height, at, c) * layout.half_per_x
            q = _down_column(layout, height[1], at, a) * layout.half_per_y
            scale = wp.cw_mul(p, p) + wp.cw_mul(q, q)
            for n in range(len(scale)):
                scale[n] = wp.float32(1.0) / wp.sqrt(wp.float32(1.0) + scale[n])
            along_out[at] = wp.cw_mul(p, scale)
            across_out[at] = wp.cw_mul(q, scale)
            at += layout.plane


@wp.func
def bend_of(
    layout: Layout,
    along: wp.array2d(dtype=Any),
    across: wp.array(dtype=Any),
    at: int,
    a: int,
    c: int,
):
    """Return the divergence of the tilt by central differences [1/m]."""
    p = _along_row(layout, along, at, c) * layout.half_per_x
    return p + _down_column(layout, across, at, a) * layout.half_per_y


# Below everything that a ray may meet [m].
_NOTHING_M = wp.constant(wp.float32(-1.0))


@wp.struct
class Rays:
    """How a lamp's rays go over images, see ``shadows.rays_towards``."""

    along_columns: wp.int32
    forward: wp.int32
    across: wp.int32  # values across
    pitch: wp.int32  # blocks of a step's values with their room
    room: wp.int32  # blocks
    ray_pitch: wp.int32  # blocks of a step's rays
    whole: wp.array(dtype=wp.int32)
    part: wp.array(dtype=wp.float32)
    sunk: wp.array(dtype=wp.float32)  # [m]
    per_softness: wp.float32  # [1/m]


@wp.kernel(enable_backward=False, module="unique")
def turn_dents(
    rays: Rays,
    first: wp.int32,
    # Data in:
    dent: wp.array3d(dtype=wp.float32),
    # Data out:
    turned_out: wp.array(dtype=Any),
):
    """Bring indentations into the order of a sweep."""
    image, k, m = wp.tid()
    k += first
    steps = rays.whole.shape[0]
    at = wp.where(rays.forward == 1, k, steps - 1 - k)
    to = (image * steps + k) * rays.pitch + rays.room + m
    values = type(turned_out[to])()
    for n in range(len(values)):
        side = m * len(values) + n
        if side < rays.across:
            if rays.along_columns == 1:
                values[n] = dent[image, side, at]
            else:
                values[n] = dent[image, at, side]
    turned_out[to] = values


@wp.kernel(enable_backward=False, module="unique")
def follow_rays(
    rays: Rays,
    first: wp.int32,
    # Data in:
    turned: wp.array2d(dtype=Any),
    # Data out:
    highest_out: wp.array(dtype=Any),
):
    """Follow rays from the lamp on; each step keeps the highest that was passed before it [m].

    Heights between samples are interpolated linearly across the rays; beside the image they are 0.
    """
    image, m = wp.tid()
    m += first
    steps = rays.whole.shape[0]
    highest = type(highest_out[m])(_NOTHING_M)
    lanes = len(highest)
    for back in range(steps):
        k = steps - 1 - back
        highest_out[(image * steps + k) * rays.ray_pitch + m] = highest
        value = (rays.room + m) * lanes + rays.whole[k]
        at, shift = (image * steps + k) * rays.pitch + value / lanes, lanes + value % lanes
        lower, upper = turned[shift, at], turned[shift + 1, at]
        passed = (wp.float32(1.0) - rays.part[k]) * lower + rays.part[k] * upper
        highest = wp.max(highest, passed - type(highest)(rays.sunk[k]))


@wp.kernel(enable_backward=False, module="unique")
def hide_samples(
    rays: Rays,
    first: wp.int32,
    # Data in:
    highest: wp.array2d(dtype=Any),
    # Data in and out:
    turned: wp.array(dtype=Any),
):
    """Put how much of the lamp each sample does not see, 0 to 1, in its indentation's place."""
    image, k, m = wp.tid()
    k += first
    step = image * rays.whole.shape[0] + k
    dent = turned[step * rays.pitch + rays.room + m]
    lanes = len(dent)
    # A sample at y lies between the rays y - whole - 1 and y - whole.
    ray = m * lanes - rays.whole[k] - 1
    at, shift = step * rays.ray_pitch + ray / lanes, lanes + ray % lanes
    seen = rays.part[k] * highest[shift, at]
    seen += (wp.float32(1.0) - rays.part[k]) * highest[shift + 1, at]
    hidden = (seen - dent + type(dent)(rays.sunk[k])) * rays.per_softness
    for n in range(len(hidden)):
        hidden[n] = wp.clamp(hidden[n], wp.float32(0.0), wp.float32(1.0))
    turned[step * rays.pitch + rays.room + m] = hidden


@wp.kernel(enable_backward=False, module="unique")
def darken_pixels(
    layout: Layout,
    first: wp.int32,
    # Model:
    rays: Rays,
    towards: wp.vec3f,
    colour: wp.vec3f,
    # Data in:
    hidden: wp.array(dtype=wp.float32),
    along: wp.array(dtype=Any),
    across: wp.array(dtype=Any),
    # Data in and out:
    change: wp.array2d(dtype=Any),
):
    """Take away what is hidden of a lamp, in the mean of each pixel's samples."""
    image, i, k = wp.tid()
    row = first + i
    at = place_of(layout, image, row, k)
    lost = type(along[at])()
    lanes = len(lost)
    steps, pitch = rays.whole.shape[0], rays.pitch * lanes
    # The place of a sample in the sweep is linear in its row and column.
    turn = wp.where(rays.forward == 1, 1, -1)
    per_row, per_column = turn * pitch, 1
    if rays.along_columns == 1:
        per_row, per_column = 1, turn * pitch
    origin = (image * steps + wp.where(rays.forward == 1, 0, steps - 1)) * pitch
    origin += rays.room * lanes
    for a in range(layout.samples):
        for c in range(layout.samples):
            p, q = along[at], across[at]
            place = origin + (row * layout.samples + a) * per_row + c * per_column
            for n in range(len(lost)):
                column = wp.min(k * lanes + n, layout.columns - 1) * layout.samples
                share = hidden[place + column * per_column]
                if share > wp.float32(0.0):  # few are
                    level = wp.float32(1.0) - p[n] * p[n] - q[n] * q[n]
                    up = wp.sqrt(wp.max(level, wp.float32(0.0)))
                    facing = wp.dot(towards, wp.vec3f(p[n], q[n], up))
                    lost[n] = lost[n] + share * wp.max(facing, wp.float32(0.0))
            at += layout.plane
    lost = lost * (wp.float32(1.0) / wp.float32(layout.samples * layout.samples))
    to = (image * layout.rows + row) * layout.blocks + k
    for channel in range(3):
        change[channel, to] = change[channel, to] - colour[channel] * lost


@wp.func
def _reflected(place: int, count: int) -> int:
    """The border's pixel is the mirror."""
    return wp.where(place < 0, -place, wp.where(place >= count, 2 * count - 2 - place, place))


@wp.kernel(enable_backward=False, module="unique")
def blur_columns(
    layout: Layout,
    first: wp.int32,
    weights: wp.array(dtype=wp.float32),
    room: wp.int32,
    # Data in:
    change: wp.array2d(dtype=Any),
    # Data out:
    blurred_out: wp.array2d(dtype=Any),
):
    """Weigh neighbours along columns; rows that are written have ``room`` blocks at each end."""
    image, i, k = wp.tid()
    row = first + i
    reach = weights.shape[0] / 2
    to = (image * layout.rows + row) * (layout.blocks + 2 * room) + room + k
    for channel in range(3):
        total = type(change[channel, k])()
        for d in range(weights.shape[0]):
            beside = image * layout.rows + _reflected(row + d - reach, layout.rows)
            total += weights[d] * change[channel, beside * layout.blocks + k]
        blurred_out[channel, to] = total


@wp.kernel(enable_backward=False, module="unique")
def mirror_ends(
    layout: Layout,
    first: wp.int32,
    reach: wp.int32,
    room: wp.int32,
    # Data in and out:
    blurred: wp.array3d(dtype=wp.float32),
):
    """Continue rows beyond the border's pixels, which are the mirrors; ``room`` is in pixels."""
    image, i, channel = wp.tid()
    row = image * layout.rows + first + i
    end = room + layout.columns - 1
    for d in range(1, reach + 1):
        blurred[channel, row, room - d] = blurred[channel, row, room + d]
        blurred[channel, row, end + d] = blurred[channel, row, end - d]


@wp.func
def _compressed(levels: Any, knee: wp.float32):
    """Return light as the camera shows it, see ``Response``."""
    shown = type(levels)()
    room = wp.float32(255.0) - knee
    for n in range(len(levels)):
        shown[n] = levels[n]
        if levels[n] > knee:
            shown[n] = knee + room * (wp.float32(1.0) - wp.exp((knee - levels[n]) / room))
    return shown


@wp.kernel(enable_backward=False, module="unique")
def expose_pixels(
    layout: Layout,
    first: wp.int32,
    weights: wp.array(dtype=wp.float32),
    room: wp.int32,
    knee: wp.float32,
    base: wp.array2d(dtype=Any),
    # Data in:
    blurred: wp.array3d(dtype=Any),
    # Data out:
    image_out: wp.array4d(dtype=wp.uint8),
):
    """Weigh neighbours along rows, add what does not change, compress and round.

    The first index of ``blurred`` says by how many pixels a block lies further right, less those
    that the weights reach.
    """
    image, i, k = wp.tid()
    row = first + i
    at = (image * layout.rows + row) * (layout.blocks + 2 * room) + room + k
    for channel in range(3):
        levels = base[channel, row * layout.blocks + k]
        for d in range(weights.shape[0]):
            levels += weights[d] * blurred[d, channel, at]
        if wp.max(levels) > knee and knee < wp.float32(255.0):
            levels = _compressed(levels, knee)
        for n in range(len(levels)):
            column = k * len(levels) + n
            if column < layout.columns:
                bounded = wp.clamp(levels[n] + wp.float32(0.5), wp.float32(0.0), wp.float32(255.0))
                image_out[image, row, column, channel] = wp.uint8(bounded)
