"""One scene pressed in frames and timed; as a program it does what an order on its input says.

This is all of the benchmark's scenes that knows the solver. It is run as a file, so that another
commit's solver can be timed with it: its imports are those of the checkout on Python's path.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import math
import resource
import shlex
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from sim.effects.plan import PRESET_TOLERANCE, plan_effects
from sim.error.tolerance import keeping, parse_tolerance
from sim.press import measure
from sim.press_command import scene_from
from sim.scene.scene import Preset, Scene
from sim.solve.loading_path import Hold, LoadingPath
from sim.solve.path_point import PathPoint
from sim.studies.objects.shapes import OBJECTS
from tacauchy_rig.core.errors import ConfigError, RigError

# Where a commit has what lays a scene's path.
_HOMES = ("sim.effects.scene_path", "sim.press")
FRAME_COUNT = 20
# The least of so many presses counts, if they do not take longer than this together [s].
_REPEATS, _ENOUGH_S = 3, 6.0
# Of the way, for what compiles or loads the kernels.
_WARM_SHARE = 0.1
# After its limit a process is asked to end, and so much later made to [s].
_GRACE_S = 5
# The preset where none promises a tolerance: the first whose usual error is within it.
_UNPROMISED = ((0.03, Preset.FAST), (0.01, Preset.BALANCED), (0.0, Preset.ACCURATE))


def path_for(scene: Scene, plan: Any, **options: Any) -> LoadingPath:
    """Return a scene's path, of whichever commit this is.

    Raises:
        ConfigError: The scene cannot be built.
    """
    home = next(name for name in _HOMES if importlib.util.find_spec(name) is not None)
    path: LoadingPath = importlib.import_module(home).path_for(scene, plan, **options)
    return path


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenePress:
    """What a scene's frames took, and what the last of them is worth.

    Attributes:
        preset: That it was pressed with; ``batch`` in a batch.
        edges: How many times as long as the preset's the edges were.
        promised: The setting was chosen since it promises the tolerance.
        setup_s: Mesh, upload and symbolic factorisation [s].
        wall_s: All frames of all environments [s].
        cpu_s: Processor time of the same [s].
        iterations: Newton's and the like, all frames.
        force_n: On the indenter in the last frame [N], shape [3].
        moment_nm: About its tip [N m], shape [3]; None where it is not computed.
        stiffness_n_m: dF_z / d(depth) in the last frame that goes down [N/m].
        balance: |indenter force + base reaction| over the former.
        parts_s: In a batch, what each launch of a step takes, and that of the stress [s].
    """

    preset: str
    edges: float
    promised: bool
    tet_count: int
    unknown_count: int
    setup_s: float
    wall_s: float
    cpu_s: float
    iterations: int
    force_n: tuple[float, float, float]
    moment_nm: tuple[float, float, float] | None
    depth_m: float
    stiffness_n_m: float
    balance: float
    parts_s: dict[str, float] = field(default_factory=dict)


def stated_scene(stated: dict[str, Any]) -> Scene:
    """Return the scene of a line of the table.

    Raises:
        ConfigError: An option is not understood.
    """
    given = {"sensor": "gelsight-mini", "indenter": "plane", **stated}
    triangles = given.pop("object", None)
    scene = scene_from(
        shlex.join(word for name, value in given.items() for word in (f"--{name}", str(value)))
    )
    return scene if triangles is None else replace(scene, indenter=OBJECTS[triangles]())


def within(scene: Scene, tolerance: str) -> tuple[Scene, bool]:
    """Return a scene with the cheapest setting for a tolerance, and whether that promises it.

    Raises:
        ConfigError: The text is no tolerance.
    """
    allowed = parse_tolerance(tolerance, field="--tolerance")
    try:
        return keeping(scene, allowed), True
    except ConfigError:
        share = allowed.of(scene.target.force_n or float("inf"))
        preset = next(preset for least, preset in _UNPROMISED if share >= least)
        # What the plan goes by without a tolerance; the forces then balance as for one.
        return replace(scene, preset=preset, tolerance=PRESET_TOLERANCE[preset]), False


def press_in_frames(
    scene: Scene, *, promised: bool = False, device: str = "cpu", is_timed: bool = True
) -> ScenePress:
    """Press a scene in equal frames from the untouched gel on.

    Args:
        promised: What the result says of its setting.
        device: Warp's.
        is_timed: Compile the kernels before, and press several times.

    Raises:
        ConvergenceError: A frame has no equilibrium.
        ConfigError: The scene cannot be built.
    """
    plan = plan_effects(scene)
    started = time.perf_counter()
    path = path_for(scene, plan, device=device)
    setup_s = time.perf_counter() - started
    model = path.model
    if is_timed:
        # Every kernel of the press, in two other frames.
        for move in moves(scene, count=2, part=_WARM_SHARE):
            move(path)
    times: list[tuple[float, float]] = []
    repeats = _REPEATS if is_timed else 1
    while len(times) < repeats and sum(cpu for cpu, _ in times) < _ENOUGH_S:
        path = path_for(scene, plan, model=model)
        wall, cpu = time.perf_counter(), time.process_time()
        points = [move(path) for move in moves(scene)]
        times.append((time.process_time() - cpu, time.perf_counter() - wall))
    cpu_s, wall_s = min(times)
    found = measure(scene, path, points[-1], plan=plan, wall_s={"solve": wall_s})
    return ScenePress(
        preset=scene.preset.value,
        edges=1.0 / scene.refinement,
        promised=promised,
        tet_count=len(model.elements),
        unknown_count=model.pattern.dof_count,
        setup_s=setup_s,
        wall_s=wall_s,
        cpu_s=cpu_s,
        iterations=path.counts.newton_iterations,
        force_n=found.force_n,
        moment_nm=found.moment_nm,
        depth_m=found.depth_m,
        stiffness_n_m=points[pressing_frames(scene) - 1].stiffness_n_m,
        balance=found.force_balance_relative,
    )


def pressing_frames(scene: Scene, count: int = FRAME_COUNT) -> int:
    """Return how many of the frames go down; a motion takes half of them."""
    moving = any(scene.motion.shift_m) or scene.motion.twist_rad != 0.0
    return count // 2 if moving else count


def moves(
    scene: Scene, *, count: int = FRAME_COUNT, part: float = 1.0
) -> list[Callable[[LoadingPath], PathPoint]]:
    """Return what to do on a path, frame by frame: down, then, where there is one, the motion.

    Args:
        count: Of frames; where there is a motion it takes half of them.
        part: Of the whole way.
    """
    motion, target = scene.motion, scene.target
    pressing = pressing_frames(scene, count)
    time_s = scene.duration_s / count

    def down(share: float) -> Callable[[LoadingPath], PathPoint]:
        if target.depth_m is not None:
            depth = share * target.depth_m
            return lambda path: path.advance(depth, duration_s=time_s)
        force = share * (target.force_n or 0.0)
        return lambda path: path.push(force, duration_s=time_s)

    frames = [down(part * k / pressing) for k in range(1, pressing + 1)]
    if pressing < count:
        left = count - pressing
        x, y = (part * along / left for along in motion.shift_m)
        hold = Hold.DEPTH if target.depth_m is not None else Hold.FORCE
        frames += [
            lambda path: path.carry(
                shift_m=(x, y),
                twist_rad=part * motion.twist_rad / left,
                hold=hold,
                duration_s=time_s,
            )
        ] * left
    return frames


def _pressed(scene: Scene, order: dict[str, Any], *, promised: bool) -> Iterator[ScenePress]:
    counts = order["counts"]
    if not counts:
        yield press_in_frames(
            scene, promised=promised, device=order["device"], is_timed=order["is_timed"]
        )
        return
    batch = importlib.import_module("sim.studies.bench.scenes.side_by_side")
    yield from batch.press_side_by_side(
        scene,
        counts=counts,
        device=order["device"],
        images=order["images"],
        own_mesh=order["own_mesh"],
    )


def main() -> None:
    """Read an order from standard input, press, and write a line for each press that came out."""
    order = json.load(sys.stdin)
    limit_s = math.ceil(order["limit_s"])
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s + _GRACE_S))
    try:
        scene, promised = stated_scene(order["stated"]), False
        if order["preset"] is not None:
            scene = replace(scene, preset=Preset(order["preset"]))
        else:
            scene, promised = within(scene, order["tolerance"])
        for found in _pressed(scene, order, promised=promised):
            _answer(asdict(found))
    except RigError as error:
        _answer({"failure": error.message})


def _answer(found: dict[str, Any]) -> None:
    sys.stdout.write(f"\n{json.dumps(found)}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
