"""Starts and ends of a descent that are refused.

Between equilibria the surfaces may overlap by ``OVERLAP_SHARE`` of the pad's height. A gap is
measured to the nearest side of the indenter: where gel has come past the middle of a small body,
that is the wrong one, and contact pulls the gel's surface, or has none.
"""

import numpy as np

from sim.contact.surface_and_grip import State
from sim.scene.indenter import Indenter, MeshIndenter, Plane, TurnedIndenter
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
    if deepest <= 8.0 * OVERLAP_SHARE * model.height_m:
        return
    message = f"the gel starts {deepest * 1e3:.3g} mm inside the indenter"
    if deepest < _PENETRATION_SHARE * model.height_m:
        at = np.unravel_index(np.argmin(found.gaps), found.gaps.shape)
        push, outward = found.forces[at], model.surface.area_vectors(state.positions)[at]
        if push @ outward >= _FACING * np.linalg.norm(push) * np.linalg.norm(outward):
            return
        message += ", where its nearest side does not face the gel"
    raise ConvergenceError(message, remedy="start with the indenter above the gel and press it in")


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
    indenter: Indenter, rotation: FloatArray, *, reach_m: FloatArray, touch_m: float, from_m: float
) -> float:
    """Return the depth at which an indenter's lowest point over the pad is at the gel's base [m].

    Args:
        reach_m: Least and greatest x and y of the pad seen from the tip [m], shape [2, 2].
        touch_m: Height of the tip at first touch [m].
        from_m: If the indenter is not there at this depth [m], a lesser one beyond it will do.
    """
    if isinstance(indenter, Plane) or np.array_equal(rotation, np.eye(3)):
        return touch_m
    width = indenter.size_m[:2] if isinstance(indenter, MeshIndenter) else indenter.radius_m
    least = touch_m - float(np.linalg.norm(width) * np.hypot(*rotation[2, :2]))
    if rotation[2, 2] > 0.0 and least > from_m:
        return least
    turned = TurnedIndenter(indenter=indenter, rotation=rotation)
    low, high = (np.clip(each, *reach_m) for each in turned.reach())
    axes = [np.linspace(a, b, _SAMPLES) for a, b in zip(low, high, strict=True)]
    heights = turned.lower_surface(*np.meshgrid(*axes, indexing="ij"))
    return touch_m + min(0.0, float(heights.min()))
