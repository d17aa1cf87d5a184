"""Contact between gels and rigid objects of a robot simulator, computed by one ``Batch``.

An engine gives the frames of pads and objects at every substep and gets the forces on both. The gel
is quasi-static: it has no mass, and dissipates only by friction and by ``loss_s``. The engine's own
contact between the two bodies has to be off. The loss acts on the speeds at the end of the engine's
step, so that steps of up to 2 ``loss_s`` are stable for light objects too; without it, while a step
is shorter than 2 sqrt(m / k), with the object's mass m and the gel's stiffness k (about 1 N/mm).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim.batch.batch import Batch
from sim.batch.sensor_model import sensor_model
from sim.optics.surface_images import SurfaceImages
from sim.scene.indenter import Cylinder, Indenter, MeshIndenter, Sphere
from sim.scene.pad import BoxPad
from sim.sensor.sensor import load_sensor
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

# An object this near to the gel [m] is pressed; one farther away touches nothing.
_NEAR_M = 0.2e-3
# Cosine of the tilt from which a cylinder, whose axis does not end, may touch with its side.
_UPRIGHT = 0.7
UNMOVED = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
"""Position and quaternion of a frame that is the body's own."""


class Frames(NamedTuple):
    """Frames in the world: origins [m], shape [count, 3], and rotations."""

    at: FloatArray
    turn: Rotation

    @classmethod
    def of(cls, poses: FloatArray) -> Frames:
        """Return frames of positions [m] and quaternions (x, y, z, w), shape [count, 7]."""
        return cls(poses[:, :3], Rotation.from_quat(poses[:, 3:]))

    def then(self, offset: FloatArray) -> Frames:
        """Return the frames that have this position and quaternion in these, shape [7]."""
        own = Rotation.from_quat(offset[3:])
        return Frames(self.at + self.turn.apply(offset[:3]), self.turn * own)


class Motions(NamedTuple):
    """Rigid bodies in the world, shape [count, ...] each."""

    centres_m: FloatArray
    velocities: FloatArray  # of the centres of mass [m/s]
    spins: FloatArray  # [rad/s]
    inverse_masses: FloatArray  # [1/kg], zero for a body that is held
    inverse_inertias: FloatArray  # about the centres, along the world's axes, [count, 3, 3]

    def at(self, points_m: FloatArray) -> FloatArray:
        """Return velocity [m/s] and angular velocity [rad/s] at points, shape [count, 6]."""
        swept = np.cross(self.spins, points_m - self.centres_m)
        return np.column_stack([self.velocities + swept, self.spins])

    def mobility(self, points_m: FloatArray) -> FloatArray:
        """Return linear and angular acceleration at points per wrench there, [count, 6, 6]."""
        arms = np.tile(np.eye(6), (len(points_m), 1, 1))
        arms[:, :3, 3:] = np.cross((points_m - self.centres_m)[:, None], np.eye(3))
        inverse = np.zeros_like(arms)
        inverse[:, :3, :3] = self.inverse_masses[:, None, None] * np.eye(3)
        inverse[:, 3:, 3:] = self.inverse_inertias
        return np.asarray(arms @ inverse @ arms.transpose(0, 2, 1))


