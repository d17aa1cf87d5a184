"""Images' samples in a device's memory, laid out in the blocks of ``blur_and_exposure_kernel``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from sim.optics.pixels.blur_and_exposure_kernel import Layout
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.arrays import Float32Array, RealArray

# Pixels of a block: as many as the widest registers of a processor hold, and one on a GPU.
CPU_LANES, GPU_LANES = 16, 1
BLOCK_TYPES: dict[int, Any] = {
    lanes: wp.types.vector(length=lanes, dtype=wp.float32) for lanes in (CPU_LANES, GPU_LANES)
}


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelBlocks:
    """Where the samples of a camera's images lie."""

    geometry: CameraGeometry
    samples: int  # of a pixel, both ways
    device: str
    lanes: int  # pixels of a block

    @property
    def row_blocks(self) -> int:
        """Blocks that a row of pixels fills."""
        return -(-self.geometry.width // self.lanes)

    @property
    def parts(self) -> int:
        """Threads that share a row of pixels: a processor's has it whole, a GPU's a pixel of it."""
        return 1 if self.lanes > 1 else self.row_blocks

    def layout(self) -> Any:
        """Return it for kernels."""
        fine = self.geometry.refined(self.samples)
        layout: Any = Layout()
        layout.rows, layout.columns = self.geometry.height, self.geometry.width
        layout.blocks, layout.pitch = self.row_blocks, self.row_blocks + 2
        layout.plane, layout.samples = (layout.rows + 2) * layout.pitch, self.samples
        layout.span = self.row_blocks // self.parts
        layout.half_per_x, layout.half_per_y = 0.5 / fine.scale_x_m, 0.5 / fine.scale_y_m
        return layout

    def planes(self, image_count: int) -> BlockMemory:
        """Return room for the samples of images."""
        count = image_count * self.samples**2 * int(self.layout().plane)
        return BlockMemory(1, count, self.lanes, self.device)

    def sample_planes(self, values: RealArray) -> Any:
        """Return samples of images, shape [..., height, width], as kernels want them."""
        rows, columns, samples = self.geometry.height, self.geometry.width, self.samples
        split = values.reshape(-1, rows, samples, columns, samples).transpose(0, 2, 4, 1, 3)
        short = self.row_blocks * self.lanes - columns
        room = (*[(0, 0)] * 3, (1, 1), (self.lanes, self.lanes + short))
        return self.array(np.pad(split, room).reshape(-1, self.lanes), self.block)

    def samples_of(self, planes: BlockMemory) -> Float32Array:
        """Return the samples of images, shape [image_count, height, width] of them."""
        rows, columns, samples = self.geometry.height, self.geometry.width, self.samples
        shape = (-1, samples, samples, rows + 2, (self.row_blocks + 2) * self.lanes)
        values: Float32Array = planes.single.numpy()
        inner = values.reshape(shape)[..., 1:-1, self.lanes : self.lanes + columns]
        return inner.transpose(0, 3, 1, 4, 2).reshape(-1, rows * samples, columns * samples)

    def pixel_rows(self, values: RealArray) -> Any:
        """Return values of pixels in blocks, shape [n, blocks] of [n, ..., width]."""
        short = -values.shape[-1] % self.lanes
        widths = [(0, 0)] * (values.ndim - 1) + [(0, short)]
        wide = np.pad(values, widths, mode="edge")
        return self.array(wide.reshape(len(values), -1, self.lanes), self.block)

    @property
    def block(self) -> Any:
        """Warp's type of a block."""
        return BLOCK_TYPES[self.lanes]

    def array(self, values: RealArray | Sequence[float], dtype: Any = wp.float32) -> Any:
        """Return numbers on the device, single ones or blocks."""
        plain = np.ascontiguousarray(values, dtype=np.float32)
        return wp.array(plain, dtype=dtype, device=self.device)


class BlockMemory:
    """Values on a device, as kernels see them.

    Attributes:
        single: Value by value, shape [channel_count, value_count].
        blocks: Block by block, shape [channel_count, block_count].
    """

    def __init__(
        self, channel_count: int, block_count: int, lanes: int, device: str, *, reach: int = 1
    ) -> None:
        block, size = BLOCK_TYPES[lanes], np.dtype(np.float32).itemsize
        room = -(-reach // CPU_LANES) * CPU_LANES  # blocks stay aligned
        channel = block_count * lanes
        whole = channel_count * channel + 2 * room
        self._memory: Any = wp.zeros(whole, dtype=wp.float32, device=device)
        begin = self._memory.ptr + size * room
        shape = (channel_count, block_count)
        self.single: Any = wp.array(
            ptr=begin, dtype=wp.float32, shape=(channel_count, channel), device=device
        )
        self.blocks: Any = wp.array(ptr=begin, dtype=block, shape=shape, device=device)

    def pixels(self, layout: PixelBlocks) -> Float32Array:
        """Return the values of one image, shape [channel_count, height, width]."""
        height, width = layout.geometry.height, layout.geometry.width
        rows: Float32Array = self.single.numpy().reshape(len(self.single), height, -1)
        return rows[..., :width]
