"""Warp kernels of shadows: which rays of a lamp the gel cuts off, and what light is lost by it.

Shadows are found in sweeps from a lamp, along rays that part from it: step by step, and in a step
ray by ray. Samples lie in blocks as ``blur_and_exposure_kernel`` says.
"""

from typing import Any

import warp as wp

from sim.device import native_code, start_warp
from sim.optics.pixels.blur_and_exposure_kernel import Layout, place_of

start_warp()

_NOTHING = -1.0e3  # below all that a ray may meet, over its distance


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


@wp.func_native(native_code(__package__, "measure"))
def _measure(
    like: Any,
    image: int,
    i: int,
    j: int,
    dent: wp.array3d(dtype=wp.float32),
    cells_out: wp.array3d(dtype=wp.vec2f),
): ...


@wp.kernel(enable_backward=False, module="unique")
def measure_cells(
    like: Any, dent: wp.array3d(dtype=wp.float32), cells_out: wp.array3d(dtype=wp.vec2f)
):
    """Find the largest change from a sample to the next, and the largest bulge, of a cell."""
    image, i, j = wp.tid()
    _measure(like, image, i, j, dent, cells_out)


@wp.func_native(native_code(__package__, "follow", NOTHING=f"{_NOTHING}f"))
def _follow(
    like: Any,
    rays: Rays,
    image: int,
    m: int,
    dent: wp.array3d(dtype=wp.float32),
    cells: wp.array3d(dtype=wp.vec2f),
    hidden: wp.array(dtype=Any),
    shaded: wp.array(dtype=wp.int32),
    marks: wp.array3d(dtype=wp.int32),
): ...


@wp.kernel(enable_backward=False, module="unique")
def follow_rays(
    rays: Rays,
    # Data in:
    dent: wp.array3d(dtype=wp.float32),
    cells: wp.array3d(dtype=wp.vec2f),
    # Data out:
    hidden: wp.array(dtype=Any),
    shaded: wp.array(dtype=wp.int32),
    marks: wp.array3d(dtype=wp.int32),
):
    """Follow rays from the lamp on; find how much of it is hidden, 0 to 1.

    The ray that the gel has cut off farthest, by its slope, is the one in which gel stands next;
    the penumbra widens from where it was cut off. Indentations are interpolated between samples.
    Beside the image there is none, or else the border's bulge: no gel stands over what is seen.

    A processor leaves out what cells say is too level for a shadow to begin: ``hidden`` stays
    zero where ``shaded`` is, by as many steps as a block has rays. ``marks`` are cells in shadow.
    """
    image, m = wp.tid()
    _follow(type(hidden[0])(), rays, image, m, dent, cells, hidden, shaded, marks)


@wp.func_native(native_code(__package__, "darken"))
def _darken(
    like: Any,
    layout: Layout,
    image: int,
    row: int,
    part: int,
    first_place: int,
    rays: Rays,
    colour: wp.vec3f,
    gain: wp.array2d(dtype=Any),
    hidden: wp.array(dtype=Any),
    marks: wp.array3d(dtype=wp.int32),
    along: wp.array(dtype=Any),
    across: wp.array(dtype=Any),
    change: wp.array2d(dtype=Any),
): ...


@wp.kernel(enable_backward=False, module="unique")
def darken_pixels(
    layout: Layout,
    # Model:
    rays: Rays,
    colour: wp.vec3f,
    gain: wp.array2d(dtype=Any),
    # Data in:
    hidden: wp.array(dtype=Any),
    marks: wp.array3d(dtype=wp.int32),
    along: wp.array(dtype=Any),
    across: wp.array(dtype=Any),
    # Data in and out:
    change: wp.array2d(dtype=Any),
):
    """Take away what is hidden of a lamp, in the mean of each pixel's samples."""
    image, row, part = wp.tid()
    at = place_of(layout, image, row, 0)
    like = type(hidden[0])()
    _darken(
        like, layout, image, row, part, at, rays, colour, gain, hidden, marks, along, across, change
    )
