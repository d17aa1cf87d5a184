"""Warp kernels from images' samples to bytes, a block of pixels of a row in each thread.

On a processor a block is as wide as its registers: whole blocks are added and multiplied, so that
an instruction works on many pixels. On a GPU a block is one pixel. Kernels are generic in it,
and each is a module of its own: one that they share would be compiled anew for each of them, since
a kernel's first launch tells what blocks there are.

A plane has ``pitch`` blocks for each row of pixels, those of the image and one of room at each end,
and a row of room above and below. A sample (a, c) of a pixel lies in a plane of its own, the
``a * samples + c``-th of its image. Where an array has two indices, the first says by how many
pixels the block lies further right, less those of room.
"""

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
def continue_samples(layout: Layout, lanes: wp.int32, values: wp.array(dtype=wp.float32)):
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
    height: wp.array2d(dtype=Any),
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
