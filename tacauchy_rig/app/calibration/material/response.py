"""Force over modulus at any depth, Poisson's ratio and friction, between presses that were solved.

Forces of one law without weight are in proportion to the modulus, so that it takes no press.
Presses are of preset fast; one of preset balanced says by how much they are too stiff.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from sim.scene.scene import Preset
from sim.sensitivity import FINER, forces_at
from tacauchy_rig.app.calibration.material.presses import IndenterPresses
from tacauchy_rig.app.replay.inputs import ReplayInputs
from tacauchy_rig.app.replay.uncertainty import force_inputs
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.side_by_side import side_by_side
from tacauchy_rig.core.simulated import ForceInput

POISSON = (0.40, 0.43, 0.455, 0.475, 0.49)
FRICTION = (0.0, 0.1, 0.3, 0.6, 1.0)
"""Nodes that are solved. Above 0.49 preset fast takes other edges; what sticks altogether is hardly
told from friction 1."""
_DEPTHS = (0.04, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 1.0)
"""Of the deepest, which lies beyond the deepest measured one by as much as contact may be deep."""
_BEYOND = 1.1
_LEFT_SHARE, _LEFT_LEAST, _UNCORRECTED = 0.5, 0.005, 0.015
"""Of what preset balanced changes, so much may be wrong with it still, and at least so much.
Without it: what a ring of elements more or less changes of a force, as height or size change."""
_SHARED = ("gel height", "dome along x", "dome along y")
FITTED = ("Poisson's ratio", "friction")


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """An indenter's force over the modulus [m^2].

    Attributes:
        depth_m: From first touch, from 0 on, shape [depth_count] [m].
        area_m2: At the nodes, shape [poisson_count, friction_count, depth_count].
        uncertain: Relative standard uncertainty left of the mesh [1].
        inputs: What else it depends on.
    """

    depth_m: FloatArray
    area_m2: FloatArray
    uncertain: float
    inputs: tuple[ForceInput, ...]

    def at(self, poisson: FloatArray, friction: FloatArray, depth_m: FloatArray) -> FloatArray:
        """Return force over modulus, shape [poisson_count, friction_count, point_count]."""
        logs = np.log(self.area_m2[..., 1:] / self.depth_m[1:])
        logs = CubicSpline(POISSON, logs, axis=0)(poisson)
        logs = PchipInterpolator(FRICTION, logs, axis=1)(friction)
        # Of depth's logarithm it is a line for a ball, none for a punch.
        spline = PchipInterpolator(np.log(self.depth_m[1:]), logs, axis=2, extrapolate=True)
        return np.asarray(np.exp(spline(np.log(depth_m))) * depth_m)


def respond(presses: IndenterPresses, *, jobs: int = 1, correct: bool = True) -> Response:
    """Solve an indenter's presses.

    Args:
        presses: How deep, and of what.
        jobs: Processes.
        correct: Press once on preset balanced, and correct all by it.

    Raises:
        ConvergenceError: One finds no equilibrium.
    """
    inputs = replace(presses.inputs, sensor=presses.inputs.sensor.relaxing(()))
    depths_m = _BEYOND * float(presses.depth_m.max()) * np.array(_DEPTHS)
    nodes = list(product(POISSON, FRICTION))
    work = partial(_pressed, inputs=inputs, depths_m=tuple(depths_m.tolist()))
    forces = np.array([f for _, f in side_by_side(work, nodes, jobs=jobs, afresh=False)])
    ratio, left = np.ones(len(depths_m)), _UNCORRECTED
    if correct:
        ratio, left = _too_stiff(inputs, depths_m)
    area = (forces * ratio / inputs.sensor.material.young_pa).reshape(
        len(POISSON), len(FRICTION), -1
    )
    measured = np.unique(presses.depth_m)
    tried = force_inputs(inputs, presses.config, measured.tolist(), found=presses.found)
    return Response(
        depth_m=np.concatenate([[0.0], depths_m]),
        area_m2=np.concatenate([np.zeros((*area.shape[:2], 1)), area], axis=2),
        uncertain=left,
        inputs=tuple(each for each in tried if each.name not in FITTED),
    )


def is_shared(each: ForceInput) -> bool:
    """Return whether an input is the same for all indenters: it is the gel's."""
    return each.name in _SHARED


def gel_of(inputs: ReplayInputs, poisson: float, friction: float) -> ReplayInputs:
    """Return the inputs with another Poisson's ratio and friction."""
    more = poisson - inputs.sensor.material.poisson
    return replace(inputs, sensor=inputs.sensor.with_poisson(more), friction=friction)


def _pressed(
    node: tuple[float, float], *, inputs: ReplayInputs, depths_m: Sequence[float]
) -> FloatArray:
    scene = gel_of(inputs, *node).scene([1.0])
    return forces_at(scene, depths_m, refinement=FINER)


def _too_stiff(inputs: ReplayInputs, depths_m: FloatArray) -> tuple[FloatArray, float]:
    scene = replace(inputs, preset=Preset.BALANCED).scene([1.0])
    fine = forces_at(replace(scene, outputs=frozenset()), depths_m.tolist())
    ratio = fine / forces_at(inputs.scene([1.0]), depths_m.tolist(), refinement=FINER)
    return ratio, max(_LEFT_LEAST, _LEFT_SHARE * float(np.abs(ratio - 1.0).mean()))
