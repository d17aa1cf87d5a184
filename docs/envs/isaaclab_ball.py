"""Balls fall on gels in Isaac Lab and come to rest: python docs/envs/isaaclab_ball.py 4.

Prints wrench over weight, the steps of the loop in a second of one
processor core, and the sensor's share. ``--device cuda:0`` takes a GPU; there ``--graph`` makes the
engine and the sensor one CUDA graph, whose shares cannot be told apart.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import isaaclab.sim as sim_utils
import numpy as np
from isaaclab.assets import RigidObjectCfg
from isaaclab.scene import InteractiveSceneCfg
from isaaclab.sim import SimulationCfg, build_simulation_context
from isaaclab.utils import configclass, instantiate
from isaaclab_newton.physics import MJWarpSolverCfg, NewtonCfg

from sim.device import Device
from tacauchy_rig import Sphere, load_sensor
from tacauchy_rig.envs.isaaclab import TactileSensor, TactileSensorCfg

RADIUS_M, MASS_KG, STEPS, STEP_S = 4e-3, 0.05, 120, 2e-3
PAD = load_sensor("gelsight-mini").pad
NO_CONTACT = sim_utils.UsdPhysicsCollisionCfg(collision_enabled=False)


class TimedSensor(TactileSensor):
    """It adds up the seconds that it takes."""

    seconds = 0.0

    def press(self, state: Any) -> None:
        """Press, and take the time."""
        begun = _now(self.device)
        super().press(state)
        self.seconds += _now(self.device) - begun


def _now(device: str) -> float:
    """Return seconds of one processor core, or on a GPU the time when all launched is done."""
    if device == "cpu":
        return time.process_time()
    Device(device).synchronise()
    return time.perf_counter()


@configclass
class BallOnGel(InteractiveSceneCfg):
    """A gel that lies still, and a ball."""

    pad = RigidObjectCfg(
        prim_path="{ENV_REGEX_NS}/Pad",
        spawn=sim_utils.CuboidCfg(
            size=(PAD.size_x_m, PAD.size_y_m, PAD.height_m),
            rigid_props=sim_utils.UsdPhysicsRigidBodyCfg(kinematic_enabled=True),
            mass_props=sim_utils.MassCfg(mass=0.1),
            collision_props=NO_CONTACT,
        ),
    )
    ball = RigidObjectCfg(
        prim_path="{ENV_REGEX_NS}/Ball",
        spawn=sim_utils.SphereCfg(
            radius=RADIUS_M,
            rigid_props=sim_utils.UsdPhysicsRigidBodyCfg(),
            mass_props=sim_utils.MassCfg(mass=MASS_KG),
            collision_props=NO_CONTACT,
        ),
        init_state=RigidObjectCfg.InitialStateCfg(
            pos=(0.0, 0.0, 0.5 * PAD.height_m + RADIUS_M + 1e-3)
        ),
    )
    touch = TactileSensorCfg(
        prim_path="{ENV_REGEX_NS}/Pad",
        object_path="{ENV_REGEX_NS}/Ball",
        indenter=Sphere(diameter_m=2.0 * RADIUS_M),
        pad_frame=(0.0, 0.0, -0.5 * PAD.height_m, 0.0, 0.0, 0.0, 1.0),
        tip_frame=(0.0, 0.0, -RADIUS_M, 0.0, 0.0, 0.0, 1.0),
    )


def main(count: int, device: str, *, graph: bool) -> None:
    """Let the balls fall, and print what comes of it."""
    physics = NewtonCfg(solver_cfg=MJWarpSolverCfg(), use_cuda_graph=graph)
    settings = SimulationCfg(dt=STEP_S, device=device, physics=physics)
    with build_simulation_context(device=device, sim_cfg=settings) as sim:
        wanted = BallOnGel(num_envs=count, env_spacing=0.1)
        wanted.touch.class_type = TactileSensor if graph else TimedSensor
        scene = instantiate(wanted)
        sim.reset()
        ball, touch = scene["ball"], scene["touch"]
        poses = ball.data.root_link_pose_w.torch.clone()
        beside = np.random.default_rng(46).normal(scale=1e-4, size=(count, 2))
        poses[:, :2] += poses.new_tensor(beside)
        ball.write_root_pose_to_sim_index(root_pose=poses)
        shares, spent, images = [], [], []
        for step in range(STEPS):
            begun, touch.seconds = _now(device), 0.0
            scene.write_data_to_sim()
            sim.step(render=False)
            scene.update(STEP_S)
            spent.append((_now(device) - begun, touch.seconds))
            if step >= STEPS - 20:
                wrench = touch.data.wrench
                images.append(_now(device) - begun - spent[-1][0])
                shares.append(wrench[:, 2].cpu().numpy() / (MASS_KG * 9.81))
        found = np.mean(shares, axis=0)
        loop, sensor = np.mean(spent[2:], axis=0)  # kernels are compiled, graphs captured
        print(f"{count} environments, {STEPS} steps of {STEP_S * 1e3:g} ms, {ball.device}")
        print(f"wrench over weight: {found.min():.4f} to {found.max():.4f}")
        print(f"stated error of the force: {touch.data.force_error.max():.3f}")
        print(f"valid: {int(touch.data.is_valid.sum())} of {count}")
        print(f"loop with wrench: {1.0 / loop:.1f} steps/s, {count / loop:.0f} of environments")
        if not graph:
            print(f"of it the sensor: {sensor / loop:.0%}; alone {1.0 / sensor:.1f} steps/s")
        print(f"with image and tractions: {1.0 / (loop + np.mean(images[1:])):.1f} steps/s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("environments", type=int)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--graph", action="store_true")
    given = parser.parse_args()
    main(given.environments, given.device, graph=given.graph)
