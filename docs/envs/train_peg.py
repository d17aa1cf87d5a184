"""Train SAC of stable-baselines3 on PegTouch-v0; judge it and a script on fresh seeds."""

import time

import matplotlib.pyplot as plt
import numpy as np
import torch
from gymnasium.spaces import Box
from stable_baselines3 import SAC
from stable_baselines3.common.vec_env import VecEnv

from tacauchy_rig.envs.gym_tasks import PegTouch

COUNT, STEPS, TRAINING, SEEDS = 64, 16, 12_288, range(10_000, 60_000, 10_000)
PIXELS = 0.507 * (np.indices((40, 30)).reshape(2, -1) - [[19.5], [14.5]])  # x and y [mm]
TOUCH, SEEN = PegTouch(COUNT, max_episode_steps=STEPS), Box(-np.inf, np.inf, (312,))


class _Pegs(VecEnv):  # They go down to 3 N; actions are added to the script's estimates.
    close = get_attr = set_attr = env_method = env_is_wrapped = lambda *_, **__: [None] * COUNT

    def reset(self, seed: int = 1) -> np.ndarray:
        raw = TOUCH.reset(seed=seed)[0]
        self.rest, self.rewards = raw["image"].astype(np.float32), []
        return self._seen(raw)

    def _seen(self, raw: dict) -> np.ndarray:
        self.raw, self.change = raw, raw["image"] - self.rest
        blocks = self.change.reshape(COUNT, 10, 3, 10, 4, 3).mean((2, 4)).reshape(COUNT, 300)
        force = raw["force"] / [0.5, 0.5, 2.0, 0.01, 0.01, 0.01]
        self.scripted = _script(self)
        parts = [blocks / 4.0, force, raw["pose"], self.scripted[:, 3:]]
        return np.concatenate(parts, 1, dtype=np.float32)

    def step_async(self, actions: np.ndarray) -> None:
        self.actions = self.scripted + np.pad(0.3 * actions, ((0, 0), (3, 0)))

    def step_wait(self) -> tuple:
        raw, rewards, done, cut, _ = TOUCH.step(self.actions)
        self.rewards.append(rewards.mean())
        print(f"\r{COUNT * len(self.rewards)} steps: {self.rewards[-1]:.3f} ", end="", flush=True)
        return self._seen(raw), rewards, done | cut, [{}] * COUNT


def _script(envs: _Pegs) -> np.ndarray:  # Main axis of what changed in the image; its left end.
    actions = np.outer(envs.raw["force"][:, 2] < 3.0, -np.eye(6)[2])
    for k in np.flatnonzero(envs.raw["force"][:, 2] > 0.1):  # before, the middle is the best guess
        change = np.abs(envs.change[k]).sum(-1).T.ravel()
        weights = change * (change > 0.25 * change.max())
        middle = PIXELS @ weights / weights.sum()
        axis = np.linalg.eigh(np.cov(PIXELS, aweights=weights))[1][:, 1]
        axis *= np.copysign(1.0, axis[0])
        begin = (axis @ (PIXELS - middle[:, None]))[weights > 0.0].min() + 1.3
        actions[k, 3:5] = (middle + begin * axis - envs.raw["pose"][k, :2]) / 4.0
        actions[k, 5] = np.degrees(np.arctan2(axis[1], axis[0])) / 30.0
    return actions


def _judge(envs: _Pegs, name: str, act) -> None:
    found = []
    for seed in SEEDS:
        seen = envs.reset(seed)
        for _ in range(STEPS):
            seen = envs.step(act(seen))[0]
        found.append((np.mean(envs.rewards), np.mean(envs.rewards[-5:])))
    mean, spread = np.mean(found, 0), np.std(found, 0, ddof=1)
    print(f"\n{name}: episodes, last 5 steps {mean.round(4)} +- {spread.round(4)}")
    plt.axhline(mean[0], label=f"{name}, fresh seeds", color="C2" if name == "policy" else "C1")


if __name__ == "__main__":
    began, busy = time.time(), time.process_time()
    envs = _Pegs(COUNT, SEEN, Box(-1.0, 1.0, (3,)))
    settings = {"gamma": 0.0, "gradient_steps": 24, "learning_starts": COUNT * STEPS, "seed": 1}
    settings |= {"policy_kwargs": {"net_arch": [128, 128]}, "buffer_size": TRAINING}
    settings |= {"ent_coef": "auto_0.01", "device": "cpu"}
    torch.set_flush_denormal(True)
    policy = SAC("MlpPolicy", envs, lambda left: 1e-3 * max(left, 0.1), **settings)
    policy.learn(TRAINING)
    print(f"{time.time() - began:.0f} s, {time.process_time() - busy:.0f} s of a core")
    curve = np.reshape(envs.rewards, (-1, STEPS)).mean(1)
    plt.plot(COUNT * STEPS * (1 + np.arange(len(curve))), curve, label="training, with exploration")
    _judge(envs, "policy", lambda seen: policy.predict(seen, deterministic=True)[0])
    _judge(envs, "script", lambda _: np.zeros((COUNT, 3)))
    plt.gca().set(xlabel="steps", ylabel="mean reward of a step")
    plt.legend()
    plt.savefig("docs/images/train_peg.png", dpi=80)
