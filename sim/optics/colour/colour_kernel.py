"""Warp kernels of the change of light that a surface brings, a block of pixels in each thread."""

from typing import Any

import warp as wp

from sim.device import native_code
from sim.optics.colour.model_interface_and_response import CREASE_UNIT_M, INDENTATION_UNIT_M
from sim.optics.pixels.blur_and_exposure_kernel import Layout, place_of

# Where pixels' samples are tilted alike to this, the colour of their mean is their mean colour.
_LEVEL_TILT = 0.01


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
    lamp_count: wp.int32
    bend: wp.float32  # softness squared
    crease_limit: wp.float32
    lamp_weights: wp.array(dtype=wp.float32)  # level and slope along a row, of each colour


@wp.func_native(
    native_code(
        "sim.optics.pixels",
        "colour",
        LEVEL_TILT=f"{_LEVEL_TILT}f",
        INDENTATION_UNIT_M=f"{INDENTATION_UNIT_M}f",
        CREASE_UNIT_M=f"{CREASE_UNIT_M}f",
    )
)
def _colour_block(
    layout: Layout,
    image: int,
    row: int,
    part: int,
    first_place: int,
    model: Colours,
    like: Any,
    columns: wp.array(dtype=Any),
    lamps: wp.array(dtype=Any),
    gain: wp.array2d(dtype=Any),
    along: wp.array(dtype=Any),
    across: wp.array(dtype=Any),
    dent: wp.array(dtype=Any),
    change_out: wp.array2d(dtype=Any),
): ...


@wp.kernel(enable_backward=False, module="unique")
def colour_pixels(
    layout: Layout,
    # Model:
    model: Colours,
    columns: wp.array(dtype=Any),
    lamps: wp.array(dtype=Any),
    gain: wp.array2d(dtype=Any),
    # Data in:
    along: wp.array(dtype=Any),
    across: wp.array(dtype=Any),
    dent: wp.array(dtype=Any),
    # Data out:
    change_out: wp.array2d(dtype=Any),
):
    """Mean change of colour of pixels' samples; of their mean where a block's are tilted alike."""
    image, row, part = wp.tid()
    place = place_of(layout, image, row, 0)
    _colour_block(
        layout,
        image,
        row,
        part,
        place,
        model,
        type(columns[0])(),
        columns,
        lamps,
        gain,
        along,
        across,
        dent,
        change_out,
    )


@wp.kernel(enable_backward=False, module="unique")
def grey_pixels(
    layout: Layout,
    # Model:
    starts: wp.array(dtype=wp.float32),
    per_length: wp.array(dtype=wp.float32),
    rises: wp.array(dtype=wp.float32),
    level: wp.float32,
    # Data in:
    along: wp.array(dtype=Any),  # noqa: ARG001 - a model of light reads the tilts
    across: wp.array(dtype=Any),  # noqa: ARG001
    dent: wp.array(dtype=Any),
    # Data out:
    change_out: wp.array2d(dtype=Any),
):
    """Mean change of grey of pixels' samples: a table of indentation, as a sum of bounded ramps."""
    image, row, part = wp.tid()
    for k in range(part * layout.span, (part + 1) * layout.span):
        at = place_of(layout, image, row, k)
        total = type(dent[at])()
        for _s in range(layout.samples * layout.samples):
            total += dent[at] - dent[at]  # what is not a number stays so, which a clamp would hide
            for m in range(starts.shape[0]):
                share = (dent[at] - type(total)(starts[m])) * per_length[m]
                for n in range(len(share)):
                    share[n] = wp.clamp(share[n], wp.float32(0.0), wp.float32(1.0))
                total += rises[m] * share
            at += layout.plane
        total = total * (wp.float32(1.0) / wp.float32(layout.samples * layout.samples))
        to = (image * layout.rows + row) * layout.blocks + k
        for channel in range(3):
            change_out[channel, to] = total + type(total)(level)
