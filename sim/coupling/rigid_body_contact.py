"""Contact between gels and rigid objects of a robot simulator, computed by one ``Batch``.

An engine gives the frames of pads and objects at every substep and gets the forces on both. The gel
is quasi-static: it has no mass, and dissipates only by friction and by ``loss_s``. The engine's own
contact between the two bodies has to be off. The loss acts on the speeds at the end of the engine's
step, so that steps of up to 2 ``loss_s`` are stable for light objects too; without it, while a step
is shorter than 2 sqrt(m / k), with the object's mass m and the gel's stiffness k (about 1 N/mm).
"""

from typing import Any

import numpy as np
import warp as wp

from sim.batch.batch import Batch
from sim.batch.force_bias import EDGE_M, measured_bias
from sim.batch.sensor_model import sensor_model
from sim.coupling import rigid_body_kernels as kernels
from sim.device import Device
from sim.optics.surface_images import SurfaceImages
from sim.scene.indenter import Cylinder, Indenter, MeshIndenter, Sphere
from sim.scene.material import Material
from sim.scene.pad import BoxPad
from sim.sensor.sensor import load_sensor
from tacauchy_rig.core.errors import ConfigError

UNMOVED = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
"""Position and quaternion of a frame that is the body's own."""


class GelContact:
    """Gels, each pressed by one object.

    An engine's adapter fills ``pads`` and ``objects``; then ``press`` sets the attributes, and
    ``react`` the loads. All are arrays on the device, and stay there.

    Args:
        indenter: Shape of the objects.
        count: Gels.
        sensor: Name, or path of a sensor's file.
        edge_m: Edges of the gel's mesh [m]: shorter ones lower the error and take longer. None is
            2.5 mm, and 1 mm with a measured bias.
        measures_bias: Measure the mesh's error of F_z for this indenter at the first set-up, by
            eight presses on fine meshes (about a minute on one core), and correct F_z by it.
        friction: Coulomb coefficient between object and gel.
        loss_s: Viscous forces of the gel over its stiffness times speed [s]; 2 ms are a loss
            tangent of 0.1 at 8 Hz (assumed: sensor files state none). ``wrench`` excludes them.
        device: Where the gels are computed, ``cpu`` or ``cuda:0``.

    Attributes:
        pads: ``rigid_body_kernels.Bodies`` that carry the gels.
        objects: Those that press them.
        wrench: Force [N] and moment about the tip [N m] on the object, pad frame, Warp float64,
            shape [count, 6]; where no equilibrium was found it is the last one.
        force_error: What the force may be off by, over its size, 19 times of 20, shape [count].
        is_valid: The gel found its equilibrium, or nothing touches it, Warp bool, shape [count].
        is_near: 1 where an object is so near that it is pressed, Warp int32, shape [count].
        on_pads: Force [N] on the body in the world, and moment about its centre of mass [N m], at
            the last ``react``, Warp spatial vectors, shape [count].
        on_objects: Likewise.
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
        edge_m: float | None = None,
        measures_bias: bool = False,
        friction: float = 0.5,
        loss_s: float = 2e-3,
        device: str = "cpu",
    ) -> None:
        gel = load_sensor(sensor)
        if not isinstance(gel.pad, BoxPad):
            raise ConfigError(f"sensor {sensor}: its pad is a mesh", remedy="take a box or a dome")
        made: dict[str, Any] = {"friction": friction, "device": device, "layers": gel.layers}
        made["edge_m"] = edge_m or (EDGE_M if measures_bias else 2.5e-3)
        model = sensor_model(gel.pad, gel.material, **made)
        bias = measured_bias(model, gel, [indenter]) if measures_bias else None
        self.batch = Batch(model, [indenter], [0] * count, bias=bias)
        self._drawing = SurfaceImages(model, indenter, gel, count=count)
        half = wp.vec3d(*gel.pad.half_extents(), gel.pad.height_m)
        ball = wp.vec2d(*_bounding_ball(indenter))
        self._shapes = [half, ball, isinstance(indenter, Cylinder)]
        self._model = [_stiffness(gel.material, has_friction=friction > 0.0), friction, loss_s]
        self._device, self._count = on, own = Device(device), (count,)
        self.pads, self.objects = (on.zeroed(kernels.Bodies, own) for _ in range(2))
        self.wrench, self.force_error = on.zeros((count, 6), wp.float64), on.zeros(own, wp.float64)
        self._radii_m, self._poses = on.zeros(own, wp.float64), on.zeros(own, wp.transformd)
        self.is_valid, self._leaves = on.zeros(own, wp.bool), on.zeros(own, wp.bool)
        self.is_near, self._chosen = on.zeros(own, wp.int32), on.zeros(own, wp.int32)
        self.on_pads, self.on_objects = (on.zeros(own, wp.spatial_vectord) for _ in range(2))
        self.is_valid.fill_(True)

    def press(self) -> None:
        """Press the objects into the gels."""
        launch, bodies = self._device.launch, [self.pads, self.objects]
        met = [self.is_near, self._leaves, self._poses]
        launch(kernels.meet, self._count, [*self._shapes, *bodies], met)
        self.reset(self._leaves)
        found = self.batch.settle(self._poses, self.is_near)
        taken = [self.wrench, self.force_error, self._radii_m, self.is_valid]
        launch(kernels.take, self._count, [found, self.is_near], taken)

    def react(self, step_s: float) -> None:
        """Set what contact exerts on both bodies in a step of the engine [s]."""
        acts = [self.pads, self.objects, self._radii_m, self.wrench]
        on = [self.on_pads, self.on_objects]
        self._device.launch(kernels.react, self._count, [*self._model, step_s, *acts], on)

    def reset(self, which: Any = None) -> None:
        """Put gels back to rest, nothing touching them: a mask, or a Warp one; None is all."""
        if not isinstance(which, wp.array):
            flags = np.ones(self._count, np.bool_) if which is None else np.asarray(which)
            which = self._device.array(flags, wp.bool)
        cleared = [self.is_near, self.wrench, self.force_error, self.is_valid, self._chosen]
        self._device.launch(kernels.forget, self._count, [which], cleared)
        self.batch.reset(self._chosen)

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


def _stiffness(material: Material, *, has_friction: bool) -> Any:
    """Return what a rigid disc of radius 1 m in a half-space resists motions with [N/m, N m]."""
    poisson, grip = material.poisson, float(has_friction)
    along = grip * 2.0 * (1.0 - poisson) / (2.0 - poisson)
    shares = [along, along, 1.0, 2.0 / 3.0, 2.0 / 3.0, grip * 4.0 / 3.0 * (1.0 - poisson)]
    return wp.spatial_vectord(2.0 * material.young_pa / (1.0 - poisson**2) * np.array(shares))


def _bounding_ball(indenter: Indenter) -> tuple[float, float]:
    """Return the height of a ball's centre above the tip, and its radius [m]."""
    if isinstance(indenter, Sphere):
        return indenter.diameter_m / 2.0, indenter.diameter_m / 2.0
    if isinstance(indenter, Cylinder):  # of its end; its axis has none
        return 0.0, indenter.diameter_m
    if isinstance(indenter, MeshIndenter):
        return 0.0, float(np.linalg.norm(indenter.surface.vertices, axis=1).max())
    raise ConfigError("a plane has no end", remedy="press with a mesh of a plate")
