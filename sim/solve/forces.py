"""The forces at one state after the other, in two launches each, on the CPU."""

from __future__ import annotations

import numpy as np
import warp as wp

from sim.arrays import FloatArray
from sim.contact.indenter_distance import body_at
from sim.contact.state import State
from sim.device import Device
from sim.scene.indenter import Indenter
from sim.solve.model import Model


class QuickForces:
    """Forces of a gel and of contact without friction, in arrays that are kept.

    Args:
        model: The pad, on the CPU.
        indenter: The body, analytic.
        extension: Share of d_hat below which the barrier is a parabola.

    Attributes:
        elastic: Gradient of the elastic energy [N], shape [node_count, 3]; like the others of the
            state that was evaluated last.
        push: Force on the indenter, modelled part [N], shape [3].
        gap: Smallest gap of a point that touches [m], shape [1].
    """

    def __init__(self, model: Model, indenter: Indenter, *, extension: float) -> None:
        self._indenter = indenter
        self._pose: tuple[float, ...] = ()
        cpu, count = Device("cpu"), len(model.nodes)
        positions, elastic, contact = (cpu.zeros(count, wp.vec3d) for _ in range(3))
        push, gap = cpu.zeros(1, wp.vec3d), cpu.zeros(1, wp.float64)
        self._at, self.elastic, self._contact = (a.numpy() for a in (positions, elastic, contact))
        self.push, self.gap = push.numpy()[0], gap.numpy()
        self._ratios, self._find_ratios = model.recorded_ratios(positions)
        self._launches = (
            model.recorded_gradient(positions, elastic),
            model.recorded_push(positions, [contact, push, gap], indenter, extension=extension),
        )

    def gradient(self, state: State) -> FloatArray:
        """Return the gradient of the energy by the nodes [N], shape [node_count, 3]."""
        self._at[:] = state.positions
        for array in (self.elastic, self._contact, self.push):
            array.fill(0.0)
        self.gap.fill(np.inf)
        gel, contact = self._launches
        pose = (*state.tip.tolist(), *state.rotation.reshape(-1).tolist())
        if pose != self._pose:
            contact.set_param_by_name("body", body_at(self._indenter, state.tip, state.rotation))
            self._pose = pose
        gel.launch()
        contact.launch()
        return np.asarray(self.elastic + self._contact)

    def smallest_ratio(self) -> float:
        """Return the smallest volume ratio of the state that was evaluated last."""
        self._find_ratios.launch()
        return float(self._ratios.min())
