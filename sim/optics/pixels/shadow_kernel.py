"""Warp kernels of shadows: which rays of a lamp the gel cuts off, and what light is lost by it.

Shadows are found in sweeps from a lamp, along rays that part from it: step by step, and in a step
ray by ray. Samples lie in blocks as ``blur_and_exposure_kernel`` says.
"""

from typing import Any

import warp as wp

from sim.device import start_warp
from sim.optics.pixels.blur_and_exposure_kernel import Layout, place_of

start_warp()

_NOTHING = wp.constant(wp.float32(-1.0e3))  # below all that a ray may meet, over its distance


@wp.struct
class Rays:
    """How a lamp's rays go over images, see ``shadows.rays_from``.

    The first step is the one nearest to the lamp. At a step k the ray m goes through the place
    ``starts[k] + m spacings[k]`` across.
    """

    along_columns: wp.int32
    forward: wp.int32  # steps go towards higher columns or rows
    across: wp.int32  # values across
    # By how many values of an image the next step and the next value across lie further on
    step_stride: wp.int32
    side_stride: wp.int32
    pitch: wp.int32  # blocks of a step's rays
    starts: wp.array(dtype=wp.float32)
    spacings: wp.array(dtype=wp.float32)
    per_spacing: wp.array(dtype=wp.float32)
    # Distance of a step from the lamp's [m], its inverse [1/m], and the fall of the ray that goes
    # from the lamp through the first step's gel, over its distance [1]
    distances: wp.array(dtype=wp.float32)
    inverses: wp.array(dtype=wp.float32)
    falls: wp.array(dtype=wp.float32)
    # Slope of the first ray across the steps, and by how much that of each next one is larger
    slope: wp.float32
    slopes_apart: wp.float32
    softness: wp.float32  # [m]
    spread: wp.float32
    # Of the lamp: column and row among the samples, distances of these, and its height [m]
    column: wp.float32
    row: wp.float32
    per_column: wp.float32
    per_row: wp.float32
    height: wp.float32


@wp.kernel(enable_backward=False, module="unique")
def turn_dents(
    rays: Rays, first: wp.int32, dent: wp.array(dtype=wp.float32), turned_out: wp.array(dtype=Any)
):
    """Interpolate indentations where rays cross columns or rows.

    Beside the image there is none, or else the border's bulge: no gel stands over what is seen.
    """
    image, k, m = wp.tid()
    k += first
    steps = rays.starts.shape[0]
    at = wp.where(rays.forward == 1, k, steps - 1 - k)
    row = image * steps * rays.across + at * rays.step_stride
    to = (image * steps + k) * rays.pitch + m
    values = type(turned_out[to])()
    last = rays.across - 1
    start, spacing = rays.starts[k], rays.spacings[k]
    for n in range(len(values)):
        place = start + wp.float32(m * len(values) + n) * spacing
        bounded = wp.clamp(place, wp.float32(0.0), wp.float32(last))
        side = wp.min(int(bounded), last - 1)
        part = bounded - wp.float32(side)
        lower = dent[row + side * rays.side_stride]
        upper = dent[row + (side + 1) * rays.side_stride]
        beside = wp.max(wp.float32(1.0) - wp.abs(place - bounded), wp.float32(0.0))
        inside = lower + part * (upper - lower)
        values[n] = wp.min(beside * inside, inside)
    turned_out[to] = values


@wp.kernel(enable_backward=False, module="unique")
def follow_rays(rays: Rays, first: wp.int32, turned: wp.array(dtype=Any)):
    """Follow rays from the lamp on; put how much of it is hidden, 0 to 1, in indentations' place.

    The ray that the gel has cut off farthest, by its slope, is the one in which gel stands next;
    the penumbra widens from where it was cut off.
    """
    image, m = wp.tid()
    m += first
    steps = rays.starts.shape[0]
    edge = type(turned[m])(_NOTHING)
    cut = type(edge)()
    longer = type(edge)()
    for n in range(len(edge)):
        slope = rays.slope + wp.float32(m * len(edge) + n) * rays.slopes_apart
        longer[n] = rays.spread * wp.sqrt(wp.float32(1.0) + slope * slope)
    for k in range(steps):
        at = (image * steps + k) * rays.pitch + m
        dent = turned[at]
        far, near, fall = rays.distances[k], rays.inverses[k], rays.falls[k]
        hidden = type(dent)()
        for n in range(len(dent)):
            over = far * (edge[n] + fall) - dent[n]
            wide = rays.softness + longer[n] * (far - cut[n])
            hidden[n] = wp.clamp(over / wide, wp.float32(0.0), wp.float32(1.0))
            slope = dent[n] * near - fall
            cut[n] = wp.where(slope > edge[n], far, cut[n])
            edge[n] = wp.max(slope, edge[n])
        turned[at] = hidden


