"""Starts and ends of a descent that are refused, and starts turned inside out.

Between equilibria the surfaces may overlap by ``OVERLAP_SHARE`` of the pad's height. A gap is
measured to the nearest side of the indenter: where gel has come past the middle of a small body,
that is the wrong one, and contact pulls the gel's surface, or has none.

Newton alone finds its way back from many states that are collapsed, flattened, mirrored or
shuffled, but a collapsed element says nothing about the direction, and now and then the pad stays
knotted. Here every element asks for the rotation nearest to its deformation, and one linear solve
fits the nodes to all of them, again and again: the local and global steps of Sorkine and Alexa
(2007). It knows neither the law nor the indenter and ends near a state from which both are easy.
"""

import logging

import numpy as np
import scipy.sparse.linalg

from sim.contact.surface_and_grip import State
from sim.mesh.clamping_and_sparsity import assembled
from sim.scene.indenter import Indenter, Plane, TurnedIndenter
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConvergenceError

# Of the pad's height: overlap between equilibria, and at a start that is refused.
OVERLAP_SHARE = 0.005
_PENETRATION_SHARE = 0.3
# Cosine between contact force and surface from which the nearest side faces the gel.
_FACING = 0.5
# A motion that overlaps is cut to where the gap falls to the allowed, or by this if that is less.
_CUT, _TRIES = 0.9, 60
# A change of a gap that is none [m]; it keeps quotients finite.
_NOTHING_M = 1e-300


def overlap_fraction(
    model: Model, indenter: Indenter, state: State, tip: FloatArray, motion: FloatArray
) -> float:
    """Return the largest tried fraction of a motion that overlaps no more than allowed.

    Args:
        tip: Where the indenter's tip ends up at fraction one [m]; it moves with the gel.
        motion: Motion of the nodes [m], shape [node_count, 3].
    """
    before = model.surface.gaps(state.positions, indenter, state)
    floor = np.minimum(-OVERLAP_SHARE * model.height_m, before)
    fraction, trial = 1.0, state.copy()
    for _ in range(_TRIES):
        trial.tip = state.tip + fraction * (tip - state.tip)
        after = model.surface.gaps(state.positions + fraction * motion, indenter, trial)
        hit = after < floor
        if not hit.any():
            return fraction
        reach = (before - floor)[hit] / np.maximum((before - after)[hit], _NOTHING_M)
        fraction *= min(_CUT, float(reach.min()))
    return 0.0


def refuse_deep_overlap(model: Model, indenter: Indenter, state: State) -> None:
    """End where gel starts so far inside the indenter that its nearest side may be the wrong one.

    Raises:
        ConvergenceError: The overlap is 30 % of the pad's height or more, or the nearest side at
            the deepest point does not face the gel.
    """
    found = model.surface.forces(state.positions, indenter, state)
    deepest = -float(found.gaps.min())
    # Less is left beside an edge by an end of another mesh, and finds its way out.
    if deepest <= 4.0 * OVERLAP_SHARE * model.height_m:
        return
    message = f"the gel starts {deepest * 1e3:.3g} mm inside the indenter"
    remedy = "start with the indenter above the gel and press it in"
    if deepest >= _PENETRATION_SHARE * model.height_m:
        raise ConvergenceError(message, remedy=remedy)
    at = np.unravel_index(np.argmin(found.gaps), found.gaps.shape)
    push, outward = found.forces[at], model.surface.area_vectors(state.positions)[at]
    if push @ outward < _FACING * np.linalg.norm(push) * np.linalg.norm(outward):
        raise ConvergenceError(
            f"{message}, where its nearest side does not face the gel", remedy=remedy
        )


# What presses has 0.9 to 1.0, under the folds of a deep sharp rim too; what has passed through, a
# part of it or all, 0.03 to -1.0.
_FACING_LEAST = 0.6
_SAMPLES = 65


def faces_gel(forces: FloatArray, outward: FloatArray, *, friction: float) -> bool:
    """Return whether a contact presses on the outside of the gel, wherever it touches.

    Args:
        forces: On the indenter [N], shape [face_count, point_count, 3].
        outward: Normals of the gel's surface at these points, of any length, likewise.
        friction: Coefficient by which forces may lean [-].
    """
    sizes = np.linalg.norm(outward, axis=2)
    pushed = np.einsum("fpi,fpi->fp", forces, outward) / np.maximum(sizes, 1e-300)
    least = _FACING_LEAST / np.hypot(1.0, friction)
    return bool(pushed.sum() >= least * np.linalg.norm(forces, axis=2).sum())


