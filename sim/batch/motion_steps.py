"""The launches that take a batch through frames, and what they find; on a GPU one graph."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from sim.batch import motion_step_kernels as kernels
from sim.batch.overlap_kernels import THREADS, overlap
from sim.batch.sensor_model import (
    ForceBias,
    face_shares,
    pressure_form,
    quarter_values,
    reach_of,
    resting_gel,
)
from sim.contact.barrier_and_friction_kernels import WRENCH_THREADS, Pressed
from sim.contact.indenter_distance import Poses, body_of
from sim.device import Device, replaced
from sim.solve.descents import Descents
from tacauchy_rig.core.arrays import FloatArray

# Steps of a descent after which a graph asks again whether an environment is busy.
_STEPS_ON_GPU = 3
_LOWERINGS = 40
# Of the most steps of a descent: evaluations in a frame after which none is begun in smaller parts.
_GIVES_UP = 6
# Of the pad's height: how far from the tip is the other point whose way is limited; and the
# residual with which the parts of a frame before the last may end.
_ARM_SHARE, _INTERMEDIATE = 0.75, 1e-2


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchOptions:
    """Settings of the solver.

    Attributes:
        residual_relative: Largest allowed norm of the unbalanced force, and difference of base
            reaction and indenter force, both divided by the contact force.
        steps_max: Largest number of solver steps in one descent.
        halvings_max: How often a step that does not converge is halved, unless the frame has taken
            six times ``steps_max`` evaluations.
        accepts_residual: Accept the residual that is left after ``steps_max`` steps. Every step
            then costs about the same, as learning needs.
    """

    residual_relative: float = 1e-3
    steps_max: int = 300
    halvings_max: int = 4
    accepts_residual: bool = False


class Frames:
    """Takes environments from pose to pose, each at its own pace.

    Args:
        rest: The nodes of the resting gel [m].
        longest_m: Way of an environment's indenter in one part of a frame, of its tip or of a point
            at 0.75 of the pad's height from it, shape [count].
        bias: Of the mesh, by which loads are corrected.
        light_pa: ``light_moduli`` of the environments, shape [count].

    Attributes:
        motions: Where they go, a ``motion_step_kernels.Motions``.
        found: What they found, a ``motion_step_kernels.Found``; NaN where they did not arrive, but
            for the tips.
    """

    def __init__(
        self,
        descents: Descents,
        history: Any,
        rest: Any,
        frame_count: int,
        *,
        longest_m: FloatArray,
        bias: ForceBias,
        light_pa: FloatArray,
        options: BatchOptions,
    ) -> None:
        self._descents, self._history, self._rest = descents, history, rest
        self._device = device = Device(descents.model.device)
        own, shape = (descents.count,), (frame_count, descents.count)
        self.motions = device.zeroed(kernels.Motions, own, goals=shape, loads=shape, enough=(2,))
        self.motions.longest.assign(longest_m)
        enough = options.residual_relative
        self.motions.enough.assign(np.array([enough, max(enough, _INTERMEDIATE)]))
        self.motions.standoff = descents.model.contact_options.distance_m
        self.found = device.zeroed(kernels.Found, shape, touched=(*shape, 7), wrench=(*shape, 6))
        self._new, self._threads = device.zeros(1, wp.int32), 256 if device.is_gpu else 1
        self._graph: Any = None
        self._set_out, self._lowering = self._recorded_start()
        kinds = (kernels.Known, wp.vec4d, wp.vec2d)
        biased = [device.array(*each) for each in zip(bias, kinds, strict=True)]
        self._look, self._noting = self._recorded(biased, light_pa, options)

    def go(self) -> None:
        """Take who moves to the goals, in more and more parts where descents do not arrive."""
        motions, found = self.motions, self.found
        for counts in (motions.frame, motions.parts, motions.done, motions.halved):
            counts.zero_()
        found.evaluations.zero_()
        for array in (found.touched, found.wrench, found.error, found.residual, found.imbalance):
            array.fill_(np.nan)
        # A graph that a simulator captures takes the launches, since it cannot take a graph.
        if not self._device.is_gpu or wp.get_device(self._device.name).is_capturing:
            self._launch()
        elif not self._descents.ran:  # a graph cannot compile kernels: all run before
            self._launch()
            self._history.comes.zero_()
            _launch_all(self._lowering)
            self._iterate()
            self._descents.ran = True
        else:
            if self._graph is None:
                with wp.ScopedCapture(device=self._device.name) as capture:
                    self._launch()
                self._graph = capture.graph
            wp.capture_launch(self._graph)

    def _launch(self) -> None:
        busy = self._descents.busy
        for flag in (self._new, busy):
            flag.zero_()
        self._set_out.launch()
        wp.capture_if(self._new, on_true=_launch_all, launches=self._lowering)
        _launch_all(self._look)
        wp.capture_while(busy, while_body=self._iterate)
        _launch_all(self._noting)

    def _iterate(self) -> None:
        """Take steps; beside each, note who arrived by the one before."""
        for _ in range(_STEPS_ON_GPU if self._device.is_gpu else 1):
            with self._device.beside(*(each.launch for each in self._noting), number=1):
                self._descents.step()
            _launch_all(self._look)

    def _recorded_start(self) -> tuple[Any, list[Any]]:
        """Record what finds who comes down anew, and what puts these over their first goals.

        They are about to touch the resting gel, which has forgotten.
        """
        descents, history, record = self._descents, self._history, self._device.record
        state, poses, positions = descents.state, descents.poses, descents.positions
        model, buffers, new = descents.model, descents.contact_buffers, history.comes
        made, own = model.surface.kernels, (descents.count,)
        set_out = record(kernels.set_out, own, [self.motions, history, poses, state, self._new])
        put = [self._rest, new, False, poses, state, history, positions]
        put_back = record(kernels.put_back, tuple(positions.shape), put)
        points, gaps = tuple(buffers[1].shape), buffers[2].reshape((descents.count, -1))
        touch = record(made.touch, points, [descents.pressed, new, *buffers])
        threads, down = self._threads, [new, gaps, self.motions, poses]
        lower = record(kernels.lower, (descents.count, threads), down, threads)
        grips = (descents.grip, descents.grip_start) if model.contact_options.is_tangential else ()
        let_go = [record(kernels.let_go, points, [new, grip]) for grip in grips]
        held = [replaced(Pressed, descents.pressed, grip=grip) for grip in grips]
        drag = [record(made.drag, points, [each, new]) for each in held]
        return set_out, [*let_go, put_back, *[touch, lower] * _LOWERINGS, put_back, *drag]

    def _recorded(
        self, biased: list[Any], light_pa: FloatArray, chosen: BatchOptions
    ) -> tuple[list[Any], list[Any]]:
        """Record what sees who has arrived and begins parts, and what notes their wrenches."""
        descents, history, record = self._descents, self._history, self._device.record
        model, state, poses = descents.model, descents.state, descents.poses
        own, nodes = (descents.count,), tuple(descents.positions.shape)
        points = tuple(descents.contact_buffers[1].shape)
        made = model.surface.kernels
        options, grip, kept = model.contact_options, descents.grip, descents.grip_start
        seen = self._device.zeroed(Poses, own)
        there = replaced(Pressed, descents.pressed, poses=seen)
        going = [options.friction > 0.0, _ARM_SHARE * model.height_m, chosen.accepts_residual]
        going += [chosen.halvings_max, _GIVES_UP * chosen.steps_max, self.motions, history, poses]
        going += [state, descents.memory, seen, self.found, descents.busy]
        look = [record(kernels.go_on, own, going)]
        if options.is_tangential:
            summed = model.surface.grip_arrays(None, descents.count)
            # One that did not arrive may have left other grips than it began with.
            arrived = history.arrives
            copied = [arrived, grip, summed], [arrived, grip, kept], [history.starts, kept, grip]
            first, *others = (record(kernels.copy_grip, points, each) for each in copied)
            held = [kept, *descents.contact_buffers[:2], *descents.grip_buffers]
            kernel, more = (made.hold, held) if options.bonded else (made.drag, [])
            dragged = record(kernel, points, [there, arrived, *more])
            look += [first, dragged, *others]
            there = replaced(Pressed, there, grip=summed)
        gaps = descents.contact_buffers[2].reshape((descents.count, -1))
        put = [descents.positions, descents.gel_buffers[0], descents.contact_buffers[0]]
        look.append(record(kernels.take_over, nodes, [gaps, history, *put]))
        there = replaced(Pressed, there, positions=history.last)
        tables = (pressure_form(model), face_shares(model), quarter_values(model))
        formed = [self._device.array(each, wp.float64) for each in tables]
        formed += [self._rest, wp.float64(reach_of(model)), history.gaps.reshape(points)]
        is_gpu = self._device.is_gpu
        many, shared, parts = (THREADS, WRENCH_THREADS, tables[2].shape[1]) if is_gpu else (1, 1, 1)
        # With their own edges, which they have where nothing else rounds them.
        own_edges: Any = descents.indenter
        self._edged = body_of(replace(own_edges, rounding_m=0.0), device=self._device.name)
        held = [self._edged, resting_gel(model), self.motions.standoff, wp.float64(reach_of(model))]
        held += [self._device.array(light_pa, wp.float64), history.arrives, seen, history.touched]
        wrenched = [there, parts, history.arrives, *formed, history.touched]
        noted = [*biased, state, seen, self.motions, history, self.found]
        return look, [
            record(model.surface.batch_kernels.wrench, (*own, shared), wrenched, shared),
            record(overlap, (*own, many), [*held, history.light], many),
            record(kernels.note, own, noted),
        ]


def _launch_all(launches: list[Any]) -> None:
    for each in launches:
        each.launch()
