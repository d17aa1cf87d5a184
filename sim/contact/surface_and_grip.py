"""The surface that may be touched: its contact with one indenter, its grip, and a press's state."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import warp as wp

from sim.contact.barrier_and_friction_kernels import (
    BatchKernels,
    ContactKernels,
    GripArrays,
    Pressed,
    TouchedSurface,
    batch_contact_kernels,
    contact_kernels,
    hessian,
)
from sim.contact.indenter_distance import body_of, poses_at
from sim.device import Device, filled, on_host, replaced
from sim.mesh.clamping_and_sparsity import Discretisation
from sim.scene.indenter import Indenter
from tacauchy_rig.core.arrays import FloatArray

# A height map takes what is no farther from the indenter for touching.
_OVERLOOKED_M = 5e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactOptions:
    """Settings of contact."""

    distance_m: float = 1.0e-5  # d_hat [m]: the barrier acts from here on
    bonded: bool = False
    friction: float = 0.0  # Coulomb coefficient mu; zero without friction
    slip_m: float = 1.0e-6  # tangential offset at which sticking has become sliding [m]
    # Share of d_hat below which the barrier is a parabola, at most. At 1 it is one altogether,
    # which Newton likes best, and gaps stay positive while the pressure is below kappa / d_hat.
    extension: float = 0.5
    stiffness: float = 8.0  # kappa over E d_hat
    overlap: float = 0.0  # over d_hat, that a point may have where the barrier is all parabola
    many_points: bool = False  # 48 contact points a face, where a corner would cut between 12

    @property
    def is_tangential(self) -> bool:
        """Points that touch resist motion along the indenter."""
        return self.bonded or self.friction > 0.0

    @property
    def is_wide(self) -> bool:
        """The gel stays about d_hat off the indenter, and that is too far to be overlooked."""
        return self.extension >= 1.0 and self.distance_m > _OVERLOOKED_M

    def gap_least_m(self, extension: float) -> float:
        """Return the gap below which a point needs a barrier that is extended less [m]."""
        return (extension if extension < 1.0 else -self.overlap) * self.distance_m


@dataclass(slots=True, kw_only=True)
class Grip:
    """What tangential contact remembers of every contact point, shape [face_count, point_count]."""

    # 1 where a point touches, or, while a step is under way in which it came to, the share of its
    # path that it has touched for; 0 where it is free
    held: FloatArray
    # Where on the indenter it holds on, in the indenter's frame [m], shape [..., 3]; where it was
    # last, for one that is free
    anchors: FloatArray
    loads: FloatArray  # lagged pressure along the indenter's normal, in its frame [Pa], [..., 3]


@dataclass(slots=True, kw_only=True)
class State:
    """What changes during a press."""

    positions: FloatArray  # deformed nodes [m], shape [node_count, 3]
    tip: FloatArray  # the indenter's tip [m], shape [3]
    rotation: FloatArray  # indenter frame to pad frame, shape [3, 3]
    grip: Grip | None = None
    extension: float = 0.3  # share of d_hat below which the barrier is a parabola, or less

    def copy(self) -> State:
        """Return an independent copy."""
        return deepcopy(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactForces:
    """Contact at every quadrature point of the surface, shape [face_count, point_count, ...]."""

    points: FloatArray  # positions [m]
    gaps: FloatArray  # to the indenter [m]; of triangles beyond d_hat it may be less
    forces: FloatArray  # force on the indenter [N]
    stiffness: FloatArray  # of the force to motion, as if the indenter were flat there [N/m]


_GRIP = [field.name for field in fields(Grip)]


class ContactSurface:
    """A pad's outer faces with their contact points.

    Its methods that take a state serve one press; ``of`` is for kernels over many environments.

    Args:
        young_pa: E of the layer that is touched [Pa], the scale of the contact's stiffness.
    """

    def __init__(
        self, pad: Discretisation, options: ContactOptions, *, young_pa: float, device: Device
    ) -> None:
        self._pad, self._options, self._device = pad, options, device
        self._shape = (len(pad.faces), len(pad.reference.face_weights))
        self._slots = device.array(pad.pattern.slots(pad.faces), wp.int32)
        areas = pad.face_areas[:, None] * pad.reference.face_weights
        self._surface = filled(
            TouchedSurface,
            faces=device.array(pad.faces, wp.int32),
            values=device.array(pad.reference.face_values, wp.float64),
            areas=device.array(areas, wp.float64),
            distance=options.distance_m,
            slip=options.slip_m,
            bonded=options.bonded,
        )
        self._surface = self.of([young_pa], [options.friction])

    def of(
        self,
        young_pa: Sequence[float] | FloatArray,
        friction: Sequence[float] | FloatArray,
        stiffness: FloatArray | None = None,
    ) -> Any:
        """Return the surface for environments that differ in E [Pa], mu, and kappa over E d_hat."""
        usual = np.full(len(young_pa), self._options.stiffness)
        extensions = np.full(len(young_pa), self._options.extension)
        return replaced(
            TouchedSurface,
            self._surface,
            young=self._device.array(young_pa, wp.float64),
            friction=self._device.array(friction, wp.float64),
            stiffness=self._device.array(usual if stiffness is None else stiffness, wp.float64),
            extensions=self._device.array(extensions, wp.float64),
        )

    @property
    def areas(self) -> FloatArray:
        """Rest area of every contact point [m^2], shape [face_count, point_count]."""
        return on_host(self._surface.areas)

    def points(self, positions: FloatArray) -> FloatArray:
        """Return the contact points of nodes [m], shape [face_count, point_count, 3]."""
        return np.asarray(self._pad.reference.face_values @ positions[self._pad.faces])

    def free_grip(
        self, positions: FloatArray, tip: FloatArray, rotation: FloatArray
    ) -> Grip | None:
        """Return the memory of a surface that nothing has touched; None if nothing is kept.

        Nodes [m] are of shape [node_count, 3], the indenter's tip [m] of shape [3], its rotation to
        the pad's frame of shape [3, 3].
        """
        if not self._options.is_tangential:
            return None
        return Grip(
            held=np.zeros(self._shape),
            anchors=(self.points(positions) - tip) @ rotation,
            loads=np.zeros((*self._shape, 3)),
        )

    def gaps(self, positions: FloatArray, indenter: Indenter, state: State) -> FloatArray:
        """Return the gaps as ``ContactForces`` has them."""
        return self.forces(positions, indenter, state).gaps

    def energy(self, positions: FloatArray, indenter: Indenter, state: State) -> float:
        """Return the contact energy [J]."""
        buffers = self.buffers(1)
        inputs = [self.pressed(positions, indenter, state), self._device.array([1], wp.int32)]
        self._device.launch(self.kernels.touch, (1, *self._shape), inputs, list(buffers))
        return float(on_host(buffers[1]).sum())

    def forces(
        self, positions: FloatArray, indenter: Indenter, state: State, *, least: float = 0.0
    ) -> ContactForces:
        """Return the contact at every point.

        Args:
            least: Stiffness along a sliding point's way, over that across it, at least.
        """
        return self.forces_of(self.pressed(positions, indenter, state), least=least)

    def forces_of(self, pressed: Any, *, least: float = 0.0) -> ContactForces:
        """Return the same of what is ``Pressed`` on the device."""
        out = [self._points(kind) for kind in (wp.vec3d, wp.float64, wp.vec3d, wp.mat33d)]
        self._device.launch(self.kernels.force, (1, *self._shape), [pressed, least], out)
        points, gaps, forces, stiffness = (on_host(array)[0] for array in out)
        return ContactForces(points=points, gaps=gaps, forces=forces, stiffness=stiffness)

    def buffers(self, count: int) -> tuple[Any, ...]:
        """Return buffers for so many environments' nodal forces [N], energies [J] and gaps [m]."""
        nodal = self._device.zeros((count, len(self._pad.nodes)), wp.vec3d)
        return nodal, *(self._points(wp.float64, count) for _ in range(2))

    def add_hessian(self, stiffness: FloatArray, values: Any) -> None:
        """Add the contact points' stiffness [N/m] to the matrix's blocks."""
        inputs = [self._slots, self._surface.values, self._device.array(stiffness, wp.mat33d)]
        self._device.launch(hessian, self._slots.shape[:2], inputs, [values])

    def scatter(self, point_vectors: FloatArray) -> FloatArray:
        """Sum vectors at contact points to the nodes, shape [node_count, 3]."""
        shares = np.einsum("fpi,pk->fki", point_vectors, self._pad.reference.face_values)
        found = np.zeros((len(self._pad.nodes), 3))
        np.add.at(found, self._pad.faces, shares)
        return found

    def area_vectors(self, positions: FloatArray) -> FloatArray:
        """Return outward normal times area at every contact point [m^2], shape [f, p, 3]."""
        return self._pad.reference.area_vectors(positions[self._pad.faces])

    def refresh_grip(self, indenter: Indenter, state: State) -> None:
        """Hold the points that touch, free the others, and take over pressure and normal."""
        if state.grip is not None:
            buffers = [*self.buffers(1)[:2], *(self._points(wp.float64) for _ in range(2))]
            start = [self.grip_arrays(state.grip)]
            self._regrip(self.kernels.hold, indenter, state, start, buffers)

    def drag_anchors(self, indenter: Indenter, state: State) -> None:
        """Let the anchors of sliding points follow; the state is then one to go on from."""
        if state.grip is not None and not self._options.bonded:
            self._regrip(self.kernels.drag, indenter, state, [], [])

    def _regrip(
        self, kernel: Any, indenter: Indenter, state: State, start: list[Any], out: list[Any]
    ) -> None:
        pressed = self.pressed(state.positions, indenter, state)
        inputs = [pressed, self._device.array([1], wp.int32), *start]
        self._device.launch(kernel, (1, *self._shape), inputs, out)
        state.grip = self.grip_of(pressed.grip)

    def grip_arrays(self, grip: Grip | None, count: int = 1) -> Any:
        """Return a memory on the device, of one press or so many free ones; tiny without grip."""
        if grip is not None:
            held = {name: getattr(grip, name)[None] for name in _GRIP}
            return self._device.tables(GripArrays, held)
        shape = (count, *self._shape) if self._options.is_tangential else (1, 1, 1)
        return self._device.zeroed(GripArrays, shape)

    def grip_of(self, arrays: Any) -> Grip | None:
        """Return the first environment's memory from the device; None where nothing is kept."""
        if not self._options.is_tangential:
            return None
        return Grip(**{name: on_host(getattr(arrays, name))[0].copy() for name in _GRIP})

    @property
    def kernels(self) -> ContactKernels:
        """The kernels for any indenter."""
        return contact_kernels(grips=self._options.is_tangential)

    @property
    def batch_kernels(self) -> BatchKernels:
        """Those of batches."""
        return batch_contact_kernels(grips=self._options.is_tangential)

    def _points(self, kind: Any, count: int = 1) -> Any:
        return self._device.empty((count, *self._shape), kind)

    def pressed(self, positions: FloatArray, indenter: Indenter, state: State) -> Any:
        """Return what is ``Pressed`` on the device, for nodes [m] that a state may not have."""
        extensions = self._device.array([state.extension], wp.float64)
        return filled(
            Pressed,
            surface=replaced(TouchedSurface, self._surface, extensions=extensions),
            bodies=body_of(indenter, device=self._device.name),
            poses=poses_at(state.tip[None], state.rotation[None], self._device),
            grip=self.grip_arrays(state.grip),
            positions=self._device.array(positions[None], wp.vec3d),
        )
