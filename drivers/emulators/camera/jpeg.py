"""JPEG frames put together from strips that were encoded separately.

With a restart marker every few blocks (ITU-T T.81, section E.1.4) each interval decodes by itself:
the prediction starts anew and bits are padded to a byte. So a frame can be spliced from intervals
of different encodings, and a large frame costs only the intervals that changed.
"""

from __future__ import annotations

import re

import cv2
import numpy as np

from drivers.emulators.plant.arrays import ImageArray
from tacauchy_rig.errors import DeviceError

MCU_PX = 16  # of 4:2:0 sampling
QUALITY = 94  # gives 0.84 MB at 3280x2464, what the real camera sends
_RESTART = re.compile(rb"\xff[\xd0-\xd7]")
_START_OF_SCAN = b"\xff\xda"
_END_OF_IMAGE = b"\xff\xd9"
_TILES_PER_ROW = 5

Tiles = list[list[bytes]]


class JpegMosaic:
    """Encodes blocks of one frame size into tiles and splices tiles into frames.

    A tile is ``tile_width`` x 16 px; a block begins and ends on tile boundaries or at the frame's
    edge.

    Attributes:
        columns, rows: Tiles in a frame.
    """

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        mcu_columns = -(-width // MCU_PX)
        longest = max(1, mcu_columns // _TILES_PER_ROW)
        per_tile = max(n for n in range(1, longest + 1) if mcu_columns % n == 0)
        self.tile_width = per_tile * MCU_PX
        self.columns = mcu_columns // per_tile
        self.rows = -(-height // MCU_PX)
        self._settings = [
            *(cv2.IMWRITE_JPEG_QUALITY, QUALITY),
            *(cv2.IMWRITE_JPEG_RST_INTERVAL, per_tile),
            *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420),
        ]
        self._header = _split_header(self._encode(np.zeros((height, width, 3), np.uint8)))[0]
        markers = [bytes((0xFF, 0xD0 + i % 8)) for i in range(self.columns * self.rows - 1)]
        self._closings = [*markers, _END_OF_IMAGE]

    def tiles(self, block: ImageArray) -> Tiles:
        """Encode a block that starts on a tile boundary; returns its tiles by row and column."""
        columns = -(-block.shape[1] // self.tile_width)
        parts = _RESTART.split(_split_header(self._encode(block))[1])
        return [parts[i : i + columns] for i in range(0, len(parts), columns)]

    def splice(self, tiles: Tiles) -> bytes:
        """Return the frame made of ``tiles``, all rows and columns of it."""
        pieces = [self._header]
        closings = iter(self._closings)
        for row in tiles:
            for tile in row:
                pieces.append(tile)
                pieces.append(next(closings))
        return b"".join(pieces)

    def _encode(self, block: ImageArray) -> bytes:
        encoded, data = cv2.imencode(".jpg", block, self._settings)
        if not encoded:
            raise DeviceError(f"emulated camera: a block of {block.shape} could not be encoded")
        return data.tobytes()


def _split_header(jpeg: bytes) -> tuple[bytes, bytes]:
    """Return what comes before the entropy-coded data, and that data without the end marker."""
    scan = jpeg.index(_START_OF_SCAN)
    start = scan + 2 + int.from_bytes(jpeg[scan + 2 : scan + 4], "big")
    return jpeg[:start], jpeg[start:-2]
