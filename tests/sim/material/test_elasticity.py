"""The gradient an element at a time, against the one a point at a time."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from sim.device import Device
from sim.material.laws.tangent import law
from sim.mesh.elements import ElementOrder
from sim.mesh.graded_plane import Grading
from sim.mesh.revolved import revolved_mesh
from sim.scene.material import LawName
from sim.scene.pad import DiscPad
from sim.solve.model import Model

_PAD = DiscPad(radius_m=3e-3, height_m=2e-3)
_GRADING = Grading(start_m=1e-3, end_m=1e-3, size_m=0.6e-3, growth=2.0)


@pytest.mark.parametrize("name", list(LawName))
@pytest.mark.parametrize("order", list(ElementOrder))
def test_an_element_at_a_time_is_a_point_at_a_time(name: LawName, order: ElementOrder) -> None:
    """Every law and order, in a gel of two moduli, at a random deformed state."""
    mesh = revolved_mesh(
        _PAD, _GRADING, centre_m=(0.0, 0.0), sector_count=8, name="test", symmetric=False
    )
    young_pa = np.where(np.arange(len(mesh.tets)) % 2, 2e5, 4e5)
    model = Model(mesh, order=order, law=law(name), young_pa=young_pa, poisson=0.48)
    moved = np.random.default_rng(5).normal(scale=2e-5, size=model.nodes.shape)
    positions = model.nodes + moved
    cpu = Device("cpu")
    found = cpu.zeros(len(model.nodes), wp.vec3d)
    model.gel.recorded_gradient(cpu.vectors(positions), found).launch()
    wanted = model.gel.gradient(positions)
    assert np.abs(found.numpy() - wanted).max() <= 1e-11 * np.abs(wanted).max()
