"""A clamped disc of some hundred elements, and its matrix."""

import numpy as np

from sim.contact.surface_and_grip import ContactOptions
from sim.material.laws.law_and_lame import law
from sim.material.relaxation import prony_series
from sim.mesh.elements import ElementOrder
from sim.mesh.mirror_symmetry import MirrorSymmetry
from sim.mesh.revolved_mesh import Grading, revolved_mesh
from sim.scene.material import LawName, RelaxationTerm
from sim.scene.pad import DiscPad
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray

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
    contact_options: ContactOptions | None = None,
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
        contact_options=contact_options,
        prony=prony_series([terms], np.zeros(len(mesh.tets), dtype=np.int32)),
    )


def matrix(model: Model, positions: FloatArray, *, projected: bool) -> FloatArray:
    """Return the stiffness of the unknowns without contact, shape [dof_count, dof_count]."""
    free = np.zeros((*model.surface.areas.shape, 3, 3))
    upper = model.pattern.upper(model.hessian_data(positions, free, projected=projected)).toarray()
    return np.asarray(upper + np.triu(upper, 1).T)
