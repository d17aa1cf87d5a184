"""A small block, its unknowns, and displacements of them, for the kernels of a batch."""

from __future__ import annotations

import numpy as np

from sim.arrays import FloatArray
from sim.batch.kernels.gathering import Numbering, numbering
from sim.contact.state import ContactOptions
from sim.mesh.elements import ElementOrder
from sim.scene.material import LawName
from sim.solve.model import Model
from sim.studies.hard_cases.pads import brick_mesh, pad_model

BARRIER_M = 0.2e-3


def block(
    order: ElementOrder = ElementOrder.P1, law_name: LawName = LawName.STABLE_NEO_HOOKEAN
) -> Model:
    """Return 12 x 12 x 4 mm of gel whose barrier reaches far."""
    options = ContactOptions(distance_m=BARRIER_M)
    mesh = brick_mesh((3, 3, 2), jitter=0.1)
    return pad_model(mesh, order=order, law_name=law_name, contact_options=options)


def rows_of(model: Model, moved: FloatArray) -> tuple[Numbering, FloatArray]:
    """Return the unknowns and their values, a zero after them for what is fixed.

    Args:
        moved: Displacements of the nodes [m], shape [node_count, 3]; none of the clamped ones.
    """
    numbered = numbering(model.pattern, is_pushed=False)
    values = np.zeros(numbered.row_count + 1)
    free = numbered.rows < numbered.row_count
    values[numbered.rows[free]] = moved[free]
    return numbered, values


def moved_at_random(model: Model, size_m: float, seed: int) -> FloatArray:
    """Return displacements of the free nodes [m], shape [node_count, 3]."""
    rng = np.random.default_rng(seed)
    return model.pattern.nodal(rng.normal(scale=size_m, size=model.pattern.dof_count))
