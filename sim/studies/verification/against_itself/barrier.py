"""What the contact distance d_hat changes in F_z."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sim.press import press
from sim.scene.indenter import describe
from sim.scene.material import Material
from sim.scene.pad import BoxPad
from sim.scene.scene import ContactMode, Preset, Scene, Target
from sim.studies.verification.indenters import INDENTERS
from tacauchy_rig.tables import Table

ALLOWED = 0.003
_SCENE = Scene(
    pad=BoxPad(size_x_m=20e-3, size_y_m=24e-3, height_m=4e-3),
    material=Material(young_pa=4e5, poisson=0.48),
    indenter=INDENTERS[0],
    target=Target(depth_m=0.2e-3),
    preset=Preset.FAST,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class BarrierLimit:
    """F_z of one scene at three contact distances.

    Attributes:
        forces_n: At d_hat, half and a quarter of it [N].
    """

    indenter: str
    contact: str
    distance_m: float
    forces_n: tuple[float, float, float]

    @property
    def limit_n(self) -> float:
        """F_z extrapolated to d_hat = 0 along the parabola through the three [N]."""
        whole, half, quarter = self.forces_n
        return (whole - 6.0 * half + 8.0 * quarter) / 3.0

    @property
    def difference(self) -> float:
        """How far the preset's F_z is from the limit, relative to it."""
        return abs(self.forces_n[0] / self.limit_n - 1.0)


def barrier_limit(scene: Scene) -> BarrierLimit:
    """Press a scene at its own d_hat, at half and at a quarter of it."""
    first, second, third = (
        press(replace(scene, barrier_m=share * scene.contact_distance_m)).force_n[2]
        for share in (1.0, 0.5, 0.25)
    )
    return BarrierLimit(
        indenter=describe(scene.indenter),
        contact=scene.contact.value,
        distance_m=scene.contact_distance_m,
        forces_n=(first, second, third),
    )


def measure() -> Table:
    """Extrapolate F_z to d_hat = 0 for a few presses."""
    scenes = [replace(_SCENE, indenter=indenter) for indenter in INDENTERS]
    scenes.append(replace(_SCENE, contact=ContactMode.BONDED))
    found = [barrier_limit(scene) for scene in scenes]
    return Table(
        title="Contact distance d_hat",
        columns=(
            "indenter",
            "contact",
            "d_hat [um]",
            "F_z [N]",
            "F_z, d_hat/2 [N]",
            "F_z, d_hat/4 [N]",
            "F_z, d_hat to 0 [N]",
            "difference",
        ),
        rows=tuple(
            (
                row.indenter,
                row.contact,
                row.distance_m * 1e6,
                *row.forces_n,
                row.limit_n,
                row.difference,
            )
            for row in found
        ),
        criterion="F_z extrapolated to d_hat = 0 differs from the preset's by less than 0.3 %",
        passed=all(row.difference < ALLOWED for row in found),
        note="every preset has the same d_hat; under a sharp rim it is smaller",
    )
