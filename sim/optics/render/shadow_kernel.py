"""Warp kernels of shadows: rays of a sweep from a lamp, and what each sample loses to them.

A sweep has its own order of values: step by step as ``whole`` has them, and in a step across the
rays, ``room`` blocks of zeros at each end. Where an array of blocks has two indices, the first says
by how many values a block lies further on, less a block's length.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from sim.optics.pixels.pixel_kernel import Layout, place_of

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
