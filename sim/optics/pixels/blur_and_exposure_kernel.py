"""Warp kernels from images' samples to bytes, block by block of a row's pixels.

On a processor a block is as wide as its registers: whole blocks are added and multiplied, so that
an instruction works on many pixels, and a thread makes a row. On a GPU a block is one pixel, and
has a thread. Code for a block is in ``block_kernels.cu``. Kernels are generic in its type,
and each is a module of its own: one that they share would be compiled anew for each of them, since
a kernel's first launch tells what blocks there are.

A plane has ``pitch`` blocks for each row of pixels, those of the image and one of room at each end,
and a row of room above and below. A sample (a, c) of a pixel lies in a plane of its own, the
``a * samples + c``-th of its image.
"""

from typing import Any

import warp as wp

from sim.device import native_code, start_warp

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
    span: wp.int32  # blocks of a row that a thread makes
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


@wp.func_native(native_code(__package__, "lay_out"))
def _lay_out(
    like: Any,
    layout: Layout,
    image: int,
    row: int,
    part: int,
    first_place: int,
    rest: wp.array(dtype=Any),
    dent: wp.array3d(dtype=wp.float32),
    dent_out: wp.array(dtype=Any),
    height_out: wp.array(dtype=Any),
): ...


@wp.kernel(enable_backward=False, module="unique")
def lay_out_samples(
    layout: Layout,
    rest: wp.array(dtype=Any),
    # Data in:
    dent: wp.array3d(dtype=wp.float32),
    # Data out:
    dent_out: wp.array(dtype=Any),
    height_out: wp.array(dtype=Any),
):
    """Put the indentations of samples into planes, and the heights that they leave [m]."""
    image, row, part = wp.tid()
    like, place = type(rest[0])(), place_of(layout, image, row, 0)
    _lay_out(like, layout, image, row, part, place, rest, dent, dent_out, height_out)


@wp.kernel(enable_backward=False, module="unique")
def continue_samples(
    layout: Layout,
    lanes: wp.int32,
    along_rows: wp.array(dtype=wp.float32),
    along_columns: wp.array(dtype=wp.float32),
):
    """Go on linearly by a sample beyond borders: differences are one-sided there."""
    image, n = wp.tid()
    rows, columns = layout.rows * layout.samples, layout.columns * layout.samples
    for end in range(2):
        if n < rows:
            column, way = wp.where(end == 0, 0, columns - 1), 2 * end - 1
            last = along_rows[_sample_place(layout, lanes, image, n, column)]
            before = along_rows[_sample_place(layout, lanes, image, n, column - way)]
            beyond = _sample_place(layout, lanes, image, n, column + way)
            along_rows[beyond] = wp.float32(2.0) * last - before
        else:
            row, way = wp.where(end == 0, 0, rows - 1), 2 * end - 1
            last = along_columns[_sample_place(layout, lanes, image, row, n - rows)]
            before = along_columns[_sample_place(layout, lanes, image, row - way, n - rows)]
            beyond = _sample_place(layout, lanes, image, row + way, n - rows)
            along_columns[beyond] = wp.float32(2.0) * last - before


@wp.func_native(native_code(__package__, "tilt"))
def _tilt(
    like: Any,
    layout: Layout,
    row: int,
    part: int,
    first_place: int,
    height: wp.array(dtype=Any),
    along_out: wp.array(dtype=Any),
    across_out: wp.array(dtype=Any),
): ...


@wp.kernel(enable_backward=False, module="unique")
def tilt_samples(
    layout: Layout,
    height: wp.array(dtype=Any),
    along_out: wp.array(dtype=Any),
    across_out: wp.array(dtype=Any),
):
    """Tilt along rows and along columns by central differences."""
    image, row, part = wp.tid()
    like, place = type(height[0])(), place_of(layout, image, row, 0)
    _tilt(like, layout, row, part, place, height, along_out, across_out)


@wp.func_native(native_code(__package__, "blur"))
def _blur(
    like: Any,
    layout: Layout,
    image: int,
    row: int,
    part: int,
    first_place: int,
    weights: wp.array(dtype=wp.float32),
    room: int,
    change: wp.array2d(dtype=Any),
    blurred_out: wp.array2d(dtype=Any),
): ...


@wp.kernel(enable_backward=False, module="unique")
def blur_columns(
    layout: Layout,
    weights: wp.array(dtype=wp.float32),
    room: wp.int32,
    # Data in:
    change: wp.array2d(dtype=Any),
    # Data out:
    blurred_out: wp.array2d(dtype=Any),
):
    """Weigh neighbours along columns; rows that are written have ``room`` blocks at each end."""
    image, row, part = wp.tid()
    like = type(change[0, 0])()
    _blur(like, layout, image, row, part, 0, weights, room, change, blurred_out)


@wp.kernel(enable_backward=False, module="unique")
def mirror_ends(
    layout: Layout,
    reach: wp.int32,
    room: wp.int32,
    # Data in and out:
    blurred: wp.array3d(dtype=wp.float32),
):
    """Continue rows beyond the border's pixels, which are the mirrors; ``room`` is in pixels."""
    image, i, channel = wp.tid()
    row = image * layout.rows + i
    end = room + layout.columns - 1
    for d in range(1, reach + 1):
        blurred[channel, row, room - d] = blurred[channel, row, room + d]
        blurred[channel, row, end + d] = blurred[channel, row, end - d]


@wp.func_native(native_code(__package__, "expose"))
def _expose(
    like: Any,
    layout: Layout,
    image: int,
    row: int,
    part: int,
    first_place: int,
    weights: wp.array(dtype=wp.float32),
    room: int,
    knee: wp.float32,
    base: wp.array2d(dtype=Any),
    blurred: wp.array2d(dtype=Any),
    image_out: wp.array4d(dtype=wp.uint8),
): ...


@wp.kernel(enable_backward=False, module="unique")
def expose_pixels(
    layout: Layout,
    weights: wp.array(dtype=wp.float32),
    room: wp.int32,
    knee: wp.float32,
    base: wp.array2d(dtype=Any),
    # Data in:
    blurred: wp.array2d(dtype=Any),
    # Data out:
    image_out: wp.array4d(dtype=wp.uint8),
):
    """Weigh neighbours along rows, add what does not change, compress (``Response``) and round."""
    image, row, part = wp.tid()
    like = type(base[0, 0])()
    _expose(like, layout, image, row, part, 0, weights, room, knee, base, blurred, image_out)
