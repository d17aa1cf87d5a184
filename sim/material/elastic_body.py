"""The gel on a device: its elastic energy with gradient, Hessian and stress, by one law."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from sim.device import KERNEL_EPSILON, Device, filled, on_host, replaced
from sim.material import elasticity_kernels as kernels
from sim.material.laws.law_and_lame import Law, Tangent, lame
from sim.material.relaxation import PronySeries, Relaxation
from sim.mesh.cached_tet_mesh import TetMesh
from sim.mesh.clamping_and_sparsity import Discretisation
from sim.scene.material import Material
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tacauchy_rig.core.errors import ConfigError


def element_constants(
    mesh: TetMesh, materials: Sequence[Material]
) -> tuple[FloatArray, FloatArray]:
    """Return E [Pa] and nu of every tetrahedron, each of shape [tet_count].

    Raises:
        ConfigError: The mesh was not made for as many layers.
    """
    found = int(mesh.labels.max()) + 1
    if found != len(materials):
        raise ConfigError(
            f"mesh {mesh.name!r} has {found} layers, the gel {len(materials)}",
            remedy="mesh the pad again for this gel",
        )
    constants = np.array([(each.young_pa, each.poisson) for each in materials])[mesh.labels]
    return constants[:, 0], constants[:, 1]


class ElasticBody:
    """A pad's tetrahedra with their materials.

    Args:
        young_pa: E of every tetrahedron [Pa].
        prony: How the gel relaxes, if it does; E is then that of slow loading.

    Attributes:
        rounding_n: About how much the nodal forces change, in norm, when every coordinate is
            rounded [N].
    """

    def __init__(
        self,
        pad: Discretisation,
        *,
        law: Law,
        young_pa: FloatArray,
        poisson: FloatArray,
        prony: PronySeries | None,
        device: Device,
    ) -> None:
        self._device = device
        self._law, self._reference, self._remembers = law, pad.reference, prony is not None
        self._node_count = len(pad.nodes)
        self._shape = (len(pad.elements), len(pad.reference.weights))
        self._arrays = filled(
            kernels.GelArrays,
            nodes=device.array(pad.elements, wp.int32),
            reference_gradients=device.array(pad.reference.gradients, wp.vec3d),
            inverse_jacobians=device.array(pad.inverse_jacobians, wp.mat33d),
            weights=device.array(pad.volumes[:, None] * pad.reference.weights, wp.float64),
            parameters=device.array(_parameters(law, young_pa, poisson)[None], wp.vec4d),
            stiffening=device.array(np.ones(len(pad.elements)), wp.float64),
            history=device.zeros(self._shape if self._remembers else (1, 1), wp.mat33d),
        )
        self._slots = device.array(pad.pattern.slots(pad.elements), wp.int32)
        mu, lam = lame(young_pa, poisson)
        stiffness = (lam + 2.0 * mu) * pad.volumes * (pad.inverse_jacobians**2).sum(axis=(1, 2))
        reach = np.abs(pad.nodes[pad.elements[:, :4]]).max(axis=(1, 2))
        self.rounding_n = float(KERNEL_EPSILON * np.linalg.norm(stiffness * reach))
        self.relaxation = (
            None if prony is None else Relaxation(law, self._arrays, prony, pad.nodes, device)
        )

    def energy(self, positions: FloatArray) -> tuple[float, float]:
        """Return the elastic energy [J] and the smallest volume ratio J."""
        _, energies, ratios = self._evaluated(positions)
        return float(on_host(energies).sum()), float(on_host(ratios).min())

    def gradient(self, positions: FloatArray) -> FloatArray:
        """Return the gradient of the elastic energy [N], shape [node_count, 3]."""
        return np.asarray(on_host(self._evaluated(positions)[0])[0])

    def of(self, materials: Sequence[tuple[FloatArray, FloatArray]]) -> Any:
        """Return the elements for environments that differ in E [Pa] and nu.

        Those are given for every tetrahedron, or as one number each for all, by environment.
        """
        count = self._shape[0]
        found = {  # many environments may share what is given
            key: _parameters(self._law, *(np.broadcast_to(each, count) for each in constants))
            for key, constants in {id(each): each for each in materials}.items()
        }
        parameters = self._device.array([found[id(each)] for each in materials], wp.vec4d)
        return replaced(kernels.GelArrays, self._arrays, parameters=parameters)

    def buffers(self, count: int) -> tuple[Any, Any, Any]:
        """Return buffers for environments' gradients [N], energies [J] and volume ratios."""
        device, shape = self._device, (count, self._shape[0])
        energies, ratios = (device.empty(shape, wp.float64) for _ in range(2))
        return device.zeros((count, self._node_count), wp.vec3d), energies, ratios

    def recorded(
        self, wanted: Any, positions: Any, buffers: Sequence[Any], *, gel: Any = None
    ) -> Any:
        """Return a launch that adds to the gradient and sets energies and volume ratios.

        Args:
            wanted: 1 for environments to evaluate, on the device.
            positions: Nodes [m], on the device, shape [environment_count, node_count].
            gel: What ``of`` gave; None is this one.
        """
        kernel = kernels.element_kernel(self._law, self._reference.order, remembers=self._remembers)
        shape = (positions.shape[0], self._shape[0])
        inputs = [gel or self._arrays, wanted, positions]
        return self._device.record(kernel, shape, [*inputs, *buffers])

    def _evaluated(self, positions: FloatArray) -> tuple[Any, Any, Any]:
        buffers, wanted = self.buffers(1), self._device.array([1], wp.int32)
        self.recorded(wanted, self._device.array(positions[None], wp.vec3d), buffers).launch()
        return buffers

    def add_hessian(self, positions: FloatArray, values: Any, *, projected: bool) -> None:
        """Add the second derivative [N/m] to the matrix's blocks, if asked made semidefinite."""
        inputs = [self._arrays, self._device.array(positions, wp.vec3d), projected]
        kernel = kernels.tangent_kernel(self._law, remembers=self._remembers)
        self._device.launch(kernel, self._shape, inputs, self._tangents)
        inputs = [self._arrays, self._slots, *self._tangents]
        self._device.launch(kernels.hessian, self._slots.shape[:2], inputs, [values])

    def cauchy_stress(self, positions: FloatArray) -> FloatArray:
        """Return the Cauchy stress [Pa], shape [element_count, point_count, 3, 3] (Eq. 3)."""
        at, out = self._device.array(positions[None], wp.vec3d), self.stress_buffer(1)
        self.find_stress(at, out)
        return np.asarray(on_host(out)[0])

    def stress_buffer(self, count: int) -> Any:
        """Return what ``find_stress`` fills for so many environments."""
        return self._device.empty((count, *self._shape), wp.mat33d)

    def find_stress(self, positions: Any, stress: Any, *, gel: Any = None) -> None:
        """Set the Cauchy stress on the device [Pa] (Eq. 3).

        Args:
            positions: Nodes [m], on the device, shape [environment_count, node_count].
            stress: Shape [environment_count, element_count, point_count].
            gel: What ``of`` gave; None is this one.
        """
        kernel = kernels.stress_kernel(self._law, remembers=self._remembers)
        self._device.launch(kernel, stress.shape, [gel or self._arrays, positions], [stress])

    def stress_at(self, deformations: FloatArray, elements: IntArray) -> FloatArray:
        """Return the elastic Cauchy stress [Pa] of deformation gradients, shape [count, 3, 3] each.

        What the gel remembers is known at quadrature points only, and is left out; ``elements``
        says whose material each is of.
        """
        # A made-up element of three nodes, at F's columns, whose gradients are the unit vectors.
        count = len(deformations)
        corners = np.arange(3 * count, dtype=np.int32).reshape(count, 3)
        columns = np.swapaxes(deformations, 1, 2).reshape(1, -1, 3)
        out = self._device.empty((1, count, 1), wp.mat33d)
        made_up = filled(
            kernels.GelArrays,
            nodes=self._device.array(corners, wp.int32),
            reference_gradients=self._device.array(np.eye(3)[None], wp.vec3d),
            inverse_jacobians=self._device.array(np.tile(np.eye(3), (count, 1, 1)), wp.mat33d),
            parameters=self._device.array(on_host(self._arrays.parameters)[:, elements], wp.vec4d),
        )
        kernel = kernels.stress_kernel(self._law, remembers=False)
        inputs = [made_up, self._device.array(columns, wp.vec3d)]
        self._device.launch(kernel, out.shape, inputs, [out])
        return on_host(out)[0, :, 0]

    @cached_property
    def _tangents(self) -> list[Any]:
        """Tangents and history at the points: arrays that are kept, to be filled anew."""
        history = self._device.zeros(self._shape if self._remembers else (0, 0), wp.mat33d)
        return [self._device.empty(self._shape, Tangent), history]


def _parameters(law: Law, young_pa: FloatArray, poisson: FloatArray) -> FloatArray:
    """Return the law's numbers of every tetrahedron, shape [tet_count, 4]."""
    distinct, material = np.unique(young_pa + 1j * poisson, return_inverse=True)
    parameters = np.array([law.parameters(each.real, each.imag) for each in distinct.tolist()])
    return parameters[material.reshape(-1)]
