"""How far an error depends on what the edges of one mesh happen to cut."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.mesh.elements import ElementOrder
from sim.scene.scene import Preset
from sim.studies.accuracy.configurations import Configuration

EDGE_SHIFT = 0.07
# What finer meshes, on which nothing was measured, may have of an error for their chance.
_SHARE_MIN, _SHARE_MAX = 0.25, 1.0

Errors = Mapping[str, float]
MeshKey = tuple[ElementOrder, Preset, float]


def mesh_key(configuration: Configuration) -> MeshKey:
    """Return what decides a configuration's mesh and element."""
    return configuration.element, configuration.preset, configuration.refinement


def neighbours(configuration: Configuration) -> tuple[Configuration, Configuration]:
    """Return the same settings with all edges longer, and shorter, by as much as a seed may."""
    longer, shorter = (
        replace(configuration, refinement=configuration.refinement * (1.0 + shift))
        for shift in (-EDGE_SHIFT, EDGE_SHIFT)
    )
    return longer, shorter


def chance_of(own: Errors, others: Sequence[Errors]) -> dict[str, float]:
    """Return by quantity the largest difference of an error from its own on other meshes."""
    return {name: max(abs(other[name] - error) for other in others) for name, error in own.items()}


@dataclass(frozen=True, slots=True)
class MeasuredChance:
    """Errors on a mesh, and by how much they differ on its neighbours.

    Attributes:
        tet_count: Of the mesh.
    """

    errors: Errors
    chance: Errors
    tet_count: int


def chances(
    configuration: Configuration, errors: Errors, measured: Mapping[MeshKey, MeasuredChance]
) -> dict[str, float]:
    """Return the chance of a configuration's errors.

    That of its own mesh and element where it was measured; else the share of the error that it has
    on the finest mesh with such an element, between a quarter and all of it. The paper's mesh is
    but one and has none.

    Args:
        measured: What was found on the meshes that were shifted.
    """
    if configuration.preset is Preset.PAPER:
        return dict.fromkeys(errors, 0.0)
    key = mesh_key(configuration)
    alike = [found for other, found in measured.items() if other[0] is key[0]]
    near = measured.get(key) or max(alike, key=lambda found: found.tet_count, default=None)
    shares = dict.fromkeys(errors, _SHARE_MIN) if near is None else _shares(near)
    scaled = {name: shares[name] * abs(error) for name, error in errors.items()}
    if near is None or key not in measured:
        return scaled
    return {name: max(near.chance[name], scaled[name]) for name in errors}


def _shares(found: MeasuredChance) -> dict[str, float]:
    return {name: _share(found.chance[name], abs(error)) for name, error in found.errors.items()}


def _share(chance: float, error: float) -> float:
    return float(np.clip(chance / error, _SHARE_MIN, _SHARE_MAX)) if error > 0.0 else _SHARE_MIN
