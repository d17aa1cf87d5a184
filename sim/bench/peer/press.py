"""Press in libuipc: once to warm up, then timed, then read."""

from __future__ import annotations

import time

import numpy as np

from sim.arrays import FloatArray
from sim.bench.peer.contact import contact_forces
from sim.bench.peer.task import PeerFound, PeerTask
from sim.bench.peer.world import PeerWorld
from tacauchy_rig.errors import ConvergenceError

_LIFT_FRAMES = 5
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
    iterations = _warm_up(world, heights)
    set_up_s = time.perf_counter() - started
    times: list[float] = []
    while len(times) < task.press_count and (not times or sum(times) < _ENOUGH_S):
        _lift(world, heights)
        times.append(_timed(world, heights))
    positions, tips = world.read()
    world.go_to(heights[-1])
    world.synchronise()
    problems = []
    still = _iterations(world)
    if still is not None and still != 1:
        problems.append(f"the frame that stands still took {still} Newton steps")
    contact = contact_forces(world)
    if contact is None:
        problems.append("it does not say its contact forces")
    return PeerFound(
        version=str(world.uipc.__version__),
        set_up_s=set_up_s,
        press_s=tuple(times),
        newton_iterations=tuple(iterations),
        positions=positions,
        tips_m=tips,
        contact_n=contact,
        problems=tuple(problems),
    )


def _warm_up(world: PeerWorld, heights: FloatArray) -> list[int]:
    """Press once, and return the Newton iterations of every frame."""
    found = []
    for tips in heights:
        world.go_to(tips)
        _check(world)
        taken = _iterations(world)
        if taken is not None:
            found.append(taken)
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


def _iterations(world: PeerWorld) -> int | None:
    """Return the Newton iterations of the last frame, if libuipc counts them."""
    stats = world.engine.frame_stats()
    taken = stats.get("newton_iterations") if isinstance(stats, dict) else None
    return None if taken is None else int(taken)


def _check(world: PeerWorld) -> None:
    if not world.is_valid:
        raise ConvergenceError(
            f"libuipc has met an error in frame {world.world.frame()}",
            remedy="see its own messages above",
        )