class GelContact:
    """Gels, each pressed by one object.

    Args:
        indenter: Shape of the objects.
        count: Gels.
        sensor: Name, or path of a sensor's file.
        edge_m: Edges of the gel's mesh [m]: shorter ones lower the error and take longer.
        friction: Coulomb coefficient between object and gel.
        loss_s: Viscous forces of the gel over its stiffness times speed [s]; 2 ms are a loss
            tangent of 0.1 at 8 Hz (assumed: sensor files state none). ``wrench`` excludes them.
        device: Where the gels are computed, ``cpu`` or ``cuda:0``.

    Attributes:
        wrench: Force [N] and moment about the tip [N m] on the object, pad frame, shape [count,
            6]; where no equilibrium was found it is the last one.
        force_error: What the force may be off by, over its size, 19 times of 20, shape [count].
        is_valid: The gel found its equilibrium, or nothing touches it, shape [count].
        batch: The gels; ``batch.tractions()`` gives pressure and shear on the device.

    Raises:
        ConfigError: The sensor's pad is a mesh, or the shape has no end.
    """

    def __init__(
        self,
        indenter: Indenter,
        *,
        count: int,
        sensor: str = "gelsight-mini",
        edge_m: float = 2.5e-3,
        friction: float = 0.5,
        loss_s: float = 2e-3,
        device: str = "cpu",
    ) -> None:
        gel = load_sensor(sensor)
        if not isinstance(gel.pad, BoxPad):
            raise ConfigError(f"sensor {sensor}: its pad is a mesh", remedy="take a box or a dome")
        self._pad, self._ball, self._loss_s = gel.pad, _bounding_ball(indenter), loss_s
        self._is_rod = isinstance(indenter, Cylinder)
        made: dict[str, Any] = {"edge_m": edge_m, "friction": friction, "device": device}
        model = sensor_model(gel.pad, gel.material, layers=gel.layers, **made)
        self.batch = Batch(model, [indenter], [0] * count)
        self._material, self._friction = gel.material, friction
        self._drawing = SurfaceImages(model, indenter, gel, count=count)
        self.wrench, self.force_error = np.zeros((count, 6)), np.zeros(count)
        self._radii_m = np.zeros(count)  # of discs as large as what touches
        self.is_valid, self.is_near = np.ones(count, np.bool_), np.zeros(count, np.bool_)

    def press(self, pads: Frames, tips: Frames) -> None:
        """Press the objects into the gels.

        Args:
            pads: Middles of the gels' bases; z points out of the gel.
            tips: Lowest points of the shapes; z points away from the gel.
        """
        at = pads.turn.inv().apply(tips.at - pads.at)
        turn = pads.turn.inv() * tips.turn
        height_m, radius_m = self._ball
        centres, reach_m = at + turn.apply([0.0, 0.0, height_m]), np.full(len(at), radius_m)
        if self._is_rod:  # as soon as it lies it reaches anywhere
            reach_m[turn.as_matrix()[:, 2, 2] < _UPRIGHT] = np.inf
        near = centres[:, 2] - reach_m < self._pad.height_m + _NEAR_M
        near &= centres[:, 2] > 0.0  # below its base nothing is pressed
        beside = np.abs(centres[:, :2]) - np.array(self._pad.half_extents())
        near &= beside.max(axis=1) < reach_m
        self.reset(self.is_near & ~near)
        self.is_near = near
        if near.any():
            found = self.batch.step(np.column_stack([at, turn.as_quat()]), active=near)
            arrived = found.valid & near
            self.wrench[arrived] = found.wrench[arrived]
            self.force_error[near] = found.force_error[near]
            self._radii_m[arrived] = np.sqrt(found.contact_area_m2[arrived] / np.pi)
            self.is_valid = arrived | ~near

    def loads(
        self, pads: Frames, tips: Frames, pad_motions: Motions, motions: Motions, step_s: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return what the contact exerts on pads' bodies and on objects in a step, in the world.

        Returns:
            Force [N], and moment about the body's centre of mass [N m], shape [count, 6] each.
        """
        turn = np.kron(np.eye(2), pads.turn.as_matrix())
        back = turn.transpose(0, 2, 1)
        speeds = back @ (motions.at(tips.at) - pad_motions.at(tips.at))[..., None]
        mobility = back @ (motions.mobility(tips.at) + pad_motions.mobility(tips.at)) @ turn
        viscous = self._loss_s * self._stiffness()[..., None]
        lost = np.linalg.solve(np.eye(6) + step_s * viscous * mobility, viscous * speeds)[..., 0]
        # Friction bounds what acts along the surface, and no contact pulls.
        a, one = self._radii_m, np.ones(len(lost))
        mu = self._friction * one
        most = np.column_stack([mu, mu, one, a, a, mu * a]) * np.maximum(self.wrench[:, 2:3], 0.0)
        felt = self.wrench - np.clip(lost, -most, most)
        sizes = [np.linalg.norm(each[:, :2], axis=1) for each in (self.wrench, felt)]
        holds = np.maximum(most[:, 0], sizes[0]) / np.maximum(sizes[1], np.finfo(float).tiny)
        felt[:, :2] *= np.minimum(holds, 1.0)[:, None]
        wrench = (turn @ felt[..., None])[..., 0]
        on_object, on_pad = (
            np.column_stack([force, moment + np.cross(tips.at - body.centres_m, force)])
            for force, moment in [(wrench[:, :3], wrench[:, 3:])]
            for body in (motions, pad_motions)
        )
        return -on_pad, on_object

    def _stiffness(self) -> FloatArray:
        """Return what a rigid disc in a half-space resists motions with [N/m, N m], [count, 6]."""
        poisson, radii_m = self._material.poisson, self._radii_m
        normal = 2.0 * radii_m * self._material.young_pa / (1.0 - poisson**2)
        grip = float(self._friction > 0.0)
        along = grip * 2.0 * (1.0 - poisson) / (2.0 - poisson)
        shares = np.array(
            [along, along, 1.0, 2.0 / 3.0, 2.0 / 3.0, grip * 4.0 / 3.0 * (1.0 - poisson)]
        )
        lengths = np.column_stack([np.ones((len(radii_m), 3)), np.tile(radii_m[:, None] ** 2, 3)])
        return np.asarray(normal[:, None] * shares * lengths)

    def reset(self, which: NDArray[np.bool_] | None = None) -> None:
        """Put gels back to rest, nothing touching them; None is all."""
        chosen = np.ones(len(self.wrench), np.bool_) if which is None else which
        self.batch.reset(chosen)
        self.wrench[chosen], self.force_error[chosen], self.is_near[chosen] = 0.0, 0.0, False
        self.is_valid[chosen] = True

    def images(self) -> Any:
        """Return what the cameras see, a Warp array of uint8, [count, height, width, 3]."""
        poses = self.batch.poses
        return self._drawing.images(self.batch.positions, poses.tips, poses.rotations)

    @property
    def dents(self) -> Any:
        """Height that the gels lost in the last images [m], Warp float32, shaped as they are."""
        return self._drawing.dents

    def markers(self) -> Any:
        """Return where markers are [px], Warp float32 [count, marker_count, 2]: column and row."""
        return self._drawing.markers(self.batch.positions)


def _bounding_ball(indenter: Indenter) -> tuple[float, float]:
    """Return the height of a ball's centre above the tip, and its radius [m]."""
    if isinstance(indenter, Sphere):
        return indenter.diameter_m / 2.0, indenter.diameter_m / 2.0
    if isinstance(indenter, Cylinder):  # of its end; its axis has none
        return 0.0, indenter.diameter_m
    if isinstance(indenter, MeshIndenter):
        return 0.0, float(np.linalg.norm(indenter.surface.vertices, axis=1).max())
    raise ConfigError("a plane has no end", remedy="press with a mesh of a plate")
