"""The surface that may be touched, on a device: its contact with one indenter, and its grip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from sim.arrays import FloatArray
from sim.contact import barrier, friction
from sim.contact.contact_kernels import ContactKernels, contact_kernels
from sim.contact.indenter_distance import body_at, body_kind
from sim.contact.state import ContactForces, ContactOptions, Grip, State
from sim.device import KERNEL_EPSILON, Device, filled, on_host, replaced
from sim.mesh.discretisation import Discretisation
from sim.scene.indenter import Indenter


class ContactSurface:
    """A pad's outer faces with their contact points.

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
        # Kernels that know of no grip read nothing of it; the others read it at every point.
        read = self._shape if options.is_tangential else (1, 1)
        self._no_grip = filled(
            friction.GripArrays,
            held=device.zeros(read, wp.int32),
            anchors=device.zeros(read, wp.vec3d),
            loads=device.zeros(read, wp.vec3d),
        )
        self._surface = filled(
            barrier.TouchedSurface,
            faces=device.array(pad.faces, wp.int32),
            values=device.array(pad.reference.face_values, wp.float64),
            areas=device.array(areas, wp.float64),
            distance=options.distance_m,
            stiffness=options.stiffness_factor * young_pa * options.distance_m,
            bond=young_pa / options.distance_m if options.bonded else 0.0,
            friction=options.friction,
            slip=options.slip_m,
        )

    @property
    def areas(self) -> FloatArray:
        """Rest area of every contact point [m^2], shape [face_count, point_count]."""
        return on_host(self._surface.areas)

    def free_grip(self) -> Grip | None:
        """Return the memory of a surface that nothing has touched; None if nothing is kept."""
        if not self._options.is_tangential:
            return None
        return Grip(
            held=np.zeros(self._shape, dtype=np.int32),
            anchors=np.zeros((*self._shape, 3)),
            loads=np.zeros((*self._shape, 3)),
        )

    def gaps(self, positions: FloatArray, indenter: Indenter, state: State) -> FloatArray:
        """Return the gap of every contact point [m], shape [face_count, point_count]."""
        out = self._points(wp.float64)
        inputs = [*self._at(indenter, state), self._device.vectors(positions)]
        self._device.launch(self._kernels(indenter).gap, self._shape, inputs, [out])
        return on_host(out)

    def energy(self, positions: FloatArray, indenter: Indenter, state: State) -> float:
        """Return the contact energy [J]."""
        room = self.room()
        self.recorded(self._device.vectors(positions), room, indenter, state).launch()
        return float(on_host(room[2]).sum())

    def forces(
        self, positions: FloatArray, indenter: Indenter, state: State, *, curved: bool = True
    ) -> ContactForces:
        """Return the contact at every point; its stiffness is exact, or semidefinite."""
        out = [self._points(kind) for kind in (wp.vec3d, wp.vec3d, wp.mat33d)]
        at = self._device.vectors(positions)
        inputs = [*self._at(indenter, state), self.grip_arrays(state.grip), at, curved]
        self._device.launch(self._kernels(indenter).force, self._shape, inputs, out)
        points, forces, stiffness = (on_host(array) for array in out)
        return ContactForces(points=points, forces=forces, stiffness=stiffness)

    def room(self) -> tuple[Any, ...]:
        """Return what an evaluation fills: nodal forces [N], their sum, energies [J], gaps [m]."""
        zeros, points = self._device.zeros, self._points
        counts = len(self._pad.nodes), 1
        nodal, push = (zeros(count, wp.vec3d) for count in counts)
        return nodal, push, points(wp.float64), points(wp.float64)

    def recorded(
        self, positions: Any, room: Sequence[Any], indenter: Indenter, state: State
    ) -> Any:
        """Return a launch that adds to nodal forces and their sum, and sets energies and gaps.

        Its parameters ``surface``, ``body`` and ``grip`` are those of a state, and may be set anew.

        Args:
            positions: Nodes [m], on the device.
            room: What ``room`` gave.
        """
        inputs = [*self._at(indenter, state), self.grip_arrays(state.grip), positions]
        touch = self._kernels(indenter).touch
        return self._device.record(touch, self._shape, inputs, list(room))

    def stretched(self, extension: float) -> Any:
        """Return the surface with a barrier that is a parabola below a share of d_hat."""
        return replaced(barrier.TouchedSurface, self._surface, extension=extension)

    def add_hessian(self, stiffness: FloatArray, values: Any) -> None:
        """Add the contact points' stiffness [N/m] to the matrix's blocks."""
        self._device.launch(
            barrier.hessian,
            (self._shape[0], self._pad.reference.face_node_count),
            [self._slots, self._surface.values, self._device.array(stiffness, wp.mat33d)],
            [values],
        )

    def scatter(self, point_vectors: FloatArray) -> FloatArray:
        """Sum vectors at contact points to the nodes, shape [node_count, 3]."""
        out = self._device.zeros(len(self._pad.nodes), wp.vec3d)
        inputs = [self._surface, self._device.array(point_vectors, wp.vec3d)]
        self._device.launch(barrier.scatter, self._shape, inputs, [out])
        return on_host(out)

    def area_vectors(self, positions: FloatArray) -> FloatArray:
        """Return outward normal times area at every contact point [m^2], shape [f, p, 3]."""
        return self._pad.reference.area_vectors(positions[self._pad.faces])

    def refresh_grip(self, indenter: Indenter, state: State, *, start: Grip | None = None) -> float:
        """Hold the points that touch, free the others, and take over pressure and normal.

        Args:
            start: What was held before the step that is under way; None is the state's own. Where
                a point takes hold in a step is found anew each time, from where it was free.

        Returns:
            Change of the friction limit, summed over the points, over its new sum; zero where
            nothing is tangential or everything is bonded.
        """
        grip = state.grip
        if grip is None:
            return 0.0
        before, held_on = grip.loads, self.grip_arrays(start or grip)
        inputs = [*self._at(indenter, state), self._device.vectors(state.positions)]
        self._device.launch(self._kernels(indenter).hold, self._shape, inputs, [held_on])
        state.grip = Grip(
            held=on_host(held_on.held).copy(),
            anchors=on_host(held_on.anchors).copy(),
            loads=on_host(held_on.loads).copy(),
        )
        if self._options.bonded:
            return 0.0
        change = self.areas * np.linalg.norm(state.grip.loads - before, axis=2)
        total = self.areas * np.linalg.norm(state.grip.loads, axis=2)
        return float(change.sum() / max(total.sum(), 1e-300))

    def drag_anchors(self, indenter: Indenter, state: State) -> None:
        """Let the anchors of sliding points follow; the state is then one to go on from."""
        grip = state.grip
        if grip is None or self._options.bonded:
            return
        held_on = self.grip_arrays(grip)
        inputs = [*self._at(indenter, state), self._device.vectors(state.positions)]
        self._device.launch(self._kernels(indenter).drag, self._shape, inputs, [held_on])
        state.grip = replace(grip, anchors=on_host(held_on.anchors).copy())

    def grip_arrays(self, grip: Grip | None) -> Any:
        """Return a memory on the device; one of nothing where nothing is kept."""
        if grip is None:
            return self._no_grip
        return filled(
            friction.GripArrays,
            held=self._device.array(grip.held, wp.int32),
            anchors=self._device.array(grip.anchors, wp.vec3d),
            loads=self._device.array(grip.loads, wp.vec3d),
        )

    def _kernels(self, indenter: Indenter) -> ContactKernels:
        return contact_kernels(body_kind(indenter), grips=self._options.is_tangential)

    def _points(self, kind: Any) -> Any:
        return self._device.empty(self._shape, kind)

    def _at(self, indenter: Indenter, state: State) -> list[Any]:
        body = body_at(indenter, state.tip, state.rotation, device=self._device.name)
        return [self.stretched(state.extension), body]


def contact_rounding_n(found: ContactForces) -> float:
    """Return how much the contact forces change when the points' coordinates are rounded [N]."""
    stiffness = np.linalg.norm(found.stiffness, axis=(2, 3))
    change = KERNEL_EPSILON * stiffness * np.abs(found.points).max(axis=2)
    return float(np.linalg.norm(change))
