"""A batch of presses: many environments over one rest mesh advance together.

Each environment has a material, a pose of the indenter and a load history of its own, of depths or
loads. Newton's equations are solved by conjugate gradients, preconditioned with the stiffness at a
few depths of one pilot press, contact included. All environments share it: on a GPU its dense
inverse, so that applying it is one product of two matrices, on the CPU its sparse factor.
Environments go through frames, Newton's and conjugate gradients' iterations each at its own pace;
the next depth's stiffness takes over when the last of them has passed the depth up to which the old
one is the nearest. On a GPU such a segment is one CUDA graph: the host waits for its end and does
nothing else. On the CPU the same kernels run.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from sim.arrays import FloatArray
from sim.batch.environment import BatchOptions, BatchResult, Environment, refuse_unfit, segments
from sim.batch.iteration import Iteration
from sim.batch.kernels.dense import padded_columns
from sim.batch.pilot import Pilot
from sim.device import Device, on_host
from sim.fields.stress import SurfaceStress

# A test costs a GPU some microseconds, a few ticks too many cost few environments more: they would
# go on with a stiffness that is no longer the nearest.
_ITERATIONS_A_TEST, _FEW = 4, 8


class Batch:
    """Environments over one pad, ready to be pressed again and again.

    Args:
        pilot: Pad, indenter and preconditioners.
        environments: What differs.
        device: Warp device, ``cpu`` or ``cuda:0``.

    Raises:
        ConfigError: The environments do not fit together or to the pilot.
    """

    def __init__(
        self,
        pilot: Pilot,
        environments: Sequence[Environment],
        *,
        options: BatchOptions | None = None,
        device: str = "cpu",
    ) -> None:
        refuse_unfit(pilot, environments)
        self.pilot, self.options = pilot, options or BatchOptions()
        self.environments = list(environments)
        self.device, self._device = device, Device(device)
        count = len(self.environments)
        missing = padded_columns(count) - count if self._device.is_gpu else 0
        filled = [*self.environments, *[self.environments[-1]] * missing]
        self.iteration = Iteration(
            pilot, filled, count=count, options=self.options, device=self._device
        )
        load_histories = np.stack([each.load_history for each in self.environments], axis=1)
        copies = pilot.model.mesh.symmetry.copies if pilot.is_pushed else 1
        self._segments = segments(pilot, load_histories / copies)
        self._graphs: list[Any] = []

    @property
    def frame_count(self) -> int:
        """Frames of every environment."""
        return len(self.environments[0].load_history)

    def prepare(self) -> None:
        """Compile the kernels and, on a GPU, record the graphs, so that ``press`` need not."""
        if self._graphs:
            return
        self.iteration.reset()
        self.iteration.run()
        if self._device.is_gpu:
            for segment in range(len(self._segments)):
                with wp.ScopedCapture(device=self._device.name) as capture:
                    self._go(segment)
                self._graphs.append(capture.graph)

    def press(self) -> BatchResult:
        """Press every environment along its load history from the untouched gel."""
        self.prepare()
        self.iteration.reset()
        self._device.synchronise()
        started = time.perf_counter()
        for segment in range(len(self._segments)):
            if self._graphs:
                wp.capture_launch(self._graphs[segment])
            else:
                self._go(segment)
        self._device.synchronise()
        return self._result(time.perf_counter() - started)

    def displacements(self) -> FloatArray:
        """Return the last frames' nodal displacements [m], [environment_count, node_count, 3]."""
        pattern, count = self.pilot.model.pattern, len(self.environments)
        found = on_host(self.iteration.vectors.before)[:count, : pattern.dof_count]
        return np.stack([pattern.nodal(row) for row in found])

    def surface_stresses(self) -> list[SurfaceStress]:
        """Return the stress on the last frames' surface, environment by environment."""
        self.iteration.stress.launch()
        return self.iteration.stress.fetch()

    def _go(self, segment: int) -> None:
        """Go on to the end of a segment."""
        self.iteration.begin(*self._segments[segment])
        wp.capture_while(self.iteration.busy, while_body=self._iterate)

    def _iterate(self) -> None:
        """Run the body of a segment's loop, after which is tested whether anybody is busy."""
        few = not self._device.is_gpu or len(self.environments) <= _FEW
        for _ in range(1 if few else _ITERATIONS_A_TEST):
            self.iteration.run()

    def _result(self, wall_s: float) -> BatchResult:
        count, symmetry = len(self.environments), self.pilot.model.mesh.symmetry
        found = self.iteration.found
        part = on_host(found.push)[:, :count]
        residual, imbalance, gap = (
            on_host(array)[:, :count].copy()
            for array in (found.residual, found.imbalance, found.gap)
        )
        pushed = self.pilot.is_pushed
        depth = -on_host(self.iteration.lifts) if pushed else on_host(self.iteration.depths)
        return BatchResult(
            force_n=np.sum([sign * part for sign in symmetry.signs()], axis=0),
            depth_m=np.where(np.isnan(residual), np.nan, depth[:, :count]),
            residual=residual,
            imbalance=imbalance,
            gap_m=gap,
            evaluations=self.iteration.progress.spent.numpy()[:count].copy(),
            wall_s=wall_s,
        )
