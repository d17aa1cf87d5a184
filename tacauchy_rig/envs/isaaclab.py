"""A tactile sensor for Isaac Lab 3 on newton: the gel's finite elements are the contact.

Before each substep of the engine the objects are pressed into the gels (``GelContact``), and the
wrench is added to both bodies.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, field
from typing import Any

import numpy as np
import torch
from isaaclab.cloner.cloner_cfg import expand_env_regex_ns
from isaaclab.sensors import SensorBase, SensorBaseCfg
from isaaclab.utils import configclass
from isaaclab_newton.physics import NewtonManager

from sim.coupling.rigid_body_contact import UNMOVED
from sim.scene.indenter import Indenter
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.envs.newton import TactileSensor as OnNewton


@dataclass
class TactileSensorData:
    """What the sensors show, one entry of each tensor for an environment.

    Forces are those before the last substep. Vectors are in the pad's frame, whose z points out of
    the gel. The nodes' forces are with the mesh's bias; ``wrench`` is without.

    Attributes:
        wrench: Force [N] and moment about the tip [N m] on the object, [count, 6]; where no
            equilibrium was found it is the last one.
        force_error: What the force may be off by, over its size, 19 times of 20, [count].
        is_valid: The gel found its equilibrium, or nothing touches it, [count].
        tactile_rgb_image: uint8, [count, height, width, 3].
        tactile_depth_image: Height that the gel lost [m], [count, height, width, 1]. TacSL's is
            the distance from a camera.
        tactile_normal_force: Into the gel at ``points_m`` [N], [count, points].
        tactile_shear_force: On the gel, along the pad's x and y [N], [count, points, 2].
        points_m: The nodes of the resting gel's surface [m], [points, 3].
    """

    wrench: torch.Tensor
    force_error: torch.Tensor
    is_valid: torch.Tensor
    tactile_rgb_image: torch.Tensor
    tactile_depth_image: torch.Tensor
    tactile_normal_force: torch.Tensor
    tactile_shear_force: torch.Tensor
    points_m: torch.Tensor


class TactileSensor(SensorBase):
    """One gel in each environment, carried by a rigid body, and one object that presses it."""

    cfg: TactileSensorCfg

    def __init__(self, cfg: TactileSensorCfg) -> None:
        super().__init__(cfg)
        self.cfg.object_path = expand_env_regex_ns(cfg.object_path)
        NewtonManager.register_state_force_callback(self.press)

    @property
    def data(self) -> TactileSensorData:
        """What the sensors show now."""
        self._update_outdated_buffers()
        return self._data

    def reset(self, env_ids: Sequence[int] | None = None, env_mask: Any = None) -> None:
        """Put the gels of environments back to rest."""
        super().reset(env_ids, env_mask)
        self._felt.contact.reset(self._resolve_indices_and_mask(env_ids, env_mask))

    def press(self, state: Any) -> None:
        """Press the objects where a newton state has them, and add the forces to it [N, N m]."""
        if self._is_initialized:
            self._felt.update(state)
            self._felt.apply(state, NewtonManager.get_solver_dt())

    def _initialize_impl(self) -> None:
        super()._initialize_impl()
        cfg, model = self.cfg, NewtonManager.get_model()
        pads, objects = (
            _bodies(model, path, self._num_envs) for path in (cfg.prim_path, cfg.object_path)
        )
        frames = {"pad_frame": cfg.pad_frame, "tip_frame": cfg.tip_frame}
        self._felt = OnNewton(model, pads, objects, cfg.indenter, **frames, **cfg.gel)
        batch = self._felt.contact.batch
        which = np.flatnonzero(batch.areas_m2)
        self._which, self._areas_m2, self._points_m = (
            torch.as_tensor(each, device=self.device)
            for each in (which, batch.areas_m2[which], batch.model.nodes[which])
        )

    def _update_buffers_impl(self, env_mask: Any) -> None:
        del env_mask  # all are drawn at once
        contact = self._felt.contact
        pressure, shear = (
            torch.from_dlpack(each)[:, self._which] for each in contact.batch.tractions()
        )
        self._data = TactileSensorData(
            wrench=torch.from_dlpack(contact.wrench).clone(),
            force_error=torch.from_dlpack(contact.force_error).clone(),
            is_valid=torch.from_dlpack(contact.is_valid).clone(),
            tactile_rgb_image=torch.from_dlpack(contact.images()).clone(),
            tactile_depth_image=torch.from_dlpack(contact.dents).clone()[..., None],
            tactile_normal_force=self._areas_m2 * pressure,
            tactile_shear_force=self._areas_m2[:, None] * shear[..., :2],
            points_m=self._points_m,
        )


@configclass
class TactileSensorCfg(SensorBaseCfg):
    """Settings of a ``TactileSensor``.

    Attributes:
        prim_path: The rigid body that carries the gel. Disable its collider: the sensor is its
            contact.
        object_path: The rigid body that presses.
        indenter: Its shape.
        pad_frame: Middle of the gel's base in its body [m], and quaternion (x, y, z, w); z points
            out of the gel.
        tip_frame: The shape's lowest point in its body [m], and quaternion; z points away from the
            gel.
        gel: Sensor, mesh, friction and loss, as ``GelContact`` takes them.
    """

    class_type: type[TactileSensor] = TactileSensor
    object_path: str = MISSING
    indenter: Indenter = MISSING
    pad_frame: tuple[float, ...] = UNMOVED
    tip_frame: tuple[float, ...] = UNMOVED
    gel: dict[str, Any] = field(default_factory=dict)


def _bodies(model: Any, path: str, count: int) -> list[int]:
    """Return a newton model's bodies of these paths, one an environment."""
    found = [k for k, label in enumerate(model.body_label) if re.fullmatch(path, label)]
    if len(found) != count:
        raise ConfigError(
            f"{path}: {len(found)} rigid bodies in {count} environments",
            remedy="name one rigid body an environment that has a mass and a collider",
        )
    return found
