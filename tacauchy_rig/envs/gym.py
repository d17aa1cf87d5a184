"""Gymnasium environments of touch: one ``Batch`` computes all environments of a vector.

An arm moves a rigid body on a sensor's gel by small displacements, 20 a second. Importing this
module registers the environments of ``gym_tasks``.
"""

from abc import ABC, abstractmethod
from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sim.batch.batch import Batch, BatchForces
from sim.batch.force_bias import EDGE_M, measured_bias
from sim.batch.motion_steps import BatchOptions
from sim.batch.sensor_model import sensor_model
from sim.optics.surface_images import SurfaceImages
from sim.scene.indenter import Indenter
from sim.scene.pad import BoxPad
from sim.sensor.sensor import load_sensor
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.envs.gym_imperfections import IMAGE_PX, Imperfections, imperfections_of_run

try:
    import gymnasium
    from gymnasium import spaces
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError as error:
    raise ConfigError(
        "the package gymnasium is not installed", remedy="pip install 'tacauchy-rig[gym]'"
    ) from error

STEP_S = 0.05
MOVE_M = 0.1e-3
"""Of the tip in one step, along each axis, at most."""
_EDGE_M = 3.5e-3
_DEEPEST_M = 1.6e-3
# Off the pad's edges, in x and y.
_MARGIN_M = 6e-3
# Of forces: less than what a measured bias leaves (1 %).
_RESIDUAL = 5e-3

# Of an observation's number, in its unit: no press reaches it.
_MOST = 100.0

Seen = dict[str, Any]


