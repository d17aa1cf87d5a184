"""A pilot press whose stiffness, inverted at a few depths, preconditions every press like it."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg
import scipy.sparse
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.indenter import Indenter
from sim.loading import LoadingPath
from sim.mesh_indenter import MeshIndenter
from sim.model import Model
from sim.path_point import PathPoint
from tacauchy_rig.errors import ConfigError

# The inverses are dense: 8 of this size take 2 GB.
_UNKNOWNS_MAX = 8000


@dataclass(slots=True)
class Pilot:
    """Dense inverses of the stiffness along one press.

    Args:
        model: The pad, on the CPU.
        indenter: The body.
        depth_m: Of the deepest press that they are for [m].
        centre_m: Where the indenter comes down, x and y [m].
        count: Inverses, at equal distances in depth.
        is_pushed: The indenter's height is an unknown, its force given; it is the last unknown.

    Attributes:
        touch_m: Height of the indenter's tip at first touch [m].
        forces_n: F_z on the modelled part where the inverses stand [N].
        inverses: Shape [count, unknown_count, unknown_count], float32.
        setup_s: Time that all this took.

    Raises:
        ConfigError: The model has what batches lack, or too many unknowns.
    """

    model: Model
    indenter: Indenter
    depth_m: float
    centre_m: tuple[float, float] = (0.0, 0.0)
    count: int = 8
    is_pushed: bool = False
    touch_m: float = field(init=False)
    forces_n: FloatArray = field(init=False)
    inverses: NDArray[np.float32] = field(init=False)
    setup_s: float = field(init=False)

    def __post_init__(self) -> None:
        self._check()
        started = time.perf_counter()
        path = LoadingPath(self.model, self.indenter, centre_m=self.centre_m)
        self.touch_m = path.touch_m
        points = [path.advance(float(depth)) for depth in self.depths_m]
        copies = self.model.mesh.fold.copies
        self.forces_n = np.array([point.force_n[2] for point in points]) / copies
        self.inverses = np.stack([self._inverse(point) for point in points])
        self.setup_s = time.perf_counter() - started

    @property
    def depths_m(self) -> FloatArray:
        """Where the inverses stand [m]."""
        return self.depth_m * np.arange(1, self.count + 1) / self.count

    def nearest(self, course: FloatArray) -> NDArray[np.intp]:
        """Return which inverse is nearest to depths [m] or, if it is pushed, loads [N]."""
        stands = self.forces_n if self.is_pushed else self.depths_m
        return np.searchsorted(0.5 * (stands[1:] + stands[:-1]), course)

    def _check(self) -> None:
        model, count = self.model, self.model.pattern.dof_count
        if isinstance(self.indenter, MeshIndenter):
            raise ConfigError(
                "a batch presses analytic indenters only", remedy="use a cylinder, sphere or plane"
            )
        if model.contact_options.is_tangential or model.relaxation is not None:
            raise ConfigError(
                "a batch knows neither friction, bonding nor relaxation",
                remedy="leave them out, or press one by one",
            )
        if count > _UNKNOWNS_MAX:
            raise ConfigError(
                f"the mesh has {count} unknowns, more than the {_UNKNOWNS_MAX} that a batch takes",
                remedy="use preset fast, or press one by one",
            )

    def _inverse(self, point: PathPoint) -> NDArray[np.float32]:
        model, state = self.model, point.state
        forces = model.contact_forces(state.positions, self.indenter, state, curved=False)
        data = model.hessian_data(state.positions, forces.stiffness, projected=True)
        pattern, count = model.pattern, model.pattern.dof_count
        upper = scipy.sparse.csr_matrix((data, pattern.indices, pattern.indptr), (count, count))
        dense = np.zeros((count + self.is_pushed,) * 2, order="F")
        dense[:count, :count] = upper.toarray()
        if self.is_pushed:
            dense[:count, count] = pattern.unknowns(model.scatter(-forces.stiffness[..., 2]))
            dense[count, count] = forces.stiffness[..., 2, 2].sum()
        factor, _ = scipy.linalg.lapack.dpotrf(dense, lower=0, overwrite_a=1)
        inverse, _ = scipy.linalg.lapack.dpotri(factor, lower=0, overwrite_c=1)
        whole = np.triu(inverse) + np.triu(inverse, 1).T
        return np.asarray(whole, dtype=np.float32)
