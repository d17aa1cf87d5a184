"""Array types of the simulator; shapes stand in docstrings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]
Float32Array = NDArray[np.float32]
RealArray = NDArray[np.floating]
