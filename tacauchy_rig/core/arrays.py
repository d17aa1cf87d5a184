"""Array types of the whole program, and a hash of values; shapes and units stand in docstrings."""

import re
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tacauchy_rig import __version__

AnyArray = NDArray[Any]
BoolArray = NDArray[np.bool_]
ImageArray = NDArray[np.uint8]
"""Grey, shape [height, width], or RGB, shape [height, width, 3]."""
IntArray = NDArray[np.int32]
Int64Array = NDArray[np.int64]
IndexArray = NDArray[np.intp]
Float32Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]
RealArray = NDArray[np.floating]
"""Single or double precision."""
_ADDRESS = re.compile(r" at 0x[0-9a-f]+")


def content_hash(*told: object) -> str:
    """Return the SHA-256 of values and this program's version, the same in every process."""
    with np.printoptions(threshold=10_000_000):
        written = repr((__version__, *told))
    return sha256(_ADDRESS.sub("", written).encode()).hexdigest()