@wp.func
def lost_light(
    rays: Rays,
    hidden: wp.array(dtype=wp.float32),
    steps_before: int,
    row: int,
    column: int,
    p: wp.float32,
    q: wp.float32,
    lanes: int,
) -> wp.float32:
    """Return what of a lamp's light a sample of a tilt does not get, from 0 to 1."""
    step, side = row, column
    if rays.along_columns == 1:
        step, side = column, row
    if rays.forward == 0:
        step = rays.starts.shape[0] - 1 - step
    ray = wp.max((wp.float32(side) - rays.starts[step]) * rays.per_spacing[step], wp.float32(0.0))
    whole = int(ray)
    place = (steps_before + step) * rays.pitch * lanes + whole
    lower, upper = hidden[place], hidden[place + 1]
    share = lower + (ray - wp.float32(whole)) * (upper - lower)
    if share > wp.float32(0.0):  # few are
        level = wp.float32(1.0) - p * p - q * q
        normal = wp.vec3f(p, q, wp.sqrt(wp.max(level, wp.float32(0.0))))
        x = (rays.column - wp.float32(column)) * rays.per_column
        y = (rays.row - wp.float32(row)) * rays.per_row
        facing = wp.dot(wp.normalize(wp.vec3f(x, y, rays.height)), normal)
        share *= wp.max(facing, wp.float32(0.0))
    return share


@wp.kernel(enable_backward=False)
def lose_light(
    rays: Rays,
    lanes: wp.int32,
    # Data in:
    hidden: wp.array(dtype=wp.float32),
    tilt: wp.array4d(dtype=wp.float32),
    # Data out:
    lost_out: wp.array3d(dtype=wp.float32),
):
    """Find what of a lamp's light the pixels of images do not get."""
    image, row, column = wp.tid()
    p, q = tilt[image, 0, row, column], tilt[image, 1, row, column]
    before = image * rays.starts.shape[0]
    lost_out[image, row, column] = lost_light(rays, hidden, before, row, column, p, q, lanes)


@wp.kernel(enable_backward=False, module="unique")
def darken_pixels(
    layout: Layout,
    first: wp.int32,
    # Model:
    rays: Rays,
    colour: wp.vec3f,
    gain: wp.array2d(dtype=Any),
    # Data in:
    hidden: wp.array(dtype=wp.float32),
    along: wp.array(dtype=Any),
    across: wp.array(dtype=Any),
    # Data in and out:
    change: wp.array2d(dtype=Any),
):
    """Take away what is hidden of a lamp, in the mean of each pixel's samples."""
    image, i, k = wp.tid()
    pixel_row = first + i
    at = place_of(layout, image, pixel_row, k)
    lost = type(along[at])()
    lanes = len(lost)
    before = image * rays.starts.shape[0]
    for a in range(layout.samples):
        row = pixel_row * layout.samples + a
        for c in range(layout.samples):
            p, q = along[at], across[at]
            for n in range(lanes):
                column = wp.min(k * lanes + n, layout.columns - 1) * layout.samples + c
                lost[n] += lost_light(rays, hidden, before, row, column, p[n], q[n], lanes)
            at += layout.plane
    lost = lost * (wp.float32(1.0) / wp.float32(layout.samples * layout.samples))
    of = pixel_row * layout.blocks + k
    to = image * layout.rows * layout.blocks + of
    for channel in range(3):
        taken = colour[channel] * wp.cw_mul(lost, gain[channel, of])
        change[channel, to] = change[channel, to] - taken
