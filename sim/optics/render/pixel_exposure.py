"""From changes of colour to the bytes of an image: blur, no-contact frame, rounding."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import warp as wp

from sim.optics.camera_geometry import ImageArray
from sim.optics.height.tilt import Float32Array
from sim.optics.render.exposure_kernel import expose_rows
from sim.optics.render.pixel_kernel import LANES, Block, ByteBlock
from sim.optics.render.pixel_planes import CPU, PixelLayout, Planes
from sim.optics.render.response import LINEAR, Response


class ExposedRows:
    """Blurs changes of colour and adds them to what does not change.

    Args:
        layout: Of the image.
        weights: Of a pixel's neighbours, as ``gaussian_weights`` has them.
        change: Red, green and blue [grey levels].
        base: What they are added to [grey levels], shape [3, height, width].
        response: How the camera shows light.
    """

    def __init__(
        self,
        layout: PixelLayout,
        weights: Float32Array,
        change: Planes,
        base: Float32Array,
        *,
        response: Response = LINEAR,
    ) -> None:
        self._layout, self._change, self._response = layout, change, response
        rows, columns = layout.geometry.height, layout.geometry.width
        shape = (3, rows, layout.blocks * LANES)
        whole = np.zeros(shape, dtype=np.float32)
        whole[..., :columns] = base
        self._base: Any = wp.array(whole.reshape(3, -1, LANES), dtype=Block, device=CPU)
        self._bytes = np.zeros(shape, dtype=np.uint8)
        self._out: Any = wp.array(
            ptr=self._bytes.ctypes.data,
            dtype=ByteBlock,
            shape=(3, rows * layout.blocks),
            device=CPU,
        )
        self._weights: Any = wp.array(weights, dtype=wp.float32, device=CPU)

    def of(self, rows: slice) -> Callable[[], None]:
        """Return what exposes some rows of the image, whenever changes are new."""
        scratch = Planes(1, 1, self._layout.blocks, reach=len(self._weights) // 2)
        recorded: Any = wp.launch(
            expose_rows,
            dim=rows.stop - rows.start,
            inputs=[
                self._layout.blocks,
                self._layout.geometry.width,
                rows.start,
                self._response.knee,
                self._weights,
                self._base,
                self._change.blocks.reshape((3, -1)),
                scratch.single,
                scratch.blocks,
                scratch.shifted,
            ],
            outputs=[self._out],
            device=CPU,
            record_cmd=True,
        )

        def expose(kept: Planes = scratch) -> None:
            del kept  # its memory is what the launch writes to
            recorded.launch()

        return expose

    def image(self) -> ImageArray:
        """Return what is exposed as RGB, shape [height, width, 3]."""
        planes = self._bytes[..., : self._layout.geometry.width]
        return np.asarray(cv2.merge(list(planes)), dtype=np.uint8)
