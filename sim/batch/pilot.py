"""What a batch's presses share: the pad, and a pilot press whose stiffness preconditions them all.

On a GPU the pilot's stiffnesses are inverted, on the CPU factored.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
import scipy.linalg
import warp as wp
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.batch.kernels.dense import DenseProduct
from sim.device import Device
from sim.effects.plan import plan_effects
from sim.effects.presets import BATCH, build_model, mesh_for
from sim.mesh.sparsity import SparsePattern
from sim.scene.indenter import Indenter, MeshIndenter
from sim.scene.scene import Effect, Scene
from sim.solve.equilibrium import SolverOptions
from sim.solve.linear_solver import linear_solver
from sim.solve.load_steps.equilibrium import PathPoint
from sim.solve.load_steps.path import LoadingPath
from sim.solve.model import Model
from tacauchy_rig.errors import ConfigError

# A barrier of 1 % of the height makes F_z 1 % too large and halves Newton's iterations.
BARRIER_SHARE = 0.01
# A GPU takes the inverses, which are dense: 8 of this size are 2 GB.
_UNKNOWNS_MAX = 8000
# What only preconditions need not be in balance more exactly.
_RESIDUAL = 1e-4


def batch_model(scene: Scene, *, refinement: float = 1.0, symmetric: bool = True) -> Model:
    """Mesh a scene's pad for a batch, on the CPU.

    Args:
        scene: Pad, gel and indenter; its target and its barrier do not matter.
        refinement: Make every edge this many times shorter.
        symmetric: Model a part where symmetry allows. No environment can then move or tilt the
            indenter.

    Raises:
        ConfigError: The pad cannot be meshed for this indenter.
    """
    scene = replace(
        scene,
        barrier_m=BARRIER_SHARE * scene.pad.height_m,
        effects=((Effect.FINITE_STRAIN, True), (Effect.LOCKING_FREE_ELEMENT, True)),
    )
    mesh = mesh_for(scene, symmetric=symmetric, refinement=refinement, resolution=BATCH)
    return build_model(scene, plan=plan_effects(scene), mesh=mesh)


@dataclass(frozen=True, slots=True, kw_only=True)
class PilotStiffness:
    """The semidefinite stiffness of one state [N/m].

    Attributes:
        data: CSR values of the upper triangle.
        border: Column of the indenter's height if that is an unknown, shape [unknown_count].
        corner: Its diagonal entry.
    """

    data: FloatArray
    border: FloatArray | None
    corner: float

    def inverse(self, pattern: SparsePattern) -> NDArray[np.float32]:
        """Return the dense inverse, the indenter's height last, shape [row_count, row_count]."""
        count = pattern.dof_count
        dense = np.zeros((count + (self.border is not None),) * 2, order="F")
        dense[:count, :count] = pattern.upper(self.data).toarray()
        if self.border is not None:
            dense[:count, count], dense[count, count] = self.border, self.corner
        factor, _ = scipy.linalg.lapack.dpotrf(dense, lower=0, overwrite_a=1)
        inverse, _ = scipy.linalg.lapack.dpotri(factor, lower=0, overwrite_c=1)
        return np.asarray(np.triu(inverse) + np.triu(inverse, 1).T, dtype=np.float32)


