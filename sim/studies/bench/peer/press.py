"""Press in libuipc: once to warm up, then timed, then read."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from sim.arrays import FloatArray
from sim.studies.bench.peer.contact import contact_forces
from sim.studies.bench.peer.task import PeerFound, PeerTask
from sim.studies.bench.peer.world import PeerWorld
from tacauchy_rig.errors import ConvergenceError

_LIFT_FRAMES = 5
_NEWTON = "newton_iterations"
_LIMITS = {"hit_newton_limit": "Newton", "hit_line_search_limit": "a line search"}
# No further press is timed after so much time [s].
_ENOUGH_S = 40.0


def press_in_libuipc(task: PeerTask, *, folder: str, backend: str = "cuda") -> PeerFound:
    """Press every environment along its course: one press to warm up, then the timed ones.

    Between presses the indenters are lifted off; the gel then comes back to rest.

    Raises:
        ConvergenceError: libuipc has met an error.
    """
    started = time.perf_counter()
    world = PeerWorld(task, folder=folder, backend=backend)
    try:
        return _pressed(world, started)
    finally:
        world.close()


def _pressed(world: PeerWorld, started: float) -> PeerFound:
    task = world.task
    heights = task.touch_m - task.depths_m
    frames = _warm_up(world, heights)
    set_up_s = time.perf_counter() - started
    times: list[float] = []
    while len(times) < task.press_count and (not times or sum(times) < _ENOUGH_S):
        _lift(world, heights)
        times.append(_timed(world, heights))
    positions, tips = world.read()
    world.go_to(heights[-1])
    world.synchronise()
    problems = _limits(frames)
    still = _counts([world.frame_facts()], _NEWTON)
    if any(steps > 1 for steps in still):
        problems.append(f"the frame that stands still took {still[0]} Newton steps")
    contact = contact_forces(world)
    if contact is None:
        problems.append("it does not say its contact forces")
    return PeerFound(
        version=str(world.uipc.__version__),
        set_up_s=set_up_s,
        press_s=tuple(times),
        newton_iterations=_counts(frames, _NEWTON),
        linear_iterations=_counts(frames, "linear_solver_iterations"),
        positions=positions,
        tips_m=tips,
        contact_n=contact,
        problems=tuple(problems),
    )


def _warm_up(world: PeerWorld, heights: FloatArray) -> list[dict[str, Any]]:
    """Press once, and return what libuipc says of every frame."""
    found = []
    for tips in heights:
        world.go_to(tips)
        _check(world)
        found.append(world.frame_facts())
    return found


def _timed(world: PeerWorld, heights: FloatArray) -> float:
    """Return the time of a press [s]."""
    world.synchronise()
    started = time.perf_counter()
    for tips in heights:
        world.go_to(tips)
    world.synchronise()
    spent = time.perf_counter() - started
    _check(world)
    return spent


def _lift(world: PeerWorld, heights: FloatArray) -> None:
    deepest, touch = heights[-1], world.task.touch_m
    for share in np.linspace(0.0, 1.0, _LIFT_FRAMES + 1)[1:]:
        world.go_to(deepest + share * (touch - deepest))
    world.go_to(np.full(world.task.count, touch))


def _counts(frames: Sequence[dict[str, Any]], name: str) -> tuple[int, ...]:
    """Return a number of every frame that libuipc says it of."""
    return tuple(int(frame[name]) for frame in frames if name in frame)


def _limits(frames: Sequence[dict[str, Any]]) -> list[str]:
    """Say in how many frames an iteration ended at its limit."""
    found = []
    for name, what in _LIMITS.items():
        hit = sum(_counts(frames, name))
        if hit:
            found.append(f"{hit} of {len(frames)} frames ended {what} at its limit")
    return found


def _check(world: PeerWorld) -> None:
    if not world.is_valid:
        raise ConvergenceError(
            f"libuipc has met an error in frame {world.world.frame()}",
            remedy="see its own messages above",
        )
