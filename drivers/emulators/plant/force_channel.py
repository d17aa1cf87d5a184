"""From the wrench on the indenter to what a force sensor's electronics make of it."""

from __future__ import annotations

import numpy as np

from drivers.emulators.plant.arrays import FloatArray
from drivers.emulators.plant.truth import PlantTruth
from tacauchy_rig.run import Vector3, Vector6


class ForceChannel:
    """Offset, drift, cross talk and noise of one sensor, in its own frame.

    The sensor is mounted so that its Fz is positive while the indenter is pressed: its frame is
    the tool's, turned by half a turn about x.
    """

    def __init__(self, truth: PlantTruth, *, start_ns: int) -> None:
        self._truth = truth
        self._start_ns = start_ns
        self._noise = np.random.default_rng([truth.seed, 1])

    def reading(
        self, force: Vector3, torque: Vector3, rotation_vector: Vector3, stamp_ns: int
    ) -> Vector6:
        """Return Fx, Fy, Fz [N], Mx, My, Mz [N m] as the sensor reports them.

        Args:
            force: On the indenter, in the base frame [N].
            torque: On the indenter about the tip, in the base frame [N m].
            rotation_vector: Orientation of the tool in the base frame [rad].
            stamp_ns: When; drift counts from the channel's start.
        """
        truth = self._truth
        turn = _sensor_from_base(rotation_vector)
        fx, fy, fz = (float(value) for value in turn @ np.asarray(force))
        mx, my, mz = (float(value) for value in turn @ np.asarray(torque))
        drift = truth.force_drift_n_s * (stamp_ns - self._start_ns) * 1e-9
        f_noise = truth.force_noise_n * self._noise.standard_normal(3)
        m_noise = truth.torque_noise_nm * self._noise.standard_normal(3)
        offset = truth.force_offset_n
        return (
            fx + truth.cross_talk[0] * fz + offset[0] + float(f_noise[0]),
            fy + truth.cross_talk[1] * fz + offset[1] + float(f_noise[1]),
            fz + offset[2] + drift + float(f_noise[2]),
            mx + float(m_noise[0]),
            my + float(m_noise[1]),
            mz + float(m_noise[2]),
        )


def _sensor_from_base(rotation_vector: Vector3) -> FloatArray:
    vector = np.asarray(rotation_vector, dtype=np.float64)
    angle = float(np.linalg.norm(vector))
    turn = np.eye(3)
    if angle > 1e-12:
        x, y, z = vector / angle
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turn = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    sensor: FloatArray = np.diag([1.0, -1.0, -1.0]) @ turn.T
    return sensor
