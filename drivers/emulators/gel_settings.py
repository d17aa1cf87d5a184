"""What the emulated force sensor and camera are told of the gel that they share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from drivers.emulators.plant.gel import Plant
from drivers.emulators.plant.tips import CylinderTip, SphereTip, Tip
from drivers.emulators.plant.truth import draw_truth, read_truth
from drivers.emulators.process import DeviceSettings
from tacauchy_rig.core.config.model import IndenterKind
from tacauchy_rig.core.run import Vector3


@dataclass(frozen=True, slots=True, kw_only=True)
class GelSettings(DeviceSettings):
    """One gel under one indenter; the seed draws its world where there is no file of its truth.

    Attributes:
        world: Shared file with the arm's pose.
        truth: truth.json to use instead of the seed.
        surface_m: Where the gel's highest point is expected: x,y,z [m].
        tip: cylinder or sphere.
        diameter_m: Of the tip [m].
        fillet_m: Radius of a cylinder's edge [m].
    """

    world: Path | None = None
    truth: Path | None = None
    surface_m: Vector3 = (0.0, 0.0, 0.0)
    tip: IndenterKind = IndenterKind.CYLINDER
    diameter_m: float = 5e-3
    fillet_m: float = 1e-4

    def plant(self) -> Plant:
        """Return the gel, at rest.

        Raises:
            RecordError: The truth file cannot be read.
            ConfigError: The tip is impossible.
        """
        truth = draw_truth(self.seed) if self.truth is None else read_truth(self.truth)
        tip: Tip = SphereTip(diameter_m=self.diameter_m)
        if self.tip is IndenterKind.CYLINDER:
            tip = CylinderTip(diameter_m=self.diameter_m, fillet_m=self.fillet_m)
        return Plant(truth, tip, self.surface_m)
