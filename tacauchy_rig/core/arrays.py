"""Array types of the whole program; shapes and units stand in docstrings."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

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
