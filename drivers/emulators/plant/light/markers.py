"""Printed dots on the gel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.emulators.plant.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerGrid:
    """A rectangular grid of dots, centred on the gel."""

    columns: int = 9
    rows: int = 7
    pitch_m: tuple[float, float] = (2.41e-3, 2.46e-3)
    radius_m: float = 0.35e-3

    def rest(self) -> FloatArray:
        """Return the centres at rest [m], shape [rows * columns, 2]."""
        x = (np.arange(self.columns) - 0.5 * (self.columns - 1)) * self.pitch_m[0]
        y = (np.arange(self.rows) - 0.5 * (self.rows - 1)) * self.pitch_m[1]
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