class TouchVectorEnv(VectorEnv[Seen, FloatArray, Any], ABC):
    """Environments that touch one sensor; the actions' first three numbers move the tip.

    Observations: ``force``, the wrench on the body about the middle of the pad's base [N, N m]
    as the force sensor has it; ``pose``, the tip's way from where the episode began [mm]; ``goal``,
    what the task asks for; ``image``, uint8, shape [30, 40, 3]. An episode that ends begins anew in
    the same step; its last observation is ``final_obs`` of the info.

    Args:
        image: Draw images and observe them.
        run: A run's folder, whose measured imperfections are drawn anew in every episode; without
            it only the gel's modulus varies, as the sensor's file has it.
        edge_m: Of the gel's mesh [m]; None is 3.5 mm, and 1 mm with a measured bias.
        measures_bias: As ``GelContact`` takes it.
        max_episode_steps: An episode is cut off then; None never does.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - as Gymnasium declares it
        "render_modes": ["rgb_array"],
        "render_fps": round(1.0 / STEP_S),
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }
    body: ClassVar[Indenter]
    goal_size: ClassVar[int] = 1
    action_size: ClassVar[int] = 3

    def __init__(
        self,
        num_envs: int = 1,
        *,
        image: bool = True,
        sensor: str = "gelsight-mini",
        run: str | Path | None = None,
        edge_m: float | None = None,
        measures_bias: bool = False,
        device: str = "cpu",
        render_mode: str | None = None,
        max_episode_steps: int | None = None,
    ) -> None:
        gel = load_sensor(sensor)
        if not isinstance(gel.pad, BoxPad):
            raise ConfigError(f"sensor {sensor}: its pad is no box", remedy="choose another sensor")
        self.num_envs, self.render_mode, self._limit = num_envs, render_mode, max_episode_steps
        self.pad, self._has_image = gel.pad, image
        of_units = Imperfections(stiffness=gel.young_uncertainty()[0])
        self.imperfections = of_units if run is None else imperfections_of_run(Path(run))
        edge_m = edge_m or (EDGE_M if measures_bias else _EDGE_M)
        model = sensor_model(gel.pad, gel.material, layers=gel.layers, edge_m=edge_m, device=device)
        options = BatchOptions(residual_relative=_RESIDUAL)
        bias = measured_bias(model, gel, [self.body]) if measures_bias else None
        self.batch = Batch(model, [self.body], [0] * num_envs, options=options, bias=bias)
        self._drawing = None
        if image or render_mode is not None:
            view = replace(
                gel.camera.refined(IMAGE_PX[0] / gel.camera.width),
                width=IMAGE_PX[0],
                height=IMAGE_PX[1],
            )
            self._drawing = SurfaceImages(
                model, self.batch.descents.indenter, gel, count=num_envs, geometry=view
            )
        sizes = {"force": 6, "pose": 3, "goal": self.goal_size}
        seen: dict[str, spaces.Space[Any]] = {
            name: spaces.Box(-_MOST, _MOST, (size,), np.float32) for name, size in sizes.items()
        }
        if image:
            seen["image"] = spaces.Box(0, 255, (*IMAGE_PX[::-1], 3), np.uint8)
        self.single_observation_space = spaces.Dict(seen)
        self.single_action_space = spaces.Box(-1.0, 1.0, (self.action_size,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._rngs = [np.random.default_rng() for _ in range(num_envs)]
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self.poses = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (num_envs, 1))
        self.begin_m, self.goal = np.zeros((num_envs, 3)), np.zeros((num_envs, self.goal_size))
        self.surface_m = np.full(num_envs, gel.pad.height_m)
        self.wrench = np.zeros((num_envs, 6))
        self._late = deque([self.wrench.copy()] * 2, maxlen=2)
        self._gain, self._stiffness = np.ones((2, num_envs))
        self._zero, self._drift_n_s = np.zeros((num_envs, 6)), np.zeros(num_envs)
        self._rest: ImageArray | None = None
        if self._drawing is not None:
            self._rest = self._drawn()[0].copy()
            self._images = deque([np.stack([self._rest] * num_envs)] * 2, maxlen=2)

    @abstractmethod
    def draw(self, k: int, rng: np.random.Generator) -> None:
        """Set environment k's first ``poses`` and its ``goal``."""

    @abstractmethod
    def judge(self, actions: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return rewards and which tasks are done, from the state after the actions."""

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Begin an episode everywhere; environment k of seed s is the one of seed s + k alone."""
        del options
        seeds = [seed + k for k in range(self.num_envs)] if isinstance(seed, int) else seed
        for k, each in enumerate(seeds or []):
            if each is not None:
                self._rngs[k] = np.random.default_rng(each)
        if isinstance(seed, int):
            self._np_random_seed, self._np_random = seed, self._rngs[0]
        self._begin(np.ones(self.num_envs, np.bool_))
        return self._observed(), {}

    def step(
        self, actions: FloatArray
    ) -> tuple[Seen, FloatArray, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Move, find the equilibrium, and begin anew where an episode has ended."""
        seen, rewards, done, cut = self.advance(actions)
        info: dict[str, Any] = {}
        ended = done | cut
        if ended.any():
            info = {"final_obs": np.array([None] * self.num_envs, dtype=object)}
            for k in np.flatnonzero(ended):
                info["final_obs"][k] = {name: value[k].copy() for name, value in seen.items()}
            info["_final_obs"] = ended
            self._begin(ended)
            for name, value in self._observed(ended).items():
                seen[name][ended] = value[ended]
        return seen, rewards, done, cut, info

    def advance(
        self, actions: FloatArray
    ) -> tuple[Seen, FloatArray, NDArray[np.bool_], NDArray[np.bool_]]:
        """Move and find the equilibrium. No episode begins anew.

        Returns:
            Observations, rewards, which tasks are done and which episodes are cut off: by their
            length, or because no equilibrium was found.
        """
        actions = np.clip(np.asarray(actions, dtype=np.float64), -1.0, 1.0)
        self.poses[:, :3] += MOVE_M * actions[:, :3]
        half = np.array(self.pad.half_extents()) - _MARGIN_M
        self.poses[:, :2] = np.clip(self.poses[:, :2], -half, half)
        lowest, highest = self.surface_m - _DEEPEST_M, self.surface_m + 3e-3
        self.poses[:, 2] = np.clip(self.poses[:, 2], lowest, highest)
        found = self.batch.step(self.poses)
        self._feel(found)
        self._steps += 1
        rewards, done = self.judge(actions)
        cut = ~found.valid
        if self._limit is not None:
            cut |= self._steps >= self._limit
        if self._drawing is not None:
            self._images.append(self._drawn())
        return self._observed(), rewards, done, cut

    def render(self) -> tuple[ImageArray, ...] | None:
        """Return what the camera sees in each environment, without noise and delay."""
        if self.render_mode is None:
            return None
        return tuple(np.kron(each, np.ones((8, 8, 1), np.uint8)) for each in self._images[-1])

    def _feel(self, found: BatchForces) -> None:
        """Keep the wrench on the body about the middle of the base, of gels as stiff as drawn.

        Under a body that is moved, stresses are proportional to the modulus of the whole gel.
        """
        force = found.wrench[:, :3]
        moment = found.wrench[:, 3:] + np.cross(found.tips_m, force)
        felt = np.hstack([force, moment]) * self._stiffness[:, None]
        self.wrench = np.where(found.valid[:, None], felt, self.wrench)
        self._late.append(self.wrench.copy())

    def _begin(self, which: NDArray[np.bool_]) -> None:
        """Draw episodes: the task, and a force sensor and a gel with imperfections."""
        of = self.imperfections
        for k in np.flatnonzero(which):
            rng = self._rngs[k]
            self._gain[k] = 1.0 + of.gain * rng.standard_normal()
            self._stiffness[k] = max(0.1, 1.0 + of.stiffness * rng.standard_normal())
            self._zero[k] = np.multiply(of.zero, rng.standard_normal(6))
            self._drift_n_s[k] = of.drift_n_s * rng.standard_normal()
            self.draw(int(k), rng)
        self.begin_m[which], self._steps[which] = self.poses[which, :3], 0
        for wrench in (self.wrench, *self._late):
            wrench[which] = 0.0
        self.batch.reset(which)
        if self._rest is not None:
            for images in self._images:
                images[which] = self._rest

    def _observed(self, which: NDArray[np.bool_] | None = None) -> Seen:
        """Return what the devices tell now; noise is drawn for those asked for only."""
        of = self.imperfections
        asked = range(self.num_envs) if which is None else np.flatnonzero(which).tolist()
        share = min(of.force_delay_s / STEP_S, 1.0)
        felt = (1.0 - share) * self._late[-1] + share * self._late[0]
        felt = self._gain[:, None] * felt + self._zero
        felt[:, 2] += self._drift_n_s * self._steps * STEP_S
        for k in asked:
            felt[k] += np.multiply(of.noise, self._rngs[k].standard_normal(6))
        pose = 1e3 * (self.poses[:, :3] - self.begin_m)
        seen: Seen = {
            "force": felt.astype(np.float32),
            "pose": pose.astype(np.float32),
            "goal": self.goal.astype(np.float32),
        }
        if self._has_image:
            image = self._images[0 if of.image_delay_s > 0.5 * STEP_S else -1].copy()
            for k in asked if of.image_noise else ():
                noise = of.image_noise * self._rngs[k].standard_normal(image.shape[1:])
                image[k] = np.clip(np.rint(image[k] + noise), 0, 255)
            seen["image"] = image
        return seen

    def _drawn(self) -> ImageArray:
        assert self._drawing is not None  # noqa: S101 - callers ask
        batch = self.batch
        drawn = self._drawing.images(batch.positions, batch.poses.tips, batch.poses.rotations)
        return np.array(drawn.numpy())


class TouchEnv(gymnasium.Env[Seen, FloatArray]):
    """One environment: the vector of one."""

    metadata: dict[str, Any] = TouchVectorEnv.metadata

    def __init__(self, kind: type[TouchVectorEnv], **settings: Any) -> None:
        self.vector = kind(1, **settings)
        self.render_mode = self.vector.render_mode
        self.observation_space = self.vector.single_observation_space
        self.action_space = self.vector.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Begin an episode."""
        super().reset(seed=seed)
        seen, info = self.vector.reset(seed=seed, options=options)
        return {name: value[0] for name, value in seen.items()}, info

    def step(self, action: FloatArray) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """Move and find the equilibrium."""
        seen, rewards, done, cut = self.vector.advance(np.asarray(action)[None])
        first = {name: value[0] for name, value in seen.items()}
        return first, float(rewards[0]), bool(done[0]), bool(cut[0]), {}

    def render(self) -> ImageArray | None:
        """Return what the camera sees."""
        images = self.vector.render()
        return None if images is None else images[0]
