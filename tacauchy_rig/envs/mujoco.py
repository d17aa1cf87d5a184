"""A tactile sensor for MuJoCo: one gel, and one object that presses it.

``python -m tacauchy_rig.envs.mujoco`` drops a ball on a gel and prints wrench over weight.
"""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import typer

from sim.coupling.rigid_body_contact import UNMOVED, GelContact
from sim.device import start_warp
from sim.scene.indenter import Indenter, Sphere
from sim.sensor.sensor import load_sensor
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.versions import library

mujoco = library("mujoco", extra="mujoco")

_BALL = """
<mujoco><option timestep="0.001"/><worldbody>
  <body name="pad"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
  <body name="ball" pos="0 0 {height_m}"><freejoint/>
    <geom type="sphere" size="{radius_m}" pos="0 0 {radius_m}" mass="{mass_kg}" contype="0"
      conaffinity="0"/>
  </body>
</worldbody></mujoco>
"""


class TactileSensor:
    """A gel on a body of a MuJoCo model.

    Call ``update`` before every ``mj_step``: it presses the object where it is and sets the forces
    on both bodies in ``data.xfrc_applied``. Give the bodies no contact of MuJoCo's own
    (``contype`` and ``conaffinity`` 0, or an ``exclude``).

    Args:
        pad: Name of the body that carries the gel.
        tip: Name of the body that presses it.
        indenter: Its shape.
        pad_frame: Middle of the gel's base in its body [m], and quaternion (x, y, z, w).
        tip_frame: Lowest point of the shape in its body [m], and quaternion.
        settings: As ``GelContact`` takes them.

    Attributes:
        contact: The gel: ``wrench``, ``force_error``, ``is_valid``, ``images()``.

    Raises:
        ConfigError: The model has no body of that name.
    """

    def __init__(
        self,
        model: Any,
        pad: str,
        tip: str,
        indenter: Indenter,
        *,
        pad_frame: Sequence[float] = UNMOVED,
        tip_frame: Sequence[float] = UNMOVED,
        **settings: Any,
    ) -> None:
        self._model = model
        self._bodies = tuple(_body(model, name) for name in (pad, tip))
        self._frames = [np.asarray(frame, np.float64) for frame in (pad_frame, tip_frame)]
        self.contact = GelContact(indenter, count=1, **settings)

    def update(self, data: Any) -> None:
        """Press the object into the gel, and set the forces on both bodies."""
        for of_state in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel):
            of_state(self._model, data)  # mj_step leaves those of its beginning
        contact = self.contact
        sides = zip(self._bodies, self._frames, (contact.pads, contact.objects), strict=True)
        for body, frame, bodies in sides:
            self._set(bodies, data, body, frame)
        contact.press()
        contact.react(self._model.opt.timestep)
        for body, loads in zip(self._bodies, (contact.on_pads, contact.on_objects), strict=True):
            data.xfrc_applied[body] = loads.numpy()[0]

    def _set(self, bodies: Any, data: Any, body: int, frame: FloatArray) -> None:
        """Set a side of the contact to where a body is, and to how it moves."""
        at, turned = np.zeros(3), np.zeros(4)
        mujoco.mju_mulPose(
            at, turned, data.xpos[body], data.xquat[body], frame[:3], np.roll(frame[3:], 1)
        )
        speeds = np.zeros(6)
        mujoco.mj_objectVelocity(self._model, data, mujoco.mjtObj.mjOBJ_BODY, body, speeds, 0)
        turn = data.ximat[body].reshape(3, 3)
        mass, inertia = self._model.body_mass[body], self._model.body_inertia[body]
        moves = self._model.body_weldid[body] > 0 and mass > 0.0  # 0 is the world
        inverse = moves * (turn / np.where(inertia > 0.0, inertia, np.inf)) @ turn.T
        bodies.frames.assign(np.r_[at, np.roll(turned, -1)][None])
        bodies.centres.assign(data.xipos[body][None])
        bodies.velocities.assign(speeds[None, 3:])
        bodies.spins.assign(speeds[None, :3])
        bodies.inverse_masses.assign(np.array([1.0 / mass if moves else 0.0]))
        bodies.inverse_inertias.assign(inverse[None])


def _body(model: Any, name: str) -> int:
    found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    if found < 0:
        raise ConfigError(f"the MuJoCo model has no body {name!r}", remedy="name one of its bodies")
    return int(found)


def ball_on_pad(
    *, mass_kg: float = 0.02, fall_m: float = 1e-4, **settings: Any
) -> tuple[Any, TactileSensor]:
    """Return a model of a ball of 8 mm above a gel that is held fast, and its sensor."""
    height_m = load_sensor("gelsight-mini").pad.height_m + fall_m
    xml = _BALL.format(height_m=height_m, radius_m=4e-3, mass_kg=mass_kg)
    model = mujoco.MjModel.from_xml_string(xml)
    return model, TactileSensor(model, "pad", "ball", Sphere(diameter_m=8e-3), **settings)


def main(steps: int = 400) -> None:
    """Drop a ball on a gel, and print wrench over weight, and steps per second."""
    start_warp()
    typer.echo("compiling kernels: a minute the first time")
    model, sensor = ball_on_pad()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    sensor.update(data)
    started = said = time.perf_counter()
    for k in range(steps):
        mujoco.mj_step(model, data)
        sensor.update(data)
        if time.perf_counter() - said > 2.0:
            said = time.perf_counter()
            typer.echo(f"step {k + 1} of {steps}: {sensor.contact.wrench.numpy()[0, 2]:.4f} N")
    ratio = sensor.contact.wrench.numpy()[0, 2] / (0.02 * 9.81)
    rate = steps / (time.perf_counter() - started)
    typer.echo(f"wrench over weight: {ratio:.4f}; {rate:.0f} steps/s")


if __name__ == "__main__":
    typer.run(main)
