"""Many presses on one pad at once, at any place, with one set-up for all.

Every environment has its own indenter, pose, friction and gel. docs/explanation/solver.md says what
they share. Arrays stay on the device; on a GPU a step, or a whole trajectory, is one CUDA graph.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.batch import motion_step_kernels as kernels
from sim.batch.contact_inverse import ContactInverse
from sim.batch.motion_steps import BatchOptions, Frames
from sim.batch.sensor_model import ForceBias, bias_of, edge_of, light_moduli, sharp, stiffness_of
from sim.contact.barrier_and_friction_kernels import TouchedSurface
from sim.device import Device, on_host, replaced
from sim.material.elastic_body import element_constants
from sim.material.elasticity_kernels import GelArrays
from sim.mesh.elements import quarter_hats
from sim.scene.indenter import Indenter, IndenterSet
from sim.scene.material import Material
from sim.solve.descent_state import Status
from sim.solve.descents import Descents
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

# A residual that is always enough, over E H^2 with the pad's height H.
_FLOOR_SHARE = 1e-9
# Sums of forces up to this over E H^2 are the same in any order.
_SUMMED_SHARE = 1e3
# Steps that an environment remembers.
_REMEMBERED = 8
# Of the pad's height: the longest way of an indenter in one step, where a sharp edge or friction
# makes the way matter, and of any other.
_STEP_SHARES = (0.1, 0.2)
# Of an edge of the mesh: radius that a sharp edge is given, and up to which a fillet is one.
_RIM_SHARE = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchForces:
    """Forces on the indenters of a batch, shape [environment_count, ...] each.

    ``follow`` adds a first dimension for the frames.

    Attributes:
        wrench: Force [N] and moment about the tip [N m] on the indenter in the pad's frame,
            corrected for the known error of the mesh, shape [..., 6].
        raw_wrench: The same without this correction.
        force_error: Relative error of the force that 19 of 20 presses keep. NaN for a model that
            ``sensor_model`` did not make: its forces cannot be corrected.
        contact_area_m2: Undeformed area that touches the indenter [m^2].
        tips_m: Positions of the tips [m], in the frame of the poses, shape [..., 3].
        residual: Norm of the unbalanced force divided by that of the contact force.
        imbalance: Difference of base reaction and indenter force, divided by the latter.
        valid: True where an equilibrium was found; elsewhere forces are NaN.
        evaluations: Number of force evaluations for this frame.
    """

    wrench: FloatArray
    raw_wrench: FloatArray
    force_error: FloatArray
    contact_area_m2: FloatArray
    tips_m: FloatArray
    residual: FloatArray
    imbalance: FloatArray
    valid: NDArray[np.bool_]
    evaluations: NDArray[np.int32]

    def __getitem__(self, frame: int) -> BatchForces:
        """Return the forces of one frame."""
        return BatchForces(**{name: getattr(self, name)[frame] for name in self.__slots__})


class Batch:
    """Environments that press one pad.

    Args:
        model: A whole pad without relaxation, such as ``sensor_model`` makes.
        indenters: All indenters.
        which: Index into ``indenters`` for each environment, shape [count].
        friction: Coulomb coefficient of each environment, shape [count]; None takes the model's.
            The model needs a friction above zero.
        materials: Materials of the gel's layers, from the camera's side, for each environment;
            None takes the model's.
        bias: What remains of that of F_z under each of ``indenters``, as ``measured_bias`` finds
            it.

    Attributes:
        positions: Nodes of every environment [m], a Warp array of vectors, shape [count,
            node_count]. PyTorch and JAX read it, and the arrays below, through DLPack.
        poses: Poses of the indenters: Warp arrays ``tips`` [m] and ``rotations``.
        pressure: Pressure at the nodes [Pa] at the last call of ``tractions``, shape [count,
            node_count].
        shear: Shear traction on the gel [Pa] at the nodes, Warp vectors, likewise.
        areas_m2: Area of the resting surface around each node, shape [node_count]; zero inside.
        gel: Elements of the environments, for fields of ``positions``.

    Raises:
        ConfigError: The model is a part of a pad or relaxes, or the arguments do not fit together.
    """

    def __init__(
        self,
        model: Model,
        indenters: Sequence[Indenter],
        which: Sequence[int] | NDArray[np.integer[Any]],
        *,
        friction: FloatArray | None = None,
        materials: Sequence[Sequence[Material]] | None = None,
        options: BatchOptions | None = None,
        bias: ForceBias | None = None,
    ) -> None:
        self.model, self.indenters, self.count = model, tuple(indenters), len(which)
        _refuse(model, indenters, which, friction)
        self.options = options or BatchOptions()
        self._device = device = Device(model.device)
        contact = model.contact_options
        own = [model.materials] * self.count
        if materials is not None:
            own = [element_constants(model.mesh, each) for each in materials]
        touched = model.discretisation.touched_element
        young_pa, poisson = np.array([(young[touched], nu[touched]) for young, nu in own]).T
        rim_m = _RIM_SHARE * edge_of(model)
        edged = sharp(indenters, rim_m)[np.asarray(which)]
        careful = (edged > 0) | contact.is_tangential
        self._step_m = model.height_m * np.where(careful, *_STEP_SHARES)
        mu = np.full(self.count, contact.friction) if friction is None else np.asarray(friction)
        share = model.young_pa / young_pa
        self.inverse = ContactInverse(model, count=self.count, young_share=share)
        moduli_pa = young_pa / (1.0 - poisson**2)
        own_bias = bias_of(model, self.inverse).of(edged).scaled(mu, moduli_pa)
        if bias is not None:
            left = bias.of(which)
            own_bias = left._replace(known=left.known + own_bias.known)
        self._bias, self._light_pa = own_bias, light_moduli(model, young_pa, poisson)
        summed_n = _SUMMED_SHARE * young_pa.max() * model.height_m**2
        shift = 1.5 * 2.0 ** float(np.ceil(np.log2(summed_n)))
        self.gel = replaced(GelArrays, model.gel.of(own), shift=shift)
        surface = model.surface.of(young_pa, mu, stiffness_of(model, edged > 0))
        bodies = IndenterSet(bodies=self.indenters, which=tuple(map(int, which)), rounding_m=rim_m)
        self.descents = Descents(
            model,
            bodies,
            self.inverse,
            count=self.count,
            gel=self.gel,
            surface=replaced(TouchedSurface, surface, shift=shift),
            memory=_REMEMBERED,
            young_share=share,
            keeps=True,
        )
        self.inverse.serve(self.descents)
        self.descents.set(
            status=Status.DONE,
            floor=_FLOOR_SHARE * model.young_pa * model.height_m**2,
            steps_max=self.options.steps_max,
            rounding=model.gel.rounding_n,
            gap_least=contact.gap_least_m(contact.extension),
        )
        # Contact begins so far off the indenter, which is held that much higher for it.
        self._standoff_m = contact.distance_m
        nodes = (self.count, len(model.nodes))
        shapes = {"tips": (self.count, 2), "touched": (self.count, 13), "last": nodes}
        shapes["gaps"] = self.descents.memory.gaps.shape
        self._history = device.zeroed(kernels.History, (self.count,), **shapes, older=nodes)
        self.pressure, self.shear = (device.zeros(nodes, kind) for kind in (wp.float64, wp.vec3d))
        hats = quarter_hats(model.reference.face_points)
        self.areas_m2 = np.zeros(len(model.nodes))
        np.add.at(self.areas_m2, model.faces, np.einsum("fq,qk->fk", model.surface.areas, hats))
        self.positions, self.poses = self.descents.positions, self.descents.poses
        self._rest = device.array(model.nodes, wp.vec3d)
        self._chosen = device.zeros(self.count, wp.int32)
        put = [self._rest, self._chosen, True, self.poses, self.descents.state, self._history]
        self._put_back = device.record(kernels.put_back, nodes, [*put, self.positions])
        self._frames: dict[int, Frames] = {}
        self._spreads = self._spreading(hats)
        self.reset()

    @property
    def tips_m(self) -> FloatArray:
        """Positions of the tips [m], in the frame of the poses, shape [environment_count, 3]."""
        return on_host(self._history.tips)[:, 0] - [0.0, 0.0, self._standoff_m]

    def tractions(self) -> tuple[Any, Any]:
        """Compute ``pressure`` and ``shear`` on the gel now, and return them.

        The value at a node is the mean over the adjacent quarters of its faces. Weighted by the
        nodes' areas they sum to the force of the raw wrench.
        """
        self.pressure.zero_()
        self.shear.zero_()
        for each in self._spreads:
            each.launch()
        return self.pressure, self.shear

    def reset(self, mask: Any = None) -> None:
        """Return environments to the untouched gel, with their indenters a metre above it.

        Args:
            mask: Which, shape [environment_count], or a Warp array of int32; None is all.
        """
        self._chosen.assign(self._flags(mask))
        self._put_back.launch()

    def step(
        self,
        poses: FloatArray,
        *,
        loads_n: FloatArray | None = None,
        active: NDArray[np.bool_] | None = None,
    ) -> BatchForces:
        """Move the indenters straight to new poses and find the equilibrium.

        After a reset an indenter comes down along z from above the gel.

        Args:
            poses: Positions of the tips [m] and quaternions (x, y, z, w) from the indenter's frame
                to the pad's, shape [environment_count, 7].
            loads_n: F_z on the indenters [N], shape [environment_count]. It replaces the heights
                of ``poses``, which only start the search where no load was given before.
            active: Environments that take part; None means all. The others keep their state, and
                their forces are NaN.
        """
        loads = None if loads_n is None else np.asarray(loads_n, dtype=np.float64)[None]
        return self.follow(np.asarray(poses)[None], loads_n=loads, active=active)[0]

    def follow(
        self,
        poses: FloatArray,
        *,
        loads_n: FloatArray | None = None,
        active: NDArray[np.bool_] | None = None,
    ) -> BatchForces:
        """Move the indenters along known trajectories.

        The results equal those of ``step`` for each frame, but come sooner: no environment waits
        for the slowest one of a frame. An environment that fails in a frame skips all later ones.

        Args:
            poses: As ``step`` takes them, shape [frame_count, environment_count, 7].
            loads_n: As ``step`` takes them, shape [frame_count, environment_count].
            active: As ``step`` takes it.

        Raises:
            ConfigError: Poses or loads have another shape, or are not finite.
        """
        goals = self._checked(poses)
        loads = None if loads_n is None else np.asarray(loads_n, dtype=np.float64)
        if loads is not None and (loads.shape != goals.shape[:2] or not np.isfinite(loads).all()):
            raise ConfigError(
                f"loads_n of shape {loads.shape}, or with numbers that are not finite, for poses "
                f"of shape {goals.shape}",
                remedy=f"give finite loads [N], shape {goals.shape[:2]}",
            )
        going = self._flags(active)
        if loads is not None:  # who was not pushed before goes to the first frame's height
            pushed = self.descents.get("pushed").copy()
            first = self._go(goals[:1], going * (1 - pushed), None)
            going *= np.maximum(on_host(first.motions.frame), pushed)
        return self._forces(self._go(goals, going, loads).found)

    def settle(self, poses: Any, active: Any) -> Any:
        """Do what ``step`` does with arrays on the device, and leave there what is found.

        Args:
            poses: As ``step`` takes them, but Warp transformd, shape [environment_count].
            active: 1 for who takes part, Warp int32, shape [environment_count].

        Returns:
            ``motion_step_kernels.Found`` of one frame, which the next call overwrites.
        """
        return self._go(poses.reshape((1, self.count)), active, None).found

    def _go(self, goals: Any, going: Any, loads_n: FloatArray | None) -> Frames:
        """Go along goals, pushed by loads where they are given."""
        frame_count = len(goals)
        if frame_count not in self._frames:
            self._frames[frame_count] = Frames(
                self.descents,
                self._history,
                self._rest,
                frame_count,
                longest_m=self._step_m,
                bias=self._bias,
                light_pa=self._light_pa,
                options=self.options,
            )
        frames = self._frames[frame_count]
        frames.motions.goals.assign(goals)
        frames.motions.pushed.fill_(int(loads_n is not None))
        if loads_n is not None:
            frames.motions.loads.assign(loads_n)
        self._history.moves.assign(going)
        frames.go()
        return frames

    def _flags(self, mask: Any) -> Any:
        """Return 1 where a mask is true, on the host unless it is on the device; None is all."""
        if isinstance(mask, wp.array):
            return mask
        flags = np.ones(self.count, np.bool_) if mask is None else np.asarray(mask, np.bool_)
        return flags.astype(np.int32)

    def _spreading(self, hats: FloatArray) -> tuple[Any, Any]:
        """Record what sets pressure and shear, by ``quarter_hats`` at a face's contact points."""
        device, fields = self._device, [self.pressure, self.shear]
        made, shape = self.model.surface.batch_kernels, self.descents.contact_buffers[1].shape
        at = [self.descents.pressed, device.array(hats, wp.float64)]
        spread = device.record(made.spread, tuple(shape), [*at, *fields])
        areas = device.array(self.areas_m2, wp.float64)
        return spread, device.record(kernels.per_area, self.pressure.shape, [areas, *fields])

    def _forces(self, found: Any) -> BatchForces:
        names = ("wrench", "residual", "imbalance", "evaluations")
        same = {name: on_host(getattr(found, name)).copy() for name in names}
        touched, valid = on_host(found.touched).copy(), np.isfinite(same["residual"])
        return BatchForces(
            raw_wrench=touched[..., :6],
            force_error=on_host(found.error).copy(),
            contact_area_m2=touched[..., 6],
            tips_m=np.where(valid[..., None], on_host(found.tips), np.nan),
            valid=valid,
            **same,
        )

    def _checked(self, poses: FloatArray) -> FloatArray:
        goals = np.array(poses, dtype=np.float64)
        if goals.shape[1:] != (self.count, 7) or not len(goals) or not np.isfinite(goals).all():
            raise ConfigError(
                f"poses of shape {goals.shape}, or with numbers that are not finite, for "
                f"{self.count} environments",
                remedy=f"give finite positions [m] and quaternions, shape (..., {self.count}, 7)",
            )
        sizes = np.linalg.norm(goals[..., 3:], axis=-1, keepdims=True)
        if not (sizes > 0.0).all():
            raise ConfigError(
                f"pose {int(np.argmin(sizes)) % self.count}: its quaternion is zero",
                remedy="give (0, 0, 0, 1) for an indenter that is not turned",
            )
        goals[..., 3:] /= sizes
        return goals


def _refuse(
    model: Model, indenters: Sequence[Indenter], which: Any, friction: FloatArray | None
) -> None:
    """End by a ConfigError where a batch cannot be made."""
    if model.relaxation is not None or model.mesh.symmetry.copies > 1:
        raise ConfigError(
            "a batch needs a whole pad of a gel that does not relax",
            remedy="leave relaxation out, and mesh the pad with sensor_mesh",
        )
    if not len(which) or not all(0 <= int(k) < len(indenters) for k in which):
        raise ConfigError(
            f"which: {len(which)} numbers of {len(indenters)} indenters",
            remedy="name the indenter of every environment by its place, from 0",
        )
    if friction is not None and not model.contact_options.friction > 0.0:
        raise ConfigError(
            "friction: the model is made without",
            remedy="make the model with a friction above zero",
        )
