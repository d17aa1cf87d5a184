"""Model (what is fixed) and State (what changes) of one pad, on one device."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim import contact, elasticity, friction
from sim.arrays import FloatArray, IntArray
from sim.assembly import SparsePattern, sparse_pattern
from sim.contact_body import body_at
from sim.elements import (
    ElementOrder,
    ReferenceElement,
    boundary_faces,
    quadratic_nodes,
    reference_element,
)
from sim.indenter import Indenter
from sim.laws.tangent import Law, Tangent
from sim.mesh import TetMesh
from sim.prony import PronySeries
from sim.relaxation import Relaxation
from sim.state import ContactForces, ContactOptions, Grip, State
from tacauchy_rig.errors import ConfigError

# Relative rounding of what the kernels compute; the host computes in float64.
KERNEL_EPSILON = float(np.finfo(wp.dtype_to_numpy(wp.float64)).eps)  # type: ignore[no-untyped-call]


class Model:
    """A clamped pad of one element type and law, ready to be pressed.

    Args:
        young_pa: E [Pa] of every tetrahedron, or one number for all.
        poisson: nu of every tetrahedron, or one number for all.
        prony: How the gel relaxes, if it does; E is then that of slow loading.
        device: Warp device, ``cpu`` or ``cuda:0``.

    Attributes:
        young_pa: E of the layer that is touched [Pa], the scale of the contact's stiffness: a
            softer one would leave the barrier's pressure on a stiff skin short of what it needs.
        poisson: nu of that layer.
        height_m: Of the highest node at rest [m].
        energy_scale_j: E times volume summed over the tetrahedra [J]; energies are rounded to
            about 1e-16 of it.
        elastic_rounding_n: About how much the gel's nodal forces change, in norm, when every
            coordinate is rounded [N].
        relaxation: What the gel remembers; None for an elastic one.
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
        self.mesh = mesh
        self.law = law
        self._young_pa = np.broadcast_to(np.asarray(young_pa, np.float64), len(mesh.tets))
        self._poisson = np.broadcast_to(np.asarray(poisson, np.float64), len(mesh.tets))
        self.contact_options = contact_options or ContactOptions()
        self.device = device
        self.reference: ReferenceElement = reference_element(
            order, face_splits=self.contact_options.face_splits
        )
        if order is ElementOrder.P2:
            self.nodes, self.elements = quadratic_nodes(mesh.vertices, mesh.tets)
        else:
            self.nodes, self.elements = mesh.vertices, mesh.tets
        faces, parents = boundary_faces(self.elements)
        self.clamped = self.nodes[:, 2] <= 1e-6 * mesh.vertices[:, 2].max()
        held = mesh.fold.on_plane(self.nodes, float(np.abs(mesh.vertices).max()))
        outer = ~self.clamped[faces[:, :3]].all(axis=1)
        outer &= ~np.any(held[faces[:, :3]].all(axis=1), axis=1)
        self.faces, self.face_parents = faces[outer], parents[outer]
        heights = self.nodes[self.faces[:, :3], 2].mean(axis=1)
        touched = self.face_parents[np.argmax(heights)]
        self.young_pa = float(self._young_pa[touched])
        self.poisson = float(self._poisson[touched])
        fixed = held | self.clamped[:, None]
        self.pattern: SparsePattern = sparse_pattern(self.elements, fixed)
        self._kernels = elasticity.elastic_kernels(law)
        self._upload()
        self.relaxation = (
            None if prony is None else Relaxation(law, self._element_arrays, prony, self.nodes)
        )

    def rest_state(self, *, tip: FloatArray, rotation: FloatArray | None = None) -> State:
        """Return the undeformed state with the indenter's tip at ``tip`` [m]."""
        shape = (len(self.faces), len(self.reference.face_weights))
        grip = Grip(
            held=np.zeros(shape, dtype=np.int32),
            anchors=np.zeros((*shape, 3)),
            loads=np.zeros((*shape, 3)),
        )
        return State(
            positions=self.nodes.copy(),
            tip=np.array(tip, dtype=np.float64),
            rotation=np.eye(3) if rotation is None else np.array(rotation, dtype=np.float64),
            grip=grip if self.contact_options.is_tangential else None,
        )

    def elastic_energy(self, positions: FloatArray) -> tuple[float, float]:
        """Return the elastic energy [J] and the smallest volume ratio J."""
        energies, ratios = self._points(wp.float64), self._points(wp.float64)
        at = self._vectors(positions)
        inputs = [*self._loaded_arrays, at]
        self._launch(self._kernels.energy, self._point_shape, inputs, [energies, ratios])
        if self.relaxation is not None:
            self.relaxation.add_energy(at, energies)
        return float(_numpy(energies).sum()), float(_numpy(ratios).min())

    def elastic_gradient(self, positions: FloatArray) -> FloatArray:
        """Return the gradient of the elastic energy [N], shape [node_count, 3]."""
        out = wp.zeros(len(self.nodes), dtype=wp.vec3d, device=self.device)
        at = self._vectors(positions)
        self._launch(self._kernels.gradient, self._point_shape, [*self._loaded_arrays, at], [out])
        if self.relaxation is not None:
            self.relaxation.add_gradient(at, out)
        return _numpy(out)

    def cauchy_stress(self, positions: FloatArray) -> FloatArray:
        """Return the Cauchy stress [Pa], shape [element_count, point_count, 3, 3] (Eq. 3)."""
        out = self._points(wp.mat33d)
        nodes, gradients, inverse, _, parameters = self._element_arrays
        at = self._vectors(positions)
        inputs = [nodes, gradients, inverse, parameters, at]
        self._launch(self._kernels.stress, self._point_shape, inputs, [out])
        if self.relaxation is not None:
            self.relaxation.add_stress(at, out)
        return _numpy(out)

    def stress_at(self, deformations: FloatArray, elements: IntArray) -> FloatArray:
        """Return the elastic Cauchy stress of given deformation gradients [Pa].

        What the gel remembers is known at quadrature points only, and is left out.

        Args:
            deformations: F, shape [count, 3, 3].
            elements: Whose material, shape [count].

        Returns:
            Shape [count, 3, 3].
        """
        # A made-up element of three nodes, at F's columns, whose gradients are the unit vectors.
        count = len(deformations)
        corners = np.arange(3 * count, dtype=np.int32).reshape(count, 3)
        columns = np.swapaxes(deformations, 1, 2).reshape(-1, 3)
        out = wp.empty((count, 1), dtype=wp.mat33d, device=self.device)
        inputs = [
            self._array(corners, wp.int32),
            self._array(np.eye(3)[None], wp.vec3d),
            self._array(np.tile(np.eye(3), (count, 1, 1)), wp.mat33d),
            self._array(_numpy(self._element_arrays[4])[elements], wp.vec4d),
            self._vectors(columns),
        ]
        self._launch(self._kernels.stress, (count, 1), inputs, [out])
        return _numpy(out)[:, 0]

    def hessian_data(
        self, positions: FloatArray, stiffness: FloatArray, *, projected: bool
    ) -> FloatArray:
        """Return the CSR values of the Newton matrix [N/m].

        Args:
            stiffness: Contact stiffness of ``ContactForces``.
            projected: Make every point's tangent positive semidefinite.
        """
        shape = (*self._point_shape, self.reference.node_count)
        vectors = [wp.empty(shape, dtype=wp.vec3d, device=self.device) for _ in range(3)]
        tangents = self._points(Tangent)
        inputs = [*self._loaded_arrays, self._vectors(positions), projected]
        self._launch(self._kernels.tangent, self._point_shape, inputs, [tangents, *vectors])
        values = wp.zeros(self.pattern.block_count, dtype=wp.mat33d, device=self.device)
        self._launch(
            self._kernels.hessian,
            (len(self.elements), self.reference.node_count),
            [self._element_slots, tangents, *vectors],
            [values],
        )
        if self.relaxation is not None:
            self.relaxation.add_hessian(self._element_slots, values, projected=projected)
        self._launch(
            contact.hessian,
            (len(self.faces), self.reference.face_node_count),
            [self._face_slots, self._face_values, self._array(stiffness, wp.mat33d)],
            [values],
        )
        return self.pattern.csr_data(_numpy(values))

    def rest_hessian_data(self) -> FloatArray:
        """Return the undeformed pad's CSR values [N/m]: a shift that is stiff in every direction.

        Collapsed elements have no stiffness at all, so that no multiple of theirs would do.
        """
        free = np.zeros((*self._face_shape, 3, 3))
        return self.hessian_data(self.nodes, free, projected=self.relaxation is not None)

    def gaps(self, positions: FloatArray, indenter: Indenter, state: State) -> FloatArray:
        """Return the gap of every contact point [m], shape [face_count, point_count]."""
        out = self._face_points(wp.float64)
        body = body_at(indenter, state.tip, state.rotation, device=self.device)
        inputs = [*self._face_arrays, body, self._vectors(positions)]
        self._launch(contact.gap.of(indenter), self._face_shape, inputs, [out])
        return _numpy(out)

    def contact_energy(self, positions: FloatArray, indenter: Indenter, state: State) -> float:
        """Return the contact energy [J]."""
        out = self._face_points(wp.float64)
        inputs = self._contact_inputs(positions, indenter, state)
        self._launch(contact.energy.of(indenter), self._face_shape, inputs, [out])
        if state.grip is not None:
            inputs = self._grip_inputs(positions, indenter, state, state.grip)
            self._launch(friction.add_energy.of(indenter), self._face_shape, inputs, [out])
        return float(_numpy(out).sum())

    def contact_forces(
        self, positions: FloatArray, indenter: Indenter, state: State, *, curved: bool = True
    ) -> ContactForces:
        """Return the contact at every point of the surface.

        The stiffness is exact if ``curved``, else positive semidefinite.
        """
        out = [self._face_points(kind) for kind in (wp.vec3d, wp.vec3d, wp.mat33d)]
        inputs = [*self._contact_inputs(positions, indenter, state), curved]
        self._launch(contact.force.of(indenter), self._face_shape, inputs, out)
        if state.grip is not None:
            inputs = self._grip_inputs(positions, indenter, state, state.grip)
            self._launch(friction.add_force.of(indenter), self._face_shape, inputs, out[1:])
        points, forces, stiffness = (_numpy(array) for array in out)
        return ContactForces(points=points, forces=forces, stiffness=stiffness)

    def rounding_n(self, contact: ContactForces) -> float:
        """Return how much all nodal forces change by rounding [N]; no residual can be smaller."""
        stiffness = np.linalg.norm(contact.stiffness, axis=(2, 3))
        change = KERNEL_EPSILON * stiffness * np.abs(contact.points).max(axis=2)
        return float(np.hypot(self.elastic_rounding_n, np.linalg.norm(change)))

    def scatter(self, point_vectors: FloatArray) -> FloatArray:
        """Sum vectors at contact points to the nodes, shape [node_count, 3]."""
        out = wp.zeros(len(self.nodes), dtype=wp.vec3d, device=self.device)
        inputs = [*self._face_arrays, self._array(point_vectors, wp.vec3d)]
        self._launch(contact.scatter, self._face_shape, inputs, [out])
        return _numpy(out)

    def refresh_grip(self, indenter: Indenter, state: State) -> float:
        """Hold the points that touch, free the others, and take over pressure and normal.

        Returns:
            Change of the friction limit, summed over the points, over its new sum; zero where
            nothing is tangential or everything is bonded.
        """
        grip = state.grip
        if grip is None:
            return 0.0
        before = grip.loads
        out = [self._face_points(kind) for kind in (wp.vec3d, wp.vec3d, wp.mat33d)]
        inputs = [*self._contact_inputs(state.positions, indenter, state), True]
        self._launch(contact.force.of(indenter), self._face_shape, inputs, out)
        held, anchors = self._array(grip.held, wp.int32), self._array(grip.anchors, wp.vec3d)
        loads = self._face_points(wp.vec3d)
        inputs = [*self._grip_model(indenter, state), self._vectors(state.positions), out[1]]
        self._launch(
            friction.refresh.of(indenter), self._face_shape, inputs, [held, anchors, loads]
        )
        state.grip = Grip(
            held=_numpy(held).copy(), anchors=_numpy(anchors).copy(), loads=_numpy(loads).copy()
        )
        if self.contact_options.bonded:
            return 0.0
        areas = self.contact_areas
        change = areas * np.linalg.norm(state.grip.loads - before, axis=2)
        total = areas * np.linalg.norm(state.grip.loads, axis=2)
        return float(change.sum() / max(total.sum(), 1e-300))

    def drag_anchors(self, indenter: Indenter, state: State) -> None:
        """Let the anchors of sliding points follow; the state is then one to go on from."""
        grip = state.grip
        if grip is None or self.contact_options.bonded:
            return
        anchors = self._array(grip.anchors, wp.vec3d)
        faces, values, _, settings, body = self._grip_model(indenter, state)
        inputs = [faces, values, settings, body, self._vectors(state.positions)]
        inputs += [self._array(grip.held, wp.int32), self._array(grip.loads, wp.vec3d)]
        self._launch(friction.drag.of(indenter), self._face_shape, inputs, [anchors])
        grip.anchors = _numpy(anchors).copy()

    def deformed_area_vectors(self, positions: FloatArray) -> FloatArray:
        """Return outward normal times area at every contact point [m^2], shape [f, p, 3]."""
        along = np.einsum("pka,fkx->afpx", self.reference.face_gradients, positions[self.faces])
        normals = 0.5 * np.cross(along[0], along[1])
        return np.asarray(normals * self.reference.face_weights[:, None])

    @property
    def contact_areas(self) -> FloatArray:
        """Rest area of every contact point [m^2], shape [face_count, point_count]."""
        return _numpy(self._areas)

    @property
    def _loaded_arrays(self) -> list[Any]:
        """The element arrays, their weights stiffened by what relaxation adds in a step."""
        if self.relaxation is None:
            return self._element_arrays
        nodes, gradients, inverse, _, parameters = self._element_arrays
        return [nodes, gradients, inverse, self.relaxation.weights, parameters]

    def _upload(self) -> None:
        corners = self.nodes[self.elements[:, :4]]
        jacobians = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
        volumes = np.linalg.det(jacobians) / 6.0
        if volumes.min() <= 0.0:
            raise ConfigError(
                f"mesh has {int((volumes <= 0).sum())} tetrahedra of no positive volume",
                remedy="orient the tetrahedra or mesh the pad again",
            )
        self.volume_m3 = float(volumes.sum())
        self.height_m = float(self.nodes[:, 2].max())
        self.energy_scale_j = float(self._young_pa @ volumes)
        self.elastic_rounding_n = self._rounding_force(
            corners, np.asarray(np.linalg.inv(jacobians), dtype=np.float64), volumes
        )
        materials = np.column_stack([self._young_pa, self._poisson])
        distinct, material = np.unique(materials, axis=0, return_inverse=True)
        parameters = np.array([self.law.parameters(*constants) for constants in distinct.tolist()])
        self._element_arrays = [
            self._array(self.elements, wp.int32),
            self._array(self.reference.gradients, wp.vec3d),
            self._array(np.linalg.inv(jacobians), wp.mat33d),
            self._array(volumes[:, None] * self.reference.weights, wp.float64),
            self._array(parameters[material.reshape(-1)], wp.vec4d),
        ]
        self._point_shape = (len(self.elements), len(self.reference.weights))
        self._face_shape = (len(self.faces), len(self.reference.face_weights))
        self._element_slots = self._array(self.pattern.slots(self.elements), wp.int32)
        self._face_slots = self._array(self.pattern.slots(self.faces), wp.int32)
        self._face_values = self._array(self.reference.face_values, wp.float64)
        self._face_arrays = [self._array(self.faces, wp.int32), self._face_values]
        a, b, c = (self.nodes[self.faces[:, k]] for k in range(3))
        areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        self._areas = self._array(areas[:, None] * self.reference.face_weights, wp.float64)

    def _rounding_force(
        self, corners: FloatArray, inverses: FloatArray, volumes: FloatArray
    ) -> float:
        mu, lam = self._young_pa / (2.0 * (1.0 + self._poisson)), self._poisson * self._young_pa
        lam = lam / ((1.0 + self._poisson) * (1.0 - 2.0 * self._poisson))
        stiffness = (lam + 2.0 * mu) * volumes * (inverses**2).sum(axis=(1, 2))
        reach = np.abs(corners).max(axis=(1, 2))
        return float(KERNEL_EPSILON * np.linalg.norm(stiffness * reach))

    def _settings_of(self, state: State) -> Any:
        options = self.contact_options
        return contact.contact_settings(
            distance_m=options.distance_m,
            stiffness_j_m2=options.stiffness_factor * self.young_pa * options.distance_m,
            extension=state.extension,
        )

    def _contact_inputs(self, positions: FloatArray, indenter: Indenter, state: State) -> list[Any]:
        return [
            *self._face_arrays,
            self._areas,
            self._settings_of(state),
            body_at(indenter, state.tip, state.rotation, device=self.device),
            self._vectors(positions),
        ]

    def _grip_model(self, indenter: Indenter, state: State) -> list[Any]:
        options = self.contact_options
        settings = friction.grip_settings(
            reach_m=options.distance_m,
            stiffness_pa_m=self.young_pa / options.distance_m if options.bonded else 0.0,
            coefficient=options.friction,
            slip_m=options.slip_m,
        )
        body = body_at(indenter, state.tip, state.rotation, device=self.device)
        return [*self._face_arrays, self._areas, settings, body]

    def _grip_inputs(
        self, positions: FloatArray, indenter: Indenter, state: State, grip: Grip
    ) -> list[Any]:
        return [
            *self._grip_model(indenter, state),
            self._vectors(positions),
            self._array(grip.held, wp.int32),
            self._array(grip.anchors, wp.vec3d),
            self._array(grip.loads, wp.vec3d),
        ]

    def _launch(
        self, kernel: Any, shape: tuple[int, ...], inputs: list[Any], outputs: list[Any]
    ) -> None:
        wp.launch(kernel, dim=shape, inputs=inputs, outputs=outputs, device=self.device)

    def _array(self, values: Any, kind: Any) -> Any:
        return wp.array(np.ascontiguousarray(values), dtype=kind, device=self.device)

    def _vectors(self, positions: FloatArray) -> Any:
        return self._array(positions, wp.vec3d)

    def _points(self, kind: Any) -> Any:
        return wp.empty(self._point_shape, dtype=kind, device=self.device)

    def _face_points(self, kind: Any) -> Any:
        return wp.empty(self._face_shape, dtype=kind, device=self.device)


def _numpy(array: Any) -> NDArray[Any]:
    """Return a device array on the host, its reals as float64; on the CPU this shares memory."""
    host = array.numpy()
    return np.asarray(host, dtype=np.float64 if host.dtype.kind == "f" else host.dtype)
