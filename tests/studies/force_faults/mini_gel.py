"""A GelSight Mini's gel under a 5 mm punch, as the simulator has it with preset fast."""

from __future__ import annotations

import numpy as np

from drivers.mock.world import Gel
from tacauchy_rig.core.expected_press import ExpectedPress

CURVE = np.array(
    [
        (0.0, 0.0, 0.0),
        (0.05, 0.0211, 0.0409),
        (0.1, 0.031, 0.0608),
        (0.2, 0.0481, 0.0901),
        (0.4, 0.0815, 0.1342),
        (0.7, 0.131, 0.1872),
        (1.0, 0.1801, 0.2367),
        (1.5, 0.2614, 0.3189),
        (2.0, 0.3426, 0.4009),
        (3.3, 0.5565, 0.616),
        (4.73, 0.7897, 0.8587),
        (7.2, 1.2051, 1.2363),
    ]
)
"""Force [N], depth under a straight and under a 2 degrees tilted face [mm]."""
FORCE_N, DEPTH_MM, TILTED_MM = CURVE.T
EXPECTED = ExpectedPress(
    sensor="gelsight-mini",
    made="a table of this study",
    depth_m=tuple((DEPTH_MM * 1e-3).tolist()),
    force_n=tuple(FORCE_N.tolist()),
    low=0.73,
    high=1.24,
    lean_m=84e-6,
    depth_error_m=35e-6,
    gel_height_m=4e-3,
)


class MiniGel(Gel):
    """A Mini's gel, so many times as stiff, under a face that is tilted by up to 2 degrees."""

    def __init__(
        self,
        *,
        stiffness: float = 1.0,
        tilt_share: float = 0.0,
        relaxed_fraction: float = 0.07,
        relaxation_time_s: float = 2.0,
    ) -> None:
        super().__init__(relaxed_fraction=relaxed_fraction, relaxation_time_s=relaxation_time_s)
        self.factor = stiffness
        self._depths_mm = (DEPTH_MM + tilt_share * (TILTED_MM - DEPTH_MM)).tolist()
        self._forces_n = FORCE_N.tolist()
        rise, way = FORCE_N[-1] - FORCE_N[-2], self._depths_mm[-1] - self._depths_mm[-2]
        self._end_slope = float(rise / way)

    def press(self, depth_m: float, *, duration_s: float) -> float:
        """Relax as any mock gel does, along the table's force instead of a straight line."""
        depth_mm = max(depth_m, 0.0) * 1e3
        beyond = self._end_slope * max(0.0, depth_mm - self._depths_mm[-1])
        force_n = self.factor * (
            float(np.interp(depth_mm, self._depths_mm, self._forces_n)) + beyond
        )
        return super().press(force_n / self.stiffness_n_m, duration_s=duration_s)
