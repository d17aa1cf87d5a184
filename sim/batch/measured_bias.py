"""The bias of F_z on a sensor's mesh, measured for an indenter against presses on fine meshes.

F_z also depends on where a contact lies in the mesh's cells, which is not corrected: at edges of
1.25 mm it changes F_z by 0.1 to 2 % (standard deviation), the less, the wider the contact. The
indenter is therefore pressed at several places around each of the fine presses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats.qmc import Sobol

from sim.batch.batch import Batch
from sim.batch.sensor_model import ForceBias, edge_of
from sim.error import Tolerance, keeping_corrected
from sim.press import press
from sim.scene.indenter import Indenter, Sphere, tilted
from sim.scene.pad import BoxPad
from sim.scene.scene import ContactMode, Motion, Scene, Target
from sim.sensor.sensor import Sensor
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

# Of the pad's height: least and greatest depth; of a ball's diameter: the greatest. Fine presses,
# places around each, and how far they are from the pad's edge [m].
_DEPTHS, _BALL_SHARE, _FINE, _PLACES, _MARGIN_M = (0.04, 0.35), 0.4, 8, 4, 5e-3
_TOLERANCE = 0.01


def measured_bias(model: Model, sensor: Sensor, indenters: Sequence[Indenter]) -> ForceBias:
    """Measure the bias of forces under upright indenters on a sensor's model, for ``Batch``.

    Raises:
        RigError: An indenter cannot be pressed on a mesh of its own.
    """
    pad, friction = sensor.pad, model.contact_options.friction
    assert isinstance(pad, BoxPad)  # noqa: S101 - that of a sensor's model is
    half = np.array(pad.half_extents()) - _MARGIN_M
    centres = half * (2.0 * Sobol(2, scramble=False).random(_FINE) - 1.0)
    cell = edge_of(model) * (2.0 * Sobol(2, scramble=False).random(_PLACES) - 1.0)
    contact: dict[str, Any] = {}
    if friction > 0.0:
        contact = {"contact": ContactMode.FRICTION, "friction": friction}
    fine_n, poses = [], np.zeros((len(indenters), _FINE, _PLACES, 7))
    for body, own in zip(indenters, poses, strict=True):
        most_m = _DEPTHS[1] * model.height_m
        if isinstance(body, Sphere):
            most_m = min(most_m, _BALL_SHARE * body.diameter_m)
        depths_m = np.geomspace(_DEPTHS[0] * model.height_m, most_m, _FINE)
        for around, centre, depth_m in zip(own, centres, depths_m, strict=True):
            scene = sensor.scene(body, Target(depth_m=float(depth_m)), **contact)
            force_n, around[:] = press_alone(scene, centre, np.array([0.0, 0.0, 0.0, 1.0]))
            fine_n.append(force_n)
            around[:, :2] += cell
            around[:, 2] += pad.height_at(*around[:, :2].T) - pad.height_at(*centre[:, None])
    which = np.repeat(np.arange(len(indenters)), _FINE * _PLACES)
    felt_n = Batch(model, indenters, which).step(poses.reshape(-1, 7)).raw_wrench[:, 2]
    if not (felt_n > 0.0).all():
        raise ConfigError("no force where the bias is measured", remedy="take a shorter edge_m")
    shape = (len(indenters), _FINE * _PLACES)
    off = (felt_n / np.repeat(fine_n, _PLACES) - 1.0).reshape(shape)
    sizes = np.log(felt_n).reshape(shape)
    fits = np.array([np.polyfit(*each, 2) for each in zip(sizes, off, strict=True)])
    left = [np.abs(y - np.polyval(c, x)) for c, x, y in zip(fits, sizes, off, strict=True)]
    none, stated = np.zeros(len(indenters)), np.percentile(left, 95.0, axis=1) + _TOLERANCE
    by_force = np.column_stack([fits[:, 1], fits[:, 0], sizes.min(axis=1), sizes.max(axis=1)])
    return ForceBias(fits[:, 2], none, stated, none, by_force)


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
