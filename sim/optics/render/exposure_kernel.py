"""Warp kernels from changes of light to the bytes of images: blur, no-contact frame, rounding."""

from __future__ import annotations

from typing import Any

import warp as wp

from sim.optics.pixels.pixel_kernel import Layout


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
    """Return light as the camera shows it, see ``response``."""
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
