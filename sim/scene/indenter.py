"""Rigid indenters as data: solids whose lowest point is the origin of their own frame.

In the indenter's frame +z points up, away from the gel, and the body lies at z >= 0.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sim.arrays import FloatArray
from sim.scene.triangle_indenter import MeshIndenter
from tacauchy_rig.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class Cylinder:
    """Flat-ended punch with its axis along z.

    Attributes:
        diameter_m: Diameter [m].
        fillet_m: Radius of the rounded edge of the flat end [m]; 0 is a sharp rim.
    """

    diameter_m: float
    fillet_m: float = 0.0

    def __post_init__(self) -> None:
        _check_positive("cylinder diameter", self.diameter_m)
        if not 0.0 <= self.fillet_m <= 0.5 * self.diameter_m:
            raise ConfigError(
                f"cylinder fillet {self.fillet_m * 1e3:g} mm is not between 0 and the radius "
                f"{self.diameter_m * 500:g} mm",
                remedy="give a fillet from 0 mm to the radius",
            )

    @property
    def radius_m(self) -> float:
        """Radius [m]."""
        return 0.5 * self.diameter_m

    def lower_surface(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the height of the underside above the tip [m], inf beside the body."""
        radius = np.hypot(x, y)
        inside = np.clip(radius - (self.radius_m - self.fillet_m), 0.0, self.fillet_m)
        height = self.fillet_m - np.sqrt(np.maximum(self.fillet_m**2 - inside**2, 0.0))
        return np.where(radius <= self.radius_m, height, np.inf)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sphere:
    """Ball whose lowest point is the origin."""

    diameter_m: float

    def __post_init__(self) -> None:
        _check_positive("sphere diameter", self.diameter_m)

    @property
    def radius_m(self) -> float:
        """Radius [m]."""
        return 0.5 * self.diameter_m

    def lower_surface(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the height of the underside above the tip [m], inf beside the body."""
        squared = self.radius_m**2 - np.hypot(x, y) ** 2
        height = self.radius_m - np.sqrt(np.maximum(squared, 0.0))
        return np.where(squared >= 0.0, height, np.inf)


@dataclass(frozen=True, slots=True, kw_only=True)
class Plane:
    """Unbounded flat plate."""

    def lower_surface(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return zero everywhere [m]."""
        return np.zeros(np.broadcast(x, y).shape)


Indenter = Cylinder | Sphere | Plane | MeshIndenter


def grown(indenter: Indenter, by_m: float) -> Indenter:
    """Return what lies within a distance of a body [m]; its tip lies lower by as much.

    A plate and a mesh are returned as they are.
    """
    if isinstance(indenter, Cylinder):
        fillet = indenter.fillet_m + by_m
        return replace(indenter, diameter_m=indenter.diameter_m + 2.0 * by_m, fillet_m=fillet)
    if isinstance(indenter, Sphere):
        return replace(indenter, diameter_m=indenter.diameter_m + 2.0 * by_m)
    return indenter


def describe(indenter: Indenter) -> str:
    """Return the indenter as the command line writes it, for example ``cylinder:diameter=5mm``."""
    if isinstance(indenter, Cylinder):
        fillet = f",fillet={indenter.fillet_m * 1e3:g}mm" if indenter.fillet_m else ""
        return f"cylinder:diameter={indenter.diameter_m * 1e3:g}mm{fillet}"
    if isinstance(indenter, Sphere):
        return f"sphere:diameter={indenter.diameter_m * 1e3:g}mm"
    if isinstance(indenter, MeshIndenter):
        return f"mesh:{indenter.name}"
    return "plane"


def _check_positive(name: str, value: float) -> None:
    if not value > 0.0:
        raise ConfigError(
            f"{name} {value * 1e3:g} mm is not positive", remedy="give a length above 0 mm"
        )
