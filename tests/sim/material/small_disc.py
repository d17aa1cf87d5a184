"""A clamped disc of some hundred elements."""

from __future__ import annotations

import numpy as np

from sim.material.laws.tangent import law
from sim.material.relaxation import prony_series
from sim.mesh.elements import ElementOrder
from sim.mesh.revolved import Grading, revolved_mesh
from sim.mesh.tet_mesh import MirrorSymmetry
from sim.scene.material import LawName, RelaxationTerm
from sim.scene.pad import DiscPad
from sim.solve.model import Model

PAD = DiscPad(radius_m=3e-3, height_m=2e-3)


def disc_model(
    name: LawName,
    *,
    order: ElementOrder = ElementOrder.P2,
    young_pa: float = 4e5,
    poisson: float = 0.45,
    size_m: float = 0.6e-3,
    symmetry: MirrorSymmetry | None = None,
    terms: tuple[RelaxationTerm, ...] = (),
) -> Model:
    """Return a quarter of it, or by another symmetry; it relaxes by its terms."""
    grading = Grading(start_m=1e-3, end_m=1e-3, size_m=size_m, growth=2.0)
    mesh = revolved_mesh(
        PAD, grading, centre_m=(0.0, 0.0), sector_count=8, name="test", symmetry=symmetry
    )
    return Model(
        mesh,
        order=order,
        law=law(name),
        young_pa=young_pa,
        poisson=poisson,
        prony=prony_series([terms], np.zeros(len(mesh.tets), dtype=np.int32)),
    )
