"""Samples of an image's pixels laid out for ``pixel_kernel``, and their tilts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.optics.camera_geometry import CameraGeometry
from sim.optics.height.tilt import Float32Array
from sim.optics.render.pixel_kernel import (
    LANES,
    ROOM_ROWS,
    Band,
    Block,
    continue_rows,
    tilt_samples,
)

CPU = "cpu"


class Planes:
    """Rows of values with a block of room at each end, as NumPy and as Warp see them.

    Attributes:
        values: Shape [plane_count, row_count, (block_count + 2) LANES].
        single: Value by value.
        blocks: Block by block.
        shifted: The blocks that start up to ``reach`` values before and behind those, shape
            [2 reach + 1, ...].
    """

    def __init__(self, plane_count: int, row_count: int, blocks: int, *, reach: int = 1) -> None:
        count = plane_count * row_count * (blocks + 2)
        room = -(-reach // LANES) * LANES
        self._memory = np.zeros(count * LANES + 2 * room, dtype=np.float32)
        inner = self._memory[room : room + count * LANES]
        self.values: Float32Array = inner.reshape(plane_count, row_count, -1)
        self.single: Any = wp.array(
            ptr=inner.ctypes.data, dtype=wp.float32, shape=len(inner), device=CPU
        )
        self.blocks: Any = blocks_of(inner)
        self.shifted: Any = shifted_blocks(inner, first=-reach, count=2 * reach + 1)


def blocks_of(values: Float32Array) -> Any:
    """Return values block by block, as Warp sees them; they must outlive it."""
    count = values.size // LANES
    return wp.array(ptr=values.ctypes.data, dtype=Block, shape=count, device=CPU)


def shifted_blocks(values: Float32Array, *, first: int, count: int) -> Any:
    """Return blocks that start at each of ``count`` shifts, shape [count, block_count].

    Args:
        values: Their memory must reach as far as the shifts.
        first: Values by which the first of them lies further on.
        count: Shifts, each by a value more.
    """
    return wp.array(
        ptr=values.ctypes.data + first * values.itemsize,
        dtype=Block,
        shape=(count, values.size // LANES),
        strides=(values.itemsize, LANES * values.itemsize),
        device=CPU,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelLayout:
    """An image's samples in blocks of pixels.

    Attributes:
        geometry: Pixels.
        samples: Of a pixel, both ways.
    """

    geometry: CameraGeometry
    samples: int

    @property
    def blocks(self) -> int:
        """Blocks that a row of pixels fills."""
        return -(-self.geometry.width // LANES)

    def planes(self, row_count: int) -> Planes:
        """Return a plane for each sample, with room for the rows beside a band."""
        return Planes(self.samples**2, row_count + 2 * ROOM_ROWS, self.blocks)

    def band(self, rows: slice, row_count: int) -> Any:
        """Return a band of rows for kernels, in planes made for ``row_count``."""
        fine = self.geometry.refined(self.samples)
        band: Any = Band()
        band.rows, band.blocks = self.geometry.height, self.blocks
        band.plane = (row_count + 2 * ROOM_ROWS) * (self.blocks + 2)
        band.samples, band.first = self.samples, rows.start
        band.half_per_x, band.per_y = 0.5 / fine.scale_x_m, 1.0 / fine.scale_y_m
        return band


class SampleBuffers:
    """Samples of one band of rows at a time, for one thread.

    Attributes:
        row_count: The most rows that a band has.
        height: Less the unloaded gel's first value [m].
        along: Tilt along rows of the image.
        across: Tilt along its columns.
        dent: Unloaded minus loaded height [m].
    """

    def __init__(self, layout: PixelLayout, row_count: int) -> None:
        self.row_count = row_count
        self.height, self.along, self.across, self.dent = (
            layout.planes(row_count) for _ in range(4)
        )


class SampledBand:
    """A band of rows of an image, sampled into a thread's buffers.

    Args:
        layout: Of the image.
        rows: Of pixels.
        rest_height: Of the unloaded gel's samples [m].
        buffers: Where the samples go.

    Attributes:
        rows: Of pixels.
        layout: Of the image.
        band: For kernels.
        buffers: Where the samples are.
    """

    def __init__(
        self,
        layout: PixelLayout,
        rows: slice,
        rest_height: NDArray[np.floating],
        buffers: SampleBuffers,
    ) -> None:
        self.layout, self.rows, self.buffers = layout, rows, buffers
        self.band = layout.band(rows, buffers.row_count)
        self._origin = float(rest_height.flat[0])
        self._rest = layout.planes(buffers.row_count)
        self._split(rest_height, self._rest)
        self._launches = self._recorded()

    def sample(self, height: NDArray[np.floating]) -> None:
        """Take the samples of the loaded gel's heights [m]."""
        self._split(height, self.buffers.height)
        for launch in self._launches:
            launch()

    def of_pixels(self, planes: Planes) -> Float32Array:
        """Return planes without their room, shape [sample_count, row_count, column_count]."""
        first, last = ROOM_ROWS, ROOM_ROWS + self.rows.stop - self.rows.start
        return planes.values[:, first:last, LANES : LANES + self.layout.geometry.width]

    def _beside(self, count: int) -> slice:
        """Return the rows with so many beside them, as far as the image has them."""
        stop = min(self.rows.stop + count, self.layout.geometry.height)
        return slice(max(self.rows.start - count, 0), stop)

    def _split(self, height: NDArray[np.floating], planes: Planes) -> None:
        samples, rows = self.layout.samples, self._beside(ROOM_ROWS)
        first = rows.start - self.rows.start + ROOM_ROWS
        local = slice(first, first + rows.stop - rows.start)
        columns = slice(LANES, LANES + self.layout.geometry.width)
        fine = height[rows.start * samples : rows.stop * samples]
        for plane, values in enumerate(planes.values):
            a, b = divmod(plane, samples)
            np.subtract(
                fine[a::samples, b::samples],
                self._origin,
                out=values[local, columns],
                casting="same_kind",
            )

    def _recorded(self) -> Sequence[Callable[[], None]]:
        known, tilted, held = self._beside(ROOM_ROWS), self._beside(1), self.buffers
        columns = self.layout.geometry.width

        def launch(kernel: Any, count: int, inputs: list[Any], outputs: list[Any]) -> Any:
            given = [self.band, *inputs]
            recorded: Any = wp.launch(
                kernel, dim=count, inputs=given, outputs=outputs, device=CPU, record_cmd=True
            )
            return recorded.launch

        def go_on(rows: slice, planes: Planes) -> Any:
            count = rows.stop - rows.start
            return launch(continue_rows, count, [columns, rows.start, planes.single], [])

        count = (tilted.stop - tilted.start) * self.layout.blocks
        tilt = launch(
            tilt_samples,
            count,
            [tilted.start, self._rest.blocks, held.height.shifted],
            [held.along.blocks, held.across.blocks, held.dent.blocks],
        )
        return go_on(known, held.height), tilt, go_on(tilted, held.along)
