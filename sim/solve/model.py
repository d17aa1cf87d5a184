"""Model: what of a pad stays fixed while it is pressed; ``State`` is what changes."""

from __future__ import annotations

import numpy as np
import warp as wp

from sim.contact.surface_and_grip import ContactOptions, ContactSurface, State
from sim.device import Device, on_host
from sim.material.elastic_body import ElasticBody
from sim.material.laws.law_and_lame import Law
from sim.material.relaxation import PronySeries
from sim.mesh.cached_tet_mesh import TetMesh
from sim.mesh.clamping_and_sparsity import discretise
from sim.mesh.elements import ElementOrder
from tacauchy_rig.core.arrays import FloatArray


class Model:
    """A clamped pad of one element type and law, ready to be pressed: its gel and its surface.

    Args:
        young_pa: E [Pa] of every tetrahedron, or one number for all.
        prony: How the gel relaxes, if it does; E is then that of slow loading.

    Attributes:
        discretisation: Nodes, elements and surface.
        young_pa: E of the layer that is touched [Pa], the scale of the contact's stiffness: a
            softer one would leave the barrier's pressure on a stiff skin short of what it needs.
        height_m: Of the highest node at rest [m].
        volume_m3: Of the tetrahedra at rest [m^3].
        energy_scale_j: E times volume summed over the tetrahedra [J]; energies are rounded to
            about 1e-16 of it.
        surface: Its contact on the device, and what that remembers of friction.
        materials: E [Pa] and nu of every tetrahedron.
    """

    def __init__(
        self,
        mesh: TetMesh,
        *,
        order: ElementOrder,
        law: Law,
        young_pa: float | FloatArray,
        poisson: float | FloatArray,
        contact_options: ContactOptions | None = None,
        prony: PronySeries | None = None,
        device: str = "cpu",
    ) -> None:
        self.mesh, self.law, self.device = mesh, law, device
        self.contact_options = contact_options or ContactOptions()
        pad = discretise(mesh, order=order, many_points=self.contact_options.many_points)
        self.discretisation = pad
        self.reference, self.pattern = pad.reference, pad.pattern
        self.nodes, self.elements, self.clamped = pad.nodes, pad.elements, pad.clamped
        self.faces, self.face_parents = pad.faces, pad.face_parents
        young = np.broadcast_to(np.asarray(young_pa, np.float64), len(mesh.tets))
        ratio = np.broadcast_to(np.asarray(poisson, np.float64), len(mesh.tets))
        self.young_pa = float(young[pad.touched_element])
        self.poisson = float(ratio[pad.touched_element])
        self.volume_m3 = float(pad.volumes.sum())
        self.height_m = float(pad.nodes[:, 2].max())
        self.energy_scale_j = float(young @ pad.volumes)
        self._device = on = Device(device)
        self.gel = ElasticBody(pad, law=law, young_pa=young, poisson=ratio, prony=prony, device=on)
        self.surface = ContactSurface(pad, self.contact_options, young_pa=self.young_pa, device=on)
        self.relaxation = self.gel.relaxation
        self.materials, self._prony = (young, ratio), prony

    def on(self, device: str) -> Model:
        """Return the same model on another device."""
        return self if device == self.device else self._again(self.materials[0], device)

    def stiffer(self, factor: float) -> Model:
        """Return the same pad of a gel, all of its layers, that is so many times as stiff."""
        return self._again(factor * self.materials[0], self.device)

    def _again(self, young_pa: FloatArray, device: str) -> Model:
        return Model(
            self.mesh,
            order=self.reference.order,
            law=self.law,
            young_pa=young_pa,
            poisson=self.materials[1],
            contact_options=self.contact_options,
            prony=self._prony,
            device=device,
        )

    def rest_state(self, *, tip: FloatArray, rotation: FloatArray | None = None) -> State:
        """Return the undeformed state with the indenter's tip at ``tip`` [m]."""
        turned = np.eye(3) if rotation is None else np.array(rotation, dtype=np.float64)
        return State(
            positions=self.nodes.copy(),
            tip=np.array(tip, dtype=np.float64),
            rotation=turned,
            grip=self.surface.free_grip(self.nodes, tip, turned),
        )

    def hessian_data(
        self, positions: FloatArray, stiffness: FloatArray, *, projected: bool
    ) -> FloatArray:
        """Return the CSR values of the Newton matrix [N/m], if ``projected`` semidefinite."""
        values = self._device.zeros(len(self.pattern.block_keys), wp.mat33d)
        self.gel.add_hessian(positions, values, projected=projected)
        self.surface.add_hessian(stiffness, values)
        return np.asarray(on_host(values).reshape(-1)[self.pattern.gather])

    def rest_hessian_data(self) -> FloatArray:
        """Return the undeformed pad's CSR values [N/m]: a shift that is stiff in every direction.

        Collapsed elements have no stiffness at all, so that no multiple of theirs would do.
        """
        free = np.zeros((*self.surface.areas.shape, 3, 3))
        return self.hessian_data(self.nodes, free, projected=self.relaxation is not None)
