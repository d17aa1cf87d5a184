"""Presses of many indenters on one sensor at once, anywhere, without a set-up of their own.

Every environment has its own indenter, pose, friction and modulus; all share the sensor's mesh and
the inverse of its undeformed stiffness (``sim.batch.contact_inverse``). They descend to equilibrium
as a single press does. Arrays stay on the device; on a GPU a step is one CUDA graph with a loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim.batch import pose_kernels as kernels
from sim.batch.contact_inverse import ContactInverse
from sim.batch.pilot import BARRIER_SHARE
from sim.batch.sensor_bias import Rim, force_bias
from sim.batch.step_kernels import copy_grip
from sim.contact.indenter_distance import poses_at
from sim.contact.state import ContactOptions
from sim.device import Device, on_host
from sim.material.laws.tangent import law
from sim.mesh.elements import ElementOrder, quarter_hats
from sim.mesh.refinement import sensor_mesh
from sim.scene.indenter import Cylinder, Indenter, IndenterSet, MeshIndenter
from sim.scene.material import LawName, Material
from sim.scene.pad import BoxPad
from sim.solve.descents import Descents
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

# A residual that is always enough, over E H^2 with the pad's height H.
_FLOOR_SHARE = 1e-9
# Steps that an environment remembers.
_REMEMBERED = 16
# Of the pad's height: the longest way of an indenter in one step, of its tip or of a point so far
# from it, of a rounded body without friction and of any other, for which the way matters; and the
# residual with which the steps before the last may end.
_STEP_SHARES, _ARM_SHARE, _INTERMEDIATE = (0.2, 0.1), 0.75, 1e-2
_LIFTS = 40
# Of an edge of the mesh: radius that a sharp edge is given, and below which one is sharp.
_RIM_SHARE, _SHARP_SHARE = 0.1, 0.25
# Edges of the mesh times the pressure over E / (1 - nu^2) by which contact gives way, under a
# rounded body and under a sharp one, whose edges would sink in: what elements as wide as a contact
# are too stiff by. Without it F_z is 1 to 60 % too large, and a descent takes twice as many steps.
_GIVES, _GIVES_SHARP = 0.05, 0.02
# The bias is known of models that give way like that, up to this factor: a mesh's edges are not
# exactly as long as was asked.
_SAME_GIVES = 2.0
# How often a load is corrected at most, and the change of a bias that is none.
_PUSHES, _SAME_BIAS = 8, 5e-4
# Edges of the mesh by which a point may overlap.
_OVERLAP_SHARE = 0.4


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseOptions:
    """Settings of the solver.

    Attributes:
        residual_relative: Norm of the unbalanced force over the contact force.
        steps_max: Of a descent.
        halvings_max: How often a step is halved that does not arrive.
    """

    residual_relative: float = 1e-3
    steps_max: int = 300
    halvings_max: int = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Felt:
    """What the indenters of a batch feel, shape [environment_count, ...] each.

    Attributes:
        wrench: Force [N] and moment about the tip [N m] on the indenter, pad frame, without the
            mesh's bias, shape [..., 6].
        raw_wrench: With it, as the mesh is in balance.
        force_error: What the force may be off by, over its size: 19 of 20 are within. NaN for a
            model that ``sensor_model`` did not make: its bias is unknown, and stays.
        contact_area_m2: Of what touches, at rest [m^2].
        residual: Norm of the unbalanced force over the contact force's.
        valid: The environment found its equilibrium; what it felt is not a number otherwise.
        evaluations: Of the forces, in this step.
    """

    wrench: FloatArray
    raw_wrench: FloatArray
    force_error: FloatArray
    contact_area_m2: FloatArray
    residual: FloatArray
    valid: NDArray[np.bool_]
    evaluations: NDArray[np.int32]


def sensor_model(
    pad: BoxPad,
    material: Material,
    *,
    edge_m: float = 1.25e-3,
    friction: float = 0.0,
    law_name: LawName = LawName.STABLE_NEO_HOOKEAN,
    device: str = "cpu",
) -> Model:
    """Mesh a sensor's pad for presses anywhere on it, and set up its model.

    Args:
        material: Of the whole gel.
        edge_m: Edge length at the surface [m]; nodes are half of it apart.
        friction: Coulomb coefficient mu of environments that have none of their own; a model with
            zero has no friction at all.

    Raises:
        ConfigError: The mesh would have too many tetrahedra.
    """
    distance_m = BARRIER_SHARE * pad.height_m
    options = ContactOptions(
        distance_m=distance_m,
        friction=friction,
        extension=1.0,
        overlap=_OVERLAP_SHARE * edge_m / distance_m,
        stiffness=distance_m / (_GIVES * edge_m * (1.0 - material.poisson**2)),
    )
    return Model(
        sensor_mesh(pad, edge_m=edge_m),
        order=ElementOrder.P2,
        law=law(law_name),
        young_pa=material.young_pa,
        poisson=material.poisson,
        contact_options=options,
        device=device,
    )


class SensorBatch:
    """Environments over one sensor's pad.

    Args:
        model: The pad, whole, without relaxation, as ``sensor_model`` makes it.
        indenters: The bodies that press.
        which: The one of every environment, by its place among them, shape [count].
        friction: Coulomb coefficients, shape [count]; None is the model's. Only a model with
            friction takes them.
        young_share: E of the gel over the model's, shape [count]; None is 1.

    Attributes:
        positions: Nodes of every environment [m], a Warp array of vectors, shape [count,
            node_count]; PyTorch and JAX take it through DLPack, as all arrays named here.
        poses: Where the indenters are: Warp arrays ``tips`` [m] and ``rotations``.
        pressure: At the nodes [Pa] when ``tractions`` was called last, shape [count, node_count].
        shear: On the gel [Pa], Warp vectors, likewise.

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
        young_share: FloatArray | None = None,
        options: PoseOptions | None = None,
    ) -> None:
        self.model, self.count = model, len(which)
        _refuse(model, indenters, which)
        self.options = options or PoseOptions()
        self._device = device = Device(model.device)
        shares = np.ones(self.count) if young_share is None else np.asarray(young_share, float)
        if friction is not None and not model.contact_options.friction > 0.0:
            raise ConfigError(
                "friction: the model is made without",
                remedy="make the model with a friction above zero",
            )
        usual = np.full(self.count, model.contact_options.friction)
        mu = usual if friction is None else np.asarray(friction, dtype=np.float64)
        young_pa, poisson = model.materials
        self._edge_m = float(np.sqrt(2.0 * np.median(model.discretisation.face_areas)))
        narrow_m = _SHARP_SHARE * self._edge_m
        self._rims = np.array([_rim(indenters[int(k)], narrow_m) for k in which])
        is_round = self._rims == Rim.ROUND
        stiffness = model.contact_options.stiffness * np.where(is_round, 1.0, _GIVES / _GIVES_SHARP)
        careful = ~is_round | model.contact_options.is_tangential
        longest, short = _STEP_SHARES
        self._step_m = model.height_m * np.where(careful, short, longest)
        contact, softness = model.contact_options, 1.0 - float(np.median(poisson)) ** 2
        gives = contact.distance_m / (contact.stiffness * self._edge_m * softness)
        self._bias_known = 1.0 / _SAME_GIVES < gives / _GIVES < _SAME_GIVES
        self.inverse = ContactInverse(model, count=self.count, young_share=1.0 / shares)
        self.descents = Descents(
            model,
            IndenterSet(
                bodies=tuple(indenters),
                which=tuple(int(k) for k in which),
                rounding_m=_RIM_SHARE * self._edge_m,
            ),
            self.inverse,
            count=self.count,
            gel=model.gel.of([(share * young_pa, poisson) for share in shares]),
            surface=model.surface.of(
                (shares * model.young_pa).tolist(), mu.tolist(), stiffness.tolist()
            ),
            memory=_REMEMBERED,
            young_share=1.0 / shares,
            keeps=True,
        )
        self.inverse.serve(self.descents)
        contact = model.contact_options
        # Contact begins so far off the indenter, which is held that much higher for it.
        self._standoff_m = contact.distance_m
        self.descents.set(
            floor=_FLOOR_SHARE * model.young_pa * model.height_m**2,
            steps_max=self.options.steps_max,
            rounding=model.gel.rounding_n,
            touches=1,
            gap_least=contact.gap_least_m(contact.extension),
        )
        nodes = (self.count, len(model.nodes))
        self._history = device.zeroed(
            kernels.PoseHistory, (self.count,), tips=(self.count, 2), last=nodes, older=nodes
        )
        self._ways = device.zeroed(kernels.Ways, (self.count,), enough=(2,))
        self._wrench = device.zeros((self.count, 7), wp.float64)
        self.pressure, self.shear = (device.zeros(nodes, kind) for kind in (wp.float64, wp.vec3d))
        self.positions, self.poses = self.descents.positions, self.descents.poses
        self._at = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (self.count, 1))
        self._lifted = np.zeros(self.count, dtype=np.bool_)
        self._graph: Any = None
        self._launches = self._recorded()
        self.reset()

    @property
    def tips_m(self) -> FloatArray:
        """Where the tips are [m], in the frame of the poses, shape [environment_count, 3]."""
        return self._at[:, :3] - [0.0, 0.0, self._standoff_m]

    def tractions(self) -> tuple[Any, Any]:
        """Set ``pressure`` and ``shear`` to what acts on the gel now, and return them.

        A node's is the mean around it, over the parts of its faces that it is the corner of; their
        sum with the nodes' areas is the raw wrench's force.
        """
        self.pressure.zero_()
        self.shear.zero_()
        for each in self._spreads:
            each.launch()
        return self.pressure, self.shear

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Put environments back to the untouched gel, their indenters away from it."""
        self._lifted[np.ones(self.count, np.bool_) if mask is None else mask] = False

    def step(
        self,
        poses: FloatArray,
        *,
        loads_n: FloatArray | None = None,
        active: NDArray[np.bool_] | None = None,
    ) -> Felt:
        """Take the indenters to poses, straight from where they are, and find the equilibrium.

        One that was not lowered yet comes down along z from above the gel.

        Args:
            poses: Positions of the tips [m] and quaternions (x, y, z, w) from the indenter's frame
                to the pad's, shape [environment_count, 7].
            loads_n: F_z that pushes the indenters [N], shape [environment_count]; their heights
                are found then, and those of ``poses`` are where the search begins.
            active: Who takes part; None is all. The others stay as they are.
        """
        goals = self._checked(poses)
        taking = np.ones(self.count, np.bool_) if active is None else np.asarray(active, np.bool_)
        before = on_host(self.descents.state.evaluations).copy()
        if (taking & ~self._lifted).any():
            self._lower_anew(goals, taking & ~self._lifted)
        self.descents.set(pushed=0)
        there = self._go(goals, taking, self._parts(goals))
        if loads_n is not None:
            self.descents.set(pushed=1)
            there = self._push(goals, there, np.asarray(loads_n, dtype=np.float64))
        return self._felt(there, before)

    def _push(
        self, goals: FloatArray, there: NDArray[np.bool_], load_n: FloatArray
    ) -> NDArray[np.bool_]:
        """Push with a load that has the mesh's bias, which is known once the contact is."""
        bias = self._bias(self._touched())[0]
        for _ in range(_PUSHES):
            self._ways.loads.assign(load_n * (1.0 + bias))
            there = self._go(goals, there, np.ones(self.count, dtype=np.int32))
            self._at[:, :3] = on_host(self.poses.tips)
            before, bias = bias, self._bias(self._touched())[0]
            if np.abs(bias - before)[there].max(initial=0.0) < _SAME_BIAS:
                break
        return there

    def _parts(self, goals: FloatArray) -> NDArray[np.int32]:
        """Return in how many parts each environment goes."""
        height = self.model.height_m
        travel = np.linalg.norm(goals[:, :3] - self._at[:, :3], axis=1)
        travel += _ARM_SHARE * height * np.linalg.norm(self._turns(goals), axis=1)
        parts = np.ceil(travel / self._step_m - 1e-9)
        return np.asarray(np.maximum(parts, 1.0), dtype=np.int32)

    def _turns(self, goals: FloatArray) -> FloatArray:
        """Return the rotation vectors from where the indenters are [rad]."""
        before = Rotation.from_quat(self._at[:, 3:])
        return np.asarray((Rotation.from_quat(goals[:, 3:]) * before.inv()).as_rotvec())

    def _go(
        self, goals: FloatArray, going: NDArray[np.bool_], parts: NDArray[np.int32]
    ) -> NDArray[np.bool_]:
        """Go somewhere, each in its parts, in more and more of them who do not arrive.

        Returned is who arrives; the others are as far as they came.
        """
        missing = going.copy()
        for _ in range(self.options.halvings_max + 1):
            turns, ways = self._turns(goals), self._ways
            relative = self.options.residual_relative
            ways.enough.assign(np.array([relative, max(relative, _INTERMEDIATE)]))
            ways.tips.assign(self._at[:, :3])
            ways.travels.assign(goals[:, :3] - self._at[:, :3])
            ways.rotations.assign(Rotation.from_quat(self._at[:, 3:]).as_matrix())
            ways.turns.assign(turns)
            ways.parts.assign(parts)
            ways.done.zero_()
            self._history.moves.assign(missing.astype(np.int32))
            self._run()
            done = on_host(ways.done) / parts
            share = np.where(missing, done, 0.0)[:, None]
            self._at[:, :3] += share * (goals[:, :3] - self._at[:, :3])
            turned = Rotation.from_rotvec(share * turns) * Rotation.from_quat(self._at[:, 3:])
            self._at[:, 3:] = turned.as_quat()
            missing &= done < 1.0
            if not missing.any():
                break
            parts = 2 * np.maximum(parts - on_host(ways.done).astype(np.int32), 1)
        return going & ~missing

    def _run(self) -> None:
        if self._device.is_gpu and self._graph is None:
            self._launch()  # compiles the kernels, which a graph cannot
            with wp.ScopedCapture(device=self._device.name) as capture:
                self._launch()
            self._graph = capture.graph
        elif self._graph is not None:
            wp.capture_launch(self._graph)
        else:
            self._launch()

    def _launch(self) -> None:
        begin, ends, _wrench = self._launches
        busy = self.descents.busy
        busy.zero_()

        def go_on() -> None:
            self.descents.step()
            for each in (*ends, *begin):
                each.launch()

        for each in begin:
            each.launch()
        wp.capture_while(busy, while_body=go_on)

    def _recorded(self) -> tuple[list[Any], list[Any], Any]:
        """Record what begins and what ends the parts, and what the indenters feel."""
        descents, history, ways = self.descents, self._history, self._ways
        model, state, record = self.model, descents.state, self._device.record
        nodes, shape = tuple(descents.positions.shape), tuple(descents.contact_buffers[1].shape)
        lags = model.contact_options.friction > 0.0
        begun = [lags, ways, history, descents.poses, state, descents.memory, descents.busy]
        start = [history, descents.positions, descents.gel_buffers[0], descents.contact_buffers[0]]
        begin = [record(kernels.begin, (self.count,), begun)]
        ends = [record(kernels.arrive, (self.count,), [state, descents.poses, ways, history])]
        made = model.surface.kernels(descents.indenter)
        at = [descents.surface, descents.body]
        if model.contact_options.is_tangential:
            grip, kept = descents.grip, descents.grip_start
            # One that did not arrive may have left other grips than it began with.
            begin.append(record(copy_grip, shape, [history.starts, 1, kept, grip]))
            moved = [*at, history.arrives, descents.poses, descents.positions]
            ends.append(record(made.drag, shape, [*moved, grip]))
            ends.append(record(copy_grip, shape, [history.arrives, 1, grip, kept]))
        begin.append(record(kernels.predict, nodes, start))
        ends.append(record(kernels.remember, nodes, [descents.positions, history]))
        now = [descents.poses, descents.grip, descents.positions]
        fields, reference = [self.pressure, self.shear], model.reference
        hats = quarter_hats(reference.face_points)
        areas = np.zeros(nodes[1])
        np.add.at(areas, model.faces, np.einsum("fq,qk->fk", model.surface.areas, hats))
        table = self._device.array(hats, wp.float64)
        self._spreads = (
            record(made.spread, shape, [*at, table, *now, *fields]),
            record(kernels.per_area, nodes, [self._device.array(areas, wp.float64), *fields]),
        )
        return begin, ends, record(made.wrench, shape, [*at, *now, self._wrench])

    def _touched(self) -> FloatArray:
        """Return raw wrenches and the areas in contact [m^2], shape [environment_count, 7]."""
        self._wrench.zero_()
        self._launches[2].launch()
        return on_host(self._wrench).copy()

    def _bias(self, touched: FloatArray) -> tuple[FloatArray, FloatArray]:
        if not self._bias_known:
            return np.zeros(self.count), np.full(self.count, np.nan)
        lengths = {"edge_m": self._edge_m, "height_m": self.model.height_m}
        return force_bias(touched[:, 6], rims=self._rims, **lengths)

    def _felt(self, there: NDArray[np.bool_], before: FloatArray) -> Felt:
        state, touched = self.descents.state, self._touched()
        residual = on_host(state.residual) / np.maximum(on_host(state.scale), on_host(state.floor))
        touched[~there], residual[~there] = np.nan, np.nan
        bias, left = self._bias(touched)
        return Felt(
            wrench=touched[:, :6] / (1.0 + bias)[:, None],
            raw_wrench=touched[:, :6],
            force_error=left,
            contact_area_m2=touched[:, 6],
            residual=residual,
            valid=there,
            evaluations=(on_host(state.evaluations) - before).astype(np.int32),
        )

    def _lower_anew(self, goals: FloatArray, new: NDArray[np.bool_]) -> None:
        """Put indenters over their goals, about to touch the resting gel, which has forgotten."""
        descents, device, surface = self.descents, self._device, self.model.surface
        wanted = device.array(new, wp.int32)
        turns = Rotation.from_quat(goals[:, 3:]).as_matrix()
        poses = poses_at(goals[:, :3], turns, device)
        nodes = device.array(self.model.nodes, wp.vec3d)
        put = [nodes, wanted, poses, self._history, descents.positions]
        device.launch(kernels.put_back, tuple(descents.positions.shape), put, [])
        made, buffers = surface.kernels(descents.indenter), surface.buffers(self.count)
        points, gaps = buffers[2].shape, buffers[2].reshape((self.count, -1))
        free = surface.grip_arrays(None, self.count)
        at = [descents.surface, descents.body, wanted, poses]
        least, threads = self.model.contact_options.distance_m, 256 if device.is_gpu else 1
        lift = device.record(kernels.lift, (self.count, threads), [gaps, least, poses], threads)
        for _ in range(_LIFTS):
            device.launch(made.touch, points, [*at, free, descents.positions], list(buffers))
            lift.launch()
        device.launch(kernels.put_back, tuple(descents.positions.shape), put, [])
        if self.model.contact_options.is_tangential:
            for grip in (descents.grip, descents.grip_start):
                device.launch(kernels.let_go, points, [wanted, grip], [])
                device.launch(made.drag, points, [*at, descents.positions, grip], [])
        tips = on_host(poses.tips)
        self._at[new] = np.column_stack([tips, goals[:, 3:]])[new]
        self._lifted |= new

    def _checked(self, poses: FloatArray) -> FloatArray:
        goals = np.array(poses, dtype=np.float64)
        if goals.shape != (self.count, 7) or not np.isfinite(goals).all():
            raise ConfigError(
                f"poses of shape {goals.shape}, or with numbers that are not finite, for "
                f"{self.count} environments",
                remedy=f"give finite positions [m] and quaternions, shape ({self.count}, 7)",
            )
        sizes = np.linalg.norm(goals[:, 3:], axis=1, keepdims=True)
        if not (sizes > 0.0).all():
            raise ConfigError(
                f"pose {int(np.argmin(sizes))}: its quaternion is zero",
                remedy="give (0, 0, 0, 1) for an indenter that is not turned",
            )
        goals[:, 3:] /= sizes
        goals[:, 2] += self._standoff_m
        return goals


def _rim(indenter: Indenter, narrow_m: float) -> Rim:
    if isinstance(indenter, Cylinder) and indenter.fillet_m > 0.0:
        return Rim.ROUND if indenter.fillet_m >= narrow_m else Rim.NARROW
    return Rim.SHARP if isinstance(indenter, Cylinder | MeshIndenter) else Rim.ROUND


def _refuse(model: Model, indenters: Sequence[Indenter], which: Any) -> None:
    """End where a batch cannot be made.

    Raises:
        ConfigError: Says why.
    """
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
