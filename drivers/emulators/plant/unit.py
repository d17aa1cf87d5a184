"""Which sensor is emulated: the sizes that a lab reads off the thing it holds in its hand.

Stiffness, light, place and scale of the emulated world are drawn around these; how the gel bends
and what its camera sees are the emulator's own.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from drivers.emulators.plant.quad_mesh import GelDisc
from tacauchy_rig.core.arrays import FloatArray


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


class GelLight(StrEnum):
    """What the camera sees: painted gel lit from its sides, or a dark skin through clear gel."""

    COLOURED = "coloured"
    TRANSLUCENT = "translucent"


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedUnit:
    """One make of sensor; the defaults are a GelSight Mini.

    Attributes:
        name: For messages.
        pad_size_m: Length along x and y [m].
        dome_radii_m: Of the pad's top along x and y [m]; None takes the disc's for both.
        gel: The disc of equal area that is pressed in its place.
        young_pa: Nominal modulus of the layer that is touched [Pa].
        poisson: Nominal Poisson's ratio.
        image_size: Columns and rows of the image that is scored [px].
        pixel_m: Nominal size of its pixels on the gel, x and y [m].
        crop: Part of the raw frame's width and height that is cut off at each border.
        light: How the gel is seen.
        shadows: Whether dents hide the lights from the gel behind them.
        markers: Dots printed on the gel; None where it has none.
    """

    name: str = "gelsight-mini"
    pad_size_m: tuple[float, float] = (25.25e-3, 20.75e-3)
    dome_radii_m: tuple[float, float] | None = None
    gel: GelDisc = field(default_factory=GelDisc)
    young_pa: float = 0.435e6
    poisson: float = 0.48
    image_size: tuple[int, int] = (320, 240)
    pixel_m: tuple[float, float] = (0.0634e-3, 0.0634e-3)
    crop: float = 0.15
    light: GelLight = GelLight.COLOURED
    shadows: bool = False
    markers: MarkerGrid | None = None

    @property
    def dome_curvatures(self) -> tuple[float, float]:
        """Curvature of the unloaded top along x and y [1/m]."""
        radii = self.dome_radii_m or (self.gel.dome_radius_m, self.gel.dome_radius_m)
        return 1.0 / radii[0], 1.0 / radii[1]
