"""A press that is too quick for statics: the indenter goes down evenly while the gel has mass."""

from __future__ import annotations

import time

import numpy as np

from sim.arrays import FloatArray
from sim.scene.scene import Scene
from sim.solve.dynamics.implicit import DynamicPress
from sim.solve.load_steps.path import LoadingPath
from sim.solve.load_steps.path_point import PathPoint
from sim.solve.newton import Equilibrium
from tacauchy_rig.errors import ConfigError

STEP_COUNT = 60


def moving_press(
    scene: Scene, path: LoadingPath, *, density_kg_m3: float | FloatArray
) -> PathPoint:
    """Press to a depth in the scene's time and return the last instant.

    Its residual is not zero: what is missing from the balance accelerates the gel.

    Raises:
        ConfigError: The scene asks for a force, for friction or for a motion besides.
        ConvergenceError: A time step has no solution.
    """
    depth = scene.target.depth_m
    if depth is None or not scene.motion.is_straight:
        raise ConfigError(
            f"a press of {scene.duration_s:g} s calls for inertia, which goes straight down to a "
            "depth only",
            remedy="give a depth, or switch it off with --effect inertia=off",
        )
    started = time.perf_counter()
    pressing = DynamicPress(path, density_kg_m3=density_kg_m3)
    steps = pressing.run(
        lambda time_s: depth * min(1.0, time_s / scene.duration_s),
        step_s=scene.duration_s / STEP_COUNT,
        duration_s=scene.duration_s,
    )
    path.counts.newton_iterations += sum(step.newton_iterations for step in steps)
    path.counts.wall_s += time.perf_counter() - started
    state, last = pressing.state, steps[-1]
    contact = path.model.contact_forces(state.positions, path.indenter, state)
    elastic = path.model.elastic_gradient(state.positions)
    unbalanced = path.model.pattern.unknowns(elastic + path.model.scatter(contact.forces))
    found = Equilibrium(
        iterations=last.newton_iterations,
        contact=contact,
        elastic_gradient=elastic,
        residual_n=float(np.linalg.norm(unbalanced)),
        min_jacobian=last.min_jacobian,
    )
    return PathPoint(
        depth_m=last.depth_m,
        force_n=last.force_n,
        stiffness_n_m=float("nan"),
        state=state,
        equilibrium=found,
    )
