"""Energy and forces of a state, on the model's device, in arrays that are kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import warp as wp

from sim.arrays import FloatArray
from sim.contact.indenter_distance import body_at
from sim.contact.state import Grip, State
from sim.device import Device, on_host
from sim.scene.indenter import Indenter
from sim.solve.model import Model


class NodalPotential(Protocol):
    """An energy whose stiffness is a constant diagonal."""

    def energy(self, positions: FloatArray) -> float:
        """Return the energy at nodal positions [m], shape [node_count, 3]; [J]."""
        ...

    def gradient(self, positions: FloatArray) -> FloatArray:
        """Return its gradient [N], shape [node_count, 3]."""
        ...

    def diagonal(self) -> FloatArray:
        """Return its stiffness [N/m], shape [node_count, 3]."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """A state's energy and forces.

    Attributes:
        energy_j: Of gel, contact and potentials [J].
        gradient: By the nodes [N], shape [node_count, 3].
        elastic: The gel's part of it.
        push_n: Force on the indenter, modelled part [N], shape [3].
        gaps: Of every contact point [m], shape [face_count, point_count].
        ratio_min: Smallest volume ratio.
    """

    energy_j: float
    gradient: FloatArray
    elastic: FloatArray
    push_n: FloatArray
    gaps: FloatArray
    ratio_min: float


class Evaluator:
    """Evaluates states of one pad under one indenter, with launches that are recorded once."""

    def __init__(
        self, model: Model, indenter: Indenter, potentials: Sequence[NodalPotential] = ()
    ) -> None:
        self.model, self.indenter, self.potentials = model, indenter, potentials
        self._device = Device(model.device)
        self._positions = self._device.zeros(len(model.nodes), wp.vec3d)
        self._gel, self._contact = model.gel.room(), model.surface.room()
        self._grip: Grip | None = None
        self._pose: tuple[float, ...] = ()
        state = model.rest_state(tip=np.zeros(3))
        self._touch = model.surface.recorded(self._positions, self._contact, indenter, state)
        self._extension = state.extension
        self._strain = model.gel.recorded(self._positions, self._gel)
        # On the CPU these views share the device's memory, and are made once.
        self._views = None if self._device.is_gpu else self._on_host()
        self._at = on_host(self._positions)

    def renew_memory(self) -> None:
        """Take over what a relaxing gel remembers from now on."""
        self._strain = self.model.gel.recorded(self._positions, self._gel)

    def at(self, state: State) -> Evaluation:
        """Evaluate a state."""
        self._upload(state)
        for array in (self._gel[0], *self._contact[:2]):
            array.zero_()
        self._strain.launch()
        self._touch.launch()
        nodal, energies, ratios, pushed, push, touched, gaps = self._views or self._on_host()
        elastic = nodal.copy()
        gradient = elastic + pushed
        energy = float(energies.sum() + touched.sum())
        for potential in self.potentials:
            gradient = gradient + potential.gradient(state.positions)
            energy += potential.energy(state.positions)
        return Evaluation(
            energy_j=energy,
            gradient=gradient,
            elastic=elastic,
            push_n=push[0].copy(),
            gaps=gaps.copy(),
            ratio_min=float(ratios.min()),
        )

    def _on_host(self) -> list[FloatArray]:
        return [on_host(array) for array in (*self._gel, *self._contact)]

    def _upload(self, state: State) -> None:
        if self._device.is_gpu:
            self._positions.assign(state.positions)
        else:
            self._at[:] = state.positions
        pose = (*state.tip.tolist(), *state.rotation.reshape(-1).tolist())
        if pose != self._pose:
            body = body_at(self.indenter, state.tip, state.rotation, device=self.model.device)
            self._touch.set_param_by_name("body", body)
            self._pose = pose
        if state.extension != self._extension:
            surface = self.model.surface.stretched(state.extension)
            self._touch.set_param_by_name("surface", surface)
            self._extension = state.extension
        if state.grip is not self._grip:
            self._touch.set_param_by_name("grip", self.model.surface.grip_arrays(state.grip))
            self._grip = state.grip
