"""Tasks of touch: reach a force, find an edge, estimate the pose of a held peg."""

from functools import partial
from typing import Any, ClassVar

import numpy as np
from gymnasium.envs.registration import register
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim.scene.indenter import Cylinder, Indenter, Sphere
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.envs.gym import TouchEnv, TouchVectorEnv

FZ = 2
_WORST = -2.0


class PressToForce(TouchVectorEnv):
    """Reach F_z and hold it, from an unknown height above the gel.

    The goal is F_z [N], 0.5 to 3. The reward is minus the true force's relative error, at
    least -2. Nothing ends an episode but its length. The action is the motion along z.
    """

    body: ClassVar[Indenter] = Sphere(diameter_m=8e-3)

    def draw(self, k: int, rng: np.random.Generator) -> None:
        """Draw the force, the place and the height."""
        self.goal[k] = rng.uniform(0.5, 3.0)
        self.poses[k, :2] = rng.uniform(-3e-3, 3e-3, 2)
        self.poses[k, 2] = self.pad.height_m + rng.uniform(0.2e-3, 1.5e-3)

    def judge(self, actions: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return minus the relative error."""
        error = np.abs(self.wrench[:, FZ] - self.goal[:, 0]) / self.goal[:, 0]
        return np.maximum(-error, _WORST), np.zeros(len(actions), np.bool_)


class FindEdge(TouchVectorEnv):
    """Bring the edge of a flat punch, 8 mm wide, over the pad's middle.

    It begins with the middle under the punch's face. The reward is minus the distance [mm], and
    minus what F_z exceeds 5 N by; an edge within 0.2 mm under at least 0.2 N ends the episode. The
    goal tells whether the edge is to be the left (-1) or the right one (1).
    """

    body: ClassVar[Indenter] = Cylinder(diameter_m=8e-3, fillet_m=1e-3)

    def draw(self, k: int, rng: np.random.Generator) -> None:
        """Draw the edge, the place and the height."""
        self.goal[k] = rng.choice([-1.0, 1.0])
        self.poses[k, :2] = rng.uniform(-2e-3, 2e-3, 2)
        self.poses[k, 2] = self.pad.height_m + rng.uniform(0.1e-3, 0.5e-3)

    def judge(self, actions: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return minus the distance, and where it is small while the gel is touched."""
        del actions
        away = 1e3 * np.abs(self.poses[:, 0] + self.goal[:, 0] * 4e-3)
        force_n = self.wrench[:, FZ]
        done = (away < 0.2) & (force_n > 0.2)
        return -away - np.maximum(force_n - 5.0, 0.0), done


class PegTouch(TouchVectorEnv):
    """Tell the pose of a held peg, 4 mm thick, that lies on the gel with its end on the pad.

    The actions' last three numbers are the estimate: x and y of the end over 4 mm, and the turn
    about z over 30 degrees. The reward is minus their mean absolute error. The motion is common to
    peg and estimate: what is asked for is the pose at the beginning. The goal is empty (zero).
    """

    body: ClassVar[Indenter] = Cylinder(diameter_m=4e-3, fillet_m=1e-3)
    action_size: ClassVar[int] = 6

    def __init__(self, num_envs: int = 1, **settings: Any) -> None:
        super().__init__(num_envs, **settings)
        self.truth = np.zeros((num_envs, 3))
        self.surface_m += self.body.radius_m  # type: ignore[union-attr]

    def draw(self, k: int, rng: np.random.Generator) -> None:
        """Draw the pose and the height."""
        self.truth[k] = rng.uniform(-1.0, 1.0, 3)
        self.poses[k, :2] = 4e-3 * self.truth[k, :2]
        self.poses[k, 2] = self.surface_m[k] + rng.uniform(0.1e-3, 0.5e-3)
        lying = Rotation.from_euler("yz", [90.0, 30.0 * self.truth[k, 2]], degrees=True)
        self.poses[k, 3:] = lying.as_quat()

    def judge(self, actions: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return minus the estimate's mean error."""
        error = np.abs(actions[:, 3:] - self.truth).mean(axis=1)
        return -error, np.zeros(len(actions), np.bool_)


for _kind in (PressToForce, FindEdge, PegTouch):
    register(
        f"{_kind.__name__}-v0",
        entry_point=partial(TouchEnv, _kind),
        vector_entry_point=f"{__name__}:{_kind.__name__}",
        max_episode_steps=60,
    )
