"""Overlap of gel and indenter: how much of a motion it allows, and starts that it forbids.

Between equilibria the surfaces may overlap by ``OVERLAP_SHARE`` of the pad's height.
"""

from __future__ import annotations

import numpy as np

from sim.contact.state import State
from sim.scene.indenter import Indenter
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
    if deepest <= 2.0 * OVERLAP_SHARE * model.height_m:
        return
    told = f"the gel starts {deepest * 1e3:.3g} mm inside the indenter"
    remedy = "start with the indenter above the gel and press it in"
    if deepest >= _PENETRATION_SHARE * model.height_m:
        raise ConvergenceError(told, remedy=remedy)
    at = np.unravel_index(np.argmin(found.gaps), found.gaps.shape)
    push, outward = found.forces[at], model.surface.area_vectors(state.positions)[at]
    if push @ outward < _FACING * np.linalg.norm(push) * np.linalg.norm(outward):
        raise ConvergenceError(
            f"{told}, where its nearest side does not face the gel", remedy=remedy
        )
