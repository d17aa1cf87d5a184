"""Inverses of the stiffness at a few points of a pilot press, which serve all environments.

On a GPU they are dense, so that applying one to a batch is one product of two matrices; on a
processor they are sparse factors.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.batch.dense import DenseProduct
from sim.batch.pilot import Pilot, PilotState
from sim.device import Device
from sim.mesh.sparsity import SparsePattern
from sim.solve.linear_solver import BorderedSolver, linear_solver
from tacauchy_rig.errors import ConfigError

# Ten dense inverses of this size are 5 GB, and take a processor minutes to make.
_UNKNOWNS_MAX = 16_000
# Columns of a dense inverse that are solved for at once.
_AT_ONCE = 64


def inverses_for(pilot: Pilot, device: Device, *, count: int) -> FactoredInverses | DenseProduct:
    """Return a pilot's inverses in the form that suits a device, for so many environments.

    Raises:
        ConfigError: There are too many unknowns for dense ones.
    """
    if not device.is_gpu:
        return FactoredInverses(pilot, count=count)
    pattern, pushed = pilot.model.pattern, pilot.is_pushed
    if pattern.dof_count > _UNKNOWNS_MAX:
        raise ConfigError(
            f"the mesh has {pattern.dof_count} unknowns, more than the {_UNKNOWNS_MAX} that a GPU "
            "takes",
            remedy="use preset fast, or press one by one",
        )
    if pilot.dense is None:
        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as threads:
            dense = list(
                threads.map(lambda each: dense_inverse(each, pattern, pushed=pushed), pilot.states)
            )
        pilot.dense = np.stack(dense)
    return DenseProduct(pilot.dense, count=count, device=device)


def dense_inverse(
    stiffness: PilotState, pattern: SparsePattern, *, pushed: bool
) -> NDArray[np.float32]:
    """Return the dense inverse [m/N], the indenter's height last, [dof_count + 1] squared.

    Where that is no unknown, its row and column are zero. Columns are solutions by the sparse
    factor, many at once, which takes a fraction of the time of a dense inversion.
    """
    factor = _factored(stiffness, pattern, pushed=pushed)
    size = pattern.dof_count + 1
    inverse = np.zeros((size, size), dtype=np.float32)
    for first in range(0, size, _AT_ONCE):
        last = min(size, first + _AT_ONCE)
        inverse[first:last] = factor.solve(np.eye(last - first, size, first))
    return inverse


class FactoredInverses:
    """Sparse factors, for vectors on a processor.

    Attributes:
        which: The one that serves an environment, shape [environment_count].
        blocks: None; every environment keeps its column, which is a ``width`` of 0.
    """

    kind, scaled, unit, width = wp.float64, False, 1.0, 0

    def __init__(self, pilot: Pilot, *, count: int) -> None:
        self.row_count, self.column_count = pilot.model.pattern.dof_count + 1, count
        self.which: Any = wp.zeros(count, dtype=wp.int32, device="cpu")
        self.blocks: Any = wp.zeros(0, dtype=wp.int32, device="cpu")
        self._factors = [
            _factored(stiffness, pilot.model.pattern, pushed=pilot.is_pushed)
            for stiffness in pilot.states
        ]

    def apply(self, asked: NDArray[np.int32] | None, sources: Any, found: Any) -> None:
        """Set ``found`` to the inverse times ``sources``, shape [environment_count, row_count]."""
        which, given, out = self.which.numpy(), sources.numpy(), found.numpy()
        for b in [] if asked is None else asked:
            out[b] = self._factors[which[b]].solve(given[b])


def _factored(stiffness: PilotState, pattern: SparsePattern, *, pushed: bool) -> BorderedSolver:
    solver = linear_solver(pattern)
    solver.factorise(stiffness.data)
    return BorderedSolver(solver, stiffness.border if pushed else None, stiffness.corner)