def base_depth_m(
    indenter: Indenter, rotation: FloatArray, *, reach_m: FloatArray, touch_m: float
) -> float:
    """Return the depth at which an indenter's lowest point over the pad is at the gel's base [m].

    Args:
        reach_m: Least and greatest x and y of the pad seen from the tip [m], shape [2, 2].
        touch_m: Height of the tip at first touch [m].
    """
    if isinstance(indenter, Plane) or np.array_equal(rotation, np.eye(3)):
        return touch_m
    turned = TurnedIndenter(indenter=indenter, rotation=rotation)
    low, high = (np.clip(each, *reach_m) for each in turned.reach())
    axes = [np.linspace(a, b, _SAMPLES) for a, b in zip(low, high, strict=True)]
    heights = turned.lower_surface(*np.meshgrid(*axes, indexing="ij"))
    return touch_m + min(0.0, float(heights.min()))


logger = logging.getLogger(__name__)
# Shares of the rest volume that are inverted: where untangling begins, and where it ends.
TANGLED_SHARE = 0.1
_ENOUGH_SHARE = 1e-3
_PASSES_MAX = 10
# Among equally near rotations, the one nearest to rest.
_REST_BIAS = 1e-3


def untangle(model: Model, positions: FloatArray) -> tuple[FloatArray, int]:
    """Turn inverted elements the right way round; fixed degrees of freedom stay where they are.

    Returned are the nodes [m], shape [node_count, 3], and the linear solves that were spent.
    """
    gradients, weights = _rest_gradients(model)
    fit = _Fit(model, gradients, weights)
    share, passes = 1.0, 0
    while passes < _PASSES_MAX and share >= _ENOUGH_SHARE:
        passes += 1
        deformation = _deformation(model, gradients, positions)
        positions = fit.solve(_rotations(deformation), positions)
        share = _share(_deformation(model, gradients, positions), weights)
    logger.debug("untangled in %d passes, %.3g left", passes, share)
    return positions, passes


def inverted_share(model: Model, positions: FloatArray) -> float:
    """Return the share of the rest volume with det F <= 0."""
    gradients, weights = _rest_gradients(model)
    return _share(_deformation(model, gradients, positions), weights)


def _share(deformation: FloatArray, weights: FloatArray) -> float:
    return float(weights[np.linalg.det(deformation) <= 0.0].sum() / weights.sum())


def _rest_gradients(model: Model) -> tuple[FloatArray, FloatArray]:
    """Return shape gradients [1/m], shape [e, q, n, 3], and volumes [m^3], shape [e, q]."""
    pad, reference = model.discretisation, model.reference
    gradients = np.einsum("qnj,ejk->eqnk", reference.gradients, pad.inverse_jacobians)
    return gradients, pad.volumes[:, None] * reference.weights


def _deformation(model: Model, gradients: FloatArray, positions: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("eni,eqnj->eqij", positions[model.elements], gradients))


def _rotations(deformation: FloatArray) -> FloatArray:
    """Return the nearest rotation of every matrix, shape [..., 3, 3]."""
    left, _, right = np.linalg.svd(deformation + _REST_BIAS * np.eye(3))
    sign = np.sign(np.linalg.det(left) * np.linalg.det(right))
    left[..., :, 2] *= sign[..., None]
    return np.asarray(left @ right)


class _Fit:
    """Least squares of the nodes to wanted deformations, factored once an axis."""

    def __init__(self, model: Model, gradients: FloatArray, weights: FloatArray) -> None:
        self._model = model
        self._weighted = gradients * weights[..., None, None]
        blocks = np.einsum("eqaj,eqbj->eab", self._weighted, gradients)
        count = len(model.nodes)
        matrix = assembled(blocks, model.elements, count)
        fixed = np.ones(3 * count, dtype=np.bool_)
        fixed[model.pattern.free_dofs] = False
        self._free = [np.flatnonzero(~fixed.reshape(-1, 3)[:, axis]) for axis in range(3)]
        self._rows = [matrix[free] for free in self._free]
        self._factors = [
            scipy.sparse.linalg.splu(part[:, free].tocsc())
            for part, free in zip(self._rows, self._free, strict=True)
        ]

    def solve(self, wanted: FloatArray, positions: FloatArray) -> FloatArray:
        """Return the nodes that fit best to the wanted deformations, shape [node_count, 3]."""
        pull = np.zeros_like(positions)
        parts = np.einsum("eqij,eqnj->eni", wanted, self._weighted)
        np.add.at(pull, self._model.elements, parts)
        fitted = positions.copy()
        for axis, free in enumerate(self._free):
            held = positions[:, axis].copy()
            held[free] = 0.0
            right = pull[free, axis] - self._rows[axis] @ held
            fitted[free, axis] = self._factors[axis].solve(right)
        return fitted