@dataclass(slots=True)
class Pilot:
    """The stiffness at a few depths of one press, contact included.

    Args:
        model: The pad, on the CPU.
        indenter: The body.
        depth_m: Of the deepest press that they are for [m].
        centre_m: Where the indenter comes down, x and y [m].
        count: Depths, at equal distances.
        is_pushed: The indenter's height is an unknown, its force given; it is the last unknown.

    Attributes:
        touch_m: Height of the indenter's tip at first touch [m].
        forces_n: F_z on the modelled part at those depths [N].
        stiffnesses: At those depths.
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
    stiffnesses: list[PilotStiffness] = field(init=False)
    setup_s: float = field(init=False)
    _inverses: NDArray[np.float32] | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self._check()
        started = time.perf_counter()
        path = LoadingPath(
            self.model,
            self.indenter,
            self.centre_m,
            options=SolverOptions(residual_relative=_RESIDUAL),
        )
        self.touch_m = path.touch_m
        points = [path.advance(float(depth)) for depth in self.depths_m]
        copies = self.model.mesh.symmetry.copies
        self.forces_n = np.array([point.force_n[2] for point in points]) / copies
        self.stiffnesses = [self._stiffness(point) for point in points]
        self.setup_s = time.perf_counter() - started

    @property
    def depths_m(self) -> FloatArray:
        """Where the stiffnesses stand [m]."""
        return self.depth_m * np.arange(1, self.count + 1) / self.count

    def inverses(self) -> NDArray[np.float32]:
        """Return the stiffnesses' dense inverses, made once."""
        if self._inverses is None:
            pattern = self.model.pattern
            self._inverses = np.stack([one.inverse(pattern) for one in self.stiffnesses])
        return self._inverses

    def nearest(self, load_history: FloatArray) -> NDArray[np.intp]:
        """Return which stiffness is nearest to depths [m] or, if it is pushed, loads [N]."""
        stands = self.forces_n if self.is_pushed else self.depths_m
        return np.searchsorted(0.5 * (stands[1:] + stands[:-1]), load_history)

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

    def _stiffness(self, point: PathPoint) -> PilotStiffness:
        model, state = self.model, point.state
        forces = model.surface.forces(state.positions, self.indenter, state, curved=False)
        border = model.pattern.unknowns(model.surface.scatter(-forces.stiffness[..., 2]))
        return PilotStiffness(
            data=model.hessian_data(state.positions, forces.stiffness, projected=True),
            border=border if self.is_pushed else None,
            corner=float(forces.stiffness[..., 2, 2].sum()),
        )


class Preconditioner(Protocol):
    """Approximate inverses of the stiffness.

    Attributes:
        row_count: Rows of the vectors it takes; those after the unknowns stay zero.
        kind: Warp type of what it takes.
        unit: What it gives must be multiplied with this.
    """

    row_count: int
    kind: Any
    unit: float

    def select(self, which: int) -> None:
        """Take another of the pilot's stiffnesses from now on."""
        ...

    def apply(self, right: Any, out: Any) -> None:
        """Set ``out`` to the inverse times ``right``.

        Args:
            right: Of its own kind, shape [environment_count, row_count].
            out: Float32, the same shape.
        """
        ...


def preconditioner(pilot: Pilot, device: Device) -> Preconditioner:
    """Return the preconditioner that suits a device."""
    if not device.is_gpu:
        return FactoredStiffness(pilot)
    return DenseProduct(pilot.inverses(), device=device)


class FactoredStiffness:
    """Sparse factors, for vectors on the CPU."""

    def __init__(self, pilot: Pilot) -> None:
        self.row_count = pilot.model.pattern.dof_count + pilot.is_pushed
        self.kind, self.unit = wp.float32, 1.0
        self._factors = [_Factor(pilot, stiffness) for stiffness in pilot.stiffnesses]
        self._which = 0

    def select(self, which: int) -> None:
        """Take another of the pilot's stiffnesses from now on."""
        self._which = which

    def apply(self, right: Any, out: Any) -> None:
        """Set ``out`` to the inverse times ``right``."""
        factor, count = self._factors[self._which], self.row_count
        for given, found in zip(right.numpy(), out.numpy(), strict=True):
            # An environment that searches nothing asks for nothing.
            if given.any():
                found[:count] = factor.solve(given[:count].astype(np.float64))


class _Factor:
    """One stiffness; the indenter's height, if it is an unknown, borders the sparse part."""

    def __init__(self, pilot: Pilot, stiffness: PilotStiffness) -> None:
        self._solver = linear_solver(pilot.model.pattern, refined=False)
        self._solver.factorise(stiffness.data)
        self._border = stiffness.border
        if self._border is not None:
            self._along = self._solver.solve(self._border)
            self._corner = stiffness.corner - float(self._border @ self._along)

    def solve(self, vector: FloatArray) -> FloatArray:
        if self._border is None:
            return self._solver.solve(vector)
        unknowns = self._solver.solve(vector[:-1])
        lift = (vector[-1] - self._border @ unknowns) / self._corner
        return np.append(unknowns - lift * self._along, lift)
