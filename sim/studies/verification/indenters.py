"""What several sections press with: a sharp punch, a rounded one and a ball."""

from __future__ import annotations

from sim.scene.indenter import Cylinder, Indenter, Sphere

INDENTERS: tuple[Indenter, ...] = (
    Cylinder(diameter_m=5e-3),
    Cylinder(diameter_m=5e-3, fillet_m=0.1e-3),
    Sphere(diameter_m=8e-3),
)
