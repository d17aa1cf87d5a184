"""Where an indenter that comes down first feels a pad; depths count from there."""

from __future__ import annotations

import numpy as np

from sim.arrays import FloatArray
from sim.scene.indenter import Indenter
from sim.solve.model import Model
from tacauchy_rig.errors import ConfigError

_EXACT_SHARE = 2.5e-10


def touch_height(
    model: Model,
    indenter: Indenter,
    unloaded: FloatArray,
    *,
    centre_m: tuple[float, float],
    rotation: FloatArray,
) -> float:
    """Return the tip height at which the unloaded pad is first felt [m]: a gap of d_hat.

    Counted from there, a press depends on d_hat ten times less than counted from gap zero: the
    gel then stays d_hat (1 - s) off, s near 1, instead of d_hat s.

    Args:
        unloaded: Nodes of the pad before it is touched [m], shape [node_count, 3].

    Raises:
        ConfigError: The indenter comes down beside the pad.
    """
    high = float(unloaded[:, 2].max())
    distance = model.contact_options.distance_m
    state = model.rest_state(tip=np.array([*centre_m, high]), rotation=rotation)
    for _ in range(100):
        gap = float(model.gaps(unloaded, indenter, state).min()) - distance
        if abs(gap) < _EXACT_SHARE * model.height_m:
            break
        state.tip[2] -= gap
        if state.tip[2] < 0.0:
            x, y = centre_m
            raise ConfigError(
                f"the indenter at x = {x * 1e3:.4g} mm, y = {y * 1e3:.4g} mm comes down beside "
                "the pad and never touches its top",
                remedy="move it over the pad",
            )
    return float(state.tip[2])
