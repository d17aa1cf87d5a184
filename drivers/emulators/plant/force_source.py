"""The emulated force sensor's values: the plant under the arm that the shared world tells of."""

from __future__ import annotations

from drivers.emulators.m8128_source import EmulatedForce
from drivers.emulators.plant.force_channel import ForceChannel
from drivers.emulators.plant.gel import Plant
from drivers.emulators.shared_world import SharedWorld, WorldState
from tacauchy_rig.run import Pose

_LONGEST_STRETCH_S = 0.02  # a pose is carried on by its velocity for this long at most


class PlantForceSource:
    """Feels what the indenter feels, a latency ago; keeps the plant's memory of past presses."""

    def __init__(self, plant: Plant, world: SharedWorld, *, start_ns: int) -> None:
        self._plant = plant
        self._world = world
        self._channel = ForceChannel(plant.truth, start_ns=start_ns)

    def read(self, stamp_ns: int) -> EmulatedForce:
        """Return the sensor's reading at ``stamp_ns`` and what is true behind it."""
        state = self._world.read()
        felt_ns = stamp_ns - round(self._plant.truth.force_latency_s * 1e9)
        pose = pose_at(state, felt_ns)
        if state.sequence == 0:
            force = torque = (0.0, 0.0, 0.0)
            depth = 0.0
        else:
            force, torque = self._plant.wrench(pose, felt_ns)
            depth = max(0.0, self._plant.depth(pose))
        return EmulatedForce(
            reading=self._channel.reading(force, torque, pose.rotation_vector, stamp_ns),
            force_true_n=force[2],
            depth_true_m=depth,
        )


def pose_at(state: WorldState, stamp_ns: int) -> Pose:
    """Return the arm's pose at ``stamp_ns``, carried there from ``state`` by its velocity."""
    stretch_s = (stamp_ns - state.stamp_ns) * 1e-9
    if abs(stretch_s) > _LONGEST_STRETCH_S:
        return state.pose
    vx, vy, vz = state.velocity[:3]
    return state.pose.shifted(x=vx * stretch_s, y=vy * stretch_s, z=vz * stretch_s)
