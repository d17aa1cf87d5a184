"""The bias of F_z on a sensor's mesh, measured for an indenter against presses on fine meshes.

F_z also depends on where a contact lies in the mesh's cells, by 0.1 to 2 % (standard deviation) at
edges of 1.25 mm under balls of 8 mm. An indenter is pressed at several places around each fine one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats.qmc import Sobol

from sim.batch.batch import Batch
from sim.batch.sensor_model import ForceBias, edge_of
from sim.cheapest_setting import keeping_corrected
from sim.press import press
from sim.scene.indenter import Indenter, Sphere, tilted
from sim.scene.pad import BoxPad
from sim.scene.scene import ContactMode, Effect, Motion, Scene, Target
from sim.sensor.sensor import Sensor
from sim.solve.model import Model
from sim.tilt_sensitivity import kept
from sim.tolerance import Tolerance
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

# Of the pad's height: least and greatest depth; of a ball's diameter: the greatest. Fine presses,
# places around each, and how far they are from the pad's edge [m].
_DEPTHS, _BALL_SHARE, _FINE, _PLACES, _MARGIN_M = (0.04, 0.35), 0.4, 8, 4, 5e-3
_TOLERANCE = 0.01
EDGE_M = 1e-3
"""Edges of a mesh [m] on which a measured bias leaves under balls 1 % on Mini, 2 % on DIGIT."""


def measured_bias(model: Model, sensor: Sensor, indenters: Sequence[Indenter]) -> ForceBias:
    """Measure the bias of forces under upright indenters on a sensor's model, for ``Batch``.

    This machine keeps the result until scene, edge or simulator change.

    Raises:
        RigError: An indenter cannot be pressed on a mesh of its own.
    """
    friction = model.contact_options.friction
    how: dict[str, Any] = {}
    if friction > 0.0:  # which nobody need try to leave out
        how = {"contact": ContactMode.FRICTION, "effects": ((Effect.FRICTION, True),)}
    rows = []
    for body in indenters:
        most_m = _DEPTHS[1] * model.height_m
        if isinstance(body, Sphere):
            most_m = min(most_m, _BALL_SHARE * body.diameter_m)
        deepest = sensor.scene(body, Target(depth_m=most_m), friction=friction, **how)
        rows.append(kept((deepest, edge_of(model)), 6, partial(_measured, model, deepest, most_m)))
    table = np.array(rows)
    constant, left = table[:, :1] * np.eye(1, 6), table[:, 1:2] * [1.0, 0.0]
    return ForceBias(constant, table[:, 2:], left)


def _measured(model: Model, deepest: Scene, most_m: float) -> FloatArray:
    """Return what ``bias_of`` leaves: constant, what remains of that, ``by_force``; shape [6]."""
    pad = deepest.pad
    assert isinstance(pad, BoxPad)  # noqa: S101 - that of a sensor's model is
    half = np.array(pad.half_extents()) - _MARGIN_M
    centres = half * (2.0 * Sobol(2, scramble=False).random(_FINE) - 1.0)
    cell = edge_of(model) * (2.0 * Sobol(2, scramble=False).random(_PLACES) - 1.0)
    depths_m = np.geomspace(_DEPTHS[0] * model.height_m, most_m, _FINE)
    fine_n, poses = np.zeros(_FINE), np.zeros((_FINE, _PLACES, 7))
    for k, (centre, depth_m) in enumerate(zip(centres, depths_m, strict=True)):
        scene = replace(deepest, target=Target(depth_m=float(depth_m)))
        fine_n[k], poses[k] = press_alone(scene, centre, np.array([0.0, 0.0, 0.0, 1.0]))
        poses[k, :, :2] += cell
        poses[k, :, 2] += pad.height_at(*poses[k, :, :2].T) - pad.height_at(*centre[:, None])
    batch = Batch(model, [deepest.indenter], [0] * (_FINE * _PLACES))
    found = batch.step(poses.reshape(-1, 7))
    felt_n, corrected_n = found.raw_wrench[:, 2], found.wrench[:, 2]
    if not (felt_n > 0.0).all():
        raise ConfigError("no force where the bias is measured", remedy="take a shorter edge_m")
    off = np.log(corrected_n / np.repeat(fine_n, _PLACES))
    size = np.log(felt_n)
    square, linear, constant = fit = np.polyfit(size, off, 2)
    left = np.percentile(np.abs(off - np.polyval(fit, size)), 95.0) + _TOLERANCE
    return np.array([constant, left, linear, square, size.min(), size.max()])


def press_alone(
    scene: Scene, centre_m: FloatArray, turn: FloatArray, tolerance: float = _TOLERANCE
) -> tuple[float, FloatArray]:
    """Return F_z of a scene's press on its own mesh [N], and the pose it ends at, shape [7].

    Args:
        centre_m: Where, shape [2].
        turn: Quaternion of a tilt.
    """
    axis = Rotation.from_quat(turn).as_matrix()[:, 2]
    tilt = (-float(np.arcsin(axis[1])), float(np.arctan2(axis[0], axis[2])))
    x_m, y_m = centre_m.tolist()
    own = replace(scene, centre_m=(x_m, y_m), motion=Motion(tilt_rad=tilt))
    result = press(keeping_corrected(own, Tolerance(relative=tolerance)))
    force_n = result.force_n[2] if result.corrected is None else result.corrected.force_n
    at = result.point.state.tip - [0.0, 0.0, result.model.contact_options.distance_m]
    return force_n, np.concatenate([at, Rotation.from_matrix(tilted(*tilt)).as_quat()])
