"""``python -m tests.studies beyond``: are presses beyond what a gel can bear right or refused?"""

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from types import SimpleNamespace
from typing import Annotated, Any
from unittest import mock

import numpy as np
import typer

from sim.press import PressResult, press
from sim.press_arguments import scene_from
from sim.scene.indenter import MeshIndenter, describe, mesh_indenter
from sim.scene.scene import Preset, Scene, Target
from tacauchy_rig.app.cli.studies import StudyRun
from tacauchy_rig.core import time_limit_and_progress as limits
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import RigError, TimeLimitError
from tacauchy_rig.core.study import Case, Result, Study, failures_table, founds
from tacauchy_rig.core.tables import Table, table_of

SILENT_MOST_S = 5.0
# F_z of preset fast is promised to about 5 % in ordinary presses; beyond them to the stated error,
# and to this at least.
_WRONG_SHARE = 0.15
# Edges of the press that judges are so many times shorter; the other where that takes too long.
_FINER, _LESS_FINE = 1.6, 1.25
# The error falls with the edges: what that other press changes is so many times less.
_TELLS_LESS = (1.0 - 1.0 / _FINER) / (1.0 - 1.0 / _LESS_FINE)
_BUSY = 6.0
"""How many times its processor time a press may take on a busy computer before it is ended."""
_PADS = (
    "--sensor gelsight-mini",
    "--sensor digit",
    "--pad box:20x20x3mm --young 0.2MPa --poisson 0.49",
    "--pad box:16x24x5mm --young 0.5MPa --poisson 0.45",
)


class Kind(StrEnum):
    """What is too much for the gel."""

    SMALL_BALL = "small ball, deep"
    LARGE_BALL = "large ball, deep"
    PUNCH = "punch, pushed hard"
    NEEDLE = "needle"
    PRISM = "acute triangular prism"
    FAR = "body with triangles far away"
    BASE = "ball at the base"
    HUGE = "huge load"
    TILT = "steep tilt"


class Answer(StrEnum):
    """What came of a press."""

    RIGHT = "right"
    WRONG = "wrong"
    REFUSED = "refused"
    HELPLESS = "refused without a remedy"
    LATE = "ended by its time limit"
    UNDECIDED = "undecided"


@dataclass(frozen=True, slots=True, kw_only=True)
class Beyond:
    """A press that is drawn."""

    kind: Kind
    scene: Scene

    def __str__(self) -> str:
        depth, force = self.scene.target.depth_m, self.scene.target.force_n
        asked = f"{force:.3g} N" if depth is None else f"{depth * 1e3:.3g} mm"
        return f"{self.kind.value}, {describe(self.scene.indenter)} to {asked}"


Judged = dict[str, Any]
"""What came of one press: its ``kind`` and ``answer``; the longest processor time without a word
``silent_s`` and that until the answer or error ``took_s`` [s]; what was ``said``.
"""


def is_met(found: Judged) -> bool:
    """Return whether an answer is right, or an error with its remedy, and came without silence."""
    return found["answer"] not in (Answer.WRONG, Answer.HELPLESS) and (
        found["silent_s"] <= SILENT_MOST_S
    )


def drawn(seed: int, number: int) -> Beyond:
    """Return the press of a number; kinds take turns."""
    random, kind = np.random.default_rng([seed, number]), list(Kind)[number % len(Kind)]
    base = scene_from(
        f"{random.choice(_PADS)} --indenter plane --depth 0.1mm --preset fast"
        + random.choice(["", "", " --contact friction:0.5"])
    )
    height, words = base.pad.height_m, "plane"
    share = float(random.uniform(0.3, 1.05))
    target = Target(depth_m=share * height)
    match kind:
        case Kind.SMALL_BALL:
            words = f"sphere:diameter={random.uniform(0.1, 1.5):.3f}mm"
        case Kind.LARGE_BALL:
            words = f"sphere:diameter={random.uniform(2.0, 25.0):.2f}mm"
        case Kind.PUNCH | Kind.HUGE:
            body = random.choice(["cylinder", "sphere"]) if kind is Kind.HUGE else "cylinder"
            words = f"{body}:diameter={random.uniform(0.5, 8.0):.2f}mm"
            most = 4.0 if kind is Kind.HUGE else 1.6
            target = Target(force_n=float(10.0 ** random.uniform(0.7, most)))
        case Kind.BASE:
            words = f"sphere:diameter={random.uniform(1.0, 8.0):.2f}mm"
            target = Target(depth_m=float(random.uniform(0.85, 1.0)) * height)
        case Kind.TILT:
            words = f"cylinder:diameter={random.uniform(1.0, 6.0):.2f}mm"
            target = Target(depth_m=float(random.uniform(0.1, 0.5)) * height)
        case _:
            pass
    scene = _with_words(base, words, target)
    if kind in (Kind.NEEDLE, Kind.PRISM, Kind.FAR):
        scene = replace(scene, indenter=_body(kind, random), target=Target(depth_m=share * 0.5e-3))
    if kind is Kind.TILT:
        tilt = float(math.radians(random.uniform(10.0, 60.0)))
        scene = replace(scene, motion=replace(scene.motion, tilt_rad=(tilt, 0.0)))
    if random.random() < 0.3:
        half = np.array(scene.pad.half_extents())
        x, y = random.uniform(-1.0, 1.0, 2) * half
        scene = replace(scene, centre_m=(float(x), float(y)))
    return Beyond(kind=kind, scene=scene)


def _with_words(base: Scene, indenter: str, target: Target) -> Scene:
    bare = scene_from(f"--sensor digit --indenter {indenter} --depth 0.1mm")
    return replace(base, indenter=bare.indenter, target=target)


def _body(kind: Kind, random: np.random.Generator) -> MeshIndenter:
    """Return a body of triangles, lengths in metres."""
    if kind is Kind.NEEDLE:  # a pyramid on its apex
        wide, high = random.uniform(0.02e-3, 0.4e-3), random.uniform(1e-3, 5e-3)
        top = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * wide
        corners = np.vstack([[0.0, 0.0, 0.0], np.column_stack([top, np.full(4, high)])])
        faces = [[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4], [1, 2, 3], [1, 3, 4]]
        return mesh_indenter(corners, np.array(faces, dtype=np.int32), name="needle")
    angle = math.radians(random.uniform(5.0, 40.0))
    long = random.uniform(1e-3, 5e-3)
    plan = np.array([[0.0, 0.0], [long, 0.0], [long * math.cos(angle), long * math.sin(angle)]])
    if kind is Kind.FAR:  # a wide roof over a small foot
        return mesh_indenter(*_stepped(plan), name="roofed")
    return mesh_indenter(*_prism(plan, 0.0, 3e-3), name="prism")


def _prism(plan: FloatArray, low: float, high: float) -> tuple[FloatArray, np.ndarray]:
    bottom, top = (np.column_stack([plan, np.full(3, z)]) for z in (low, high))
    walls = [[a, b, 3 + b] for a, b in ((0, 1), (1, 2), (2, 0))]
    walls += [[a, 3 + b, 3 + a] for a, b in ((0, 1), (1, 2), (2, 0))]
    faces = np.array([[0, 2, 1], [3, 4, 5], *walls], dtype=np.int32)
    return np.vstack([bottom, top]), faces


def _stepped(plan: FloatArray) -> tuple[FloatArray, np.ndarray]:
    """Return a triangular foot that widens to a roof ten times as wide, 3 mm up."""
    corners, faces = _prism(plan, 0.0, 3e-3)
    corners[3:, :2] = 10.0 * (corners[3:, :2] - plan.mean(axis=0)) + plan.mean(axis=0)
    return corners, faces


@contextmanager
def _by_processor_time() -> Iterator[None]:
    """Let limits and silences count processor time: a busy computer ends no press early."""
    with mock.patch.object(limits, "time", SimpleNamespace(monotonic=time.process_time)):
        yield


def judged(case: Beyond, *, limit_s: float, finer_limit_s: float) -> Judged:
    """Press a case within a processor time [s], and judge it by a finer mesh within another."""
    heard = [started := time.process_time()]
    result = None
    try:
        with _by_processor_time():
            result = press(
                case.scene,
                estimate_error=True,
                time_limit_s=limit_s,
                on_progress=lambda _: heard.append(time.process_time()),
            )
    except RigError as error:
        said = str(error)
        answer = Answer.LATE if isinstance(error, TimeLimitError) else Answer.REFUSED
        answer = answer if error.remedy else Answer.HELPLESS
    heard.append(time.process_time())
    if result is not None:
        answer, said = _judged_force(case, result, finer_limit_s)
    return {
        "kind": case.kind.value,
        "answer": answer.value,
        "silent_s": float(np.diff(heard).max()),
        "took_s": heard[-1] - started,
        "said": " ".join(said.split()),
    }


def _judged_force(case: Beyond, result: PressResult, limit_s: float) -> tuple[Answer, str]:
    own, depth_m = result.force_n[2], result.depth_m
    if not own > 0.0:
        return Answer.WRONG, f"{own:.4f} N"
    said = f"{own:.4f} N at {depth_m * 1e3:.4f} mm"
    try:
        with _by_processor_time():
            other, times, finer = _finer_press(case.scene, limit_s)
    except RigError as error:
        return Answer.UNDECIDED, f"{said}; finer: {error.message}"
    ratio = own / other.force_n[2]
    if case.scene.target.depth_m is None:
        ratio = depth_m / other.depth_m
    off, stated = times * abs(ratio - 1.0), result.guaranteed_error_relative
    said += f", {off:.1%} off {finer}, {'no error' if stated is None else f'{stated:.1%}'} stated"
    is_right = off <= max(_WRONG_SHARE, stated or 0.0)
    return (Answer.RIGHT if is_right else Answer.WRONG), said


def _finer_press(scene: Scene, limit_s: float) -> tuple[PressResult, float, str]:
    """Return a finer press, the factor to its difference, and its name.

    Raises:
        RigError: Nor did the second that was tried come to its end.
    """

    def pressed(**changes: Any) -> PressResult:
        return press(replace(scene, **changes), time_limit_s=limit_s)

    try:
        return pressed(refinement=_FINER * scene.refinement), 1.0, f"edges / {_FINER}"
    except TimeLimitError:
        less = pressed(refinement=_LESS_FINE * scene.refinement)
        return less, _TELLS_LESS, f"(extrapolated) edges / {_LESS_FINE}"
    except RigError:
        return pressed(preset=Preset.BALANCED), 1.0, "preset balanced"


class BeyondStudy(Study):
    """Presses beyond what a gel can bear."""

    name, title, kind = "beyond", "Presses beyond what a gel can bear", "press"

    def __init__(self, *, count: int, seed: int, limit_s: float, finer_limit_s: float) -> None:
        self.count, self.seed = count, seed
        self.limits = {"limit_s": limit_s, "finer_limit_s": finer_limit_s}

    def cases(self) -> Sequence[Case]:
        """Return the presses, each to be made in a process of its own."""
        pressed = [drawn(self.seed, number) for number in range(self.count)]
        longest_s = _BUSY * (self.limits["limit_s"] + 2.0 * self.limits["finer_limit_s"])
        return [
            Case(
                name=f"{number}",
                shows=f"{case}, seed {self.seed}",
                measure=partial(judged, case, **self.limits),
                limit_s=longest_s,
                is_isolated=True,
            )
            for number, case in enumerate(pressed)
        ]

    def line(self, result: Result) -> str:
        """Return what came of a press."""
        found = result.found
        return (
            f"{result.shows}: {found['answer']} after {found['took_s']:.1f} s, silent for "
            f"{found['silent_s']:.1f} s: {found['said']}"
        )

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return the answers by kind, and the presses that are undecided or miss the criterion."""
        found, rows = founds(results), []
        for kind in Kind:
            own = [each for each in found if each["kind"] == kind]
            counts = [sum(each["answer"] == answer for each in own) for answer in Answer]
            silent_s = max((each["silent_s"] for each in own), default=0.0)
            rows.append((kind.value, len(own), *counts, round(silent_s, 1)))
        answers = Table(
            title="Presses by kind",
            columns=("press", "ended", *(answer.value for answer in Answer), "silent at most [s]"),
            rows=tuple(rows),
            criterion=f"no answer is wrong, none is silent for more than {SILENT_MOST_S:g} s",
            passed=all(map(is_met, found)),
        )
        named = [
            result
            for result in results
            if not result.failure
            and (result.found["answer"] == Answer.UNDECIDED or not is_met(result.found))
        ]
        listed = table_of(
            named,
            {
                "press": lambda result: result.name,
                "": lambda result: result.found["answer"] if is_met(result.found) else "missed",
                "what came of it": self.line,
            },
            title="Undecided and missed",
            criterion="none: the table above judges them",
        )
        return [answers, *([listed] if named else []), *failures_table(results, kind=self.kind)]


def beyond_check(
    *,
    presses: Annotated[int, typer.Option("--presses", min=1, help="How many are drawn.")] = 200,
    seed: Annotated[int, typer.Option("--seed", help="Of the draw.")] = 1,
    press_limit: Annotated[
        float, typer.Option("--press-limit", help="Of one press [s of processor].")
    ] = 60.0,
    finer: Annotated[
        float, typer.Option("--finer", help="Of each of the two that may judge it [s likewise].")
    ] = 120.0,
    how: StudyRun,
) -> None:
    """Press too deep, too hard, with needles and at steep tilts: right, or an error, in time.

    A press that its own limit does not end is ended after --limit and has failed. Edges / 1.6
    judge it; where these take too long edges / 1.25, where they end with an error preset balanced.
    What neither judges is undecided and listed.

    Example: python -m tests.studies beyond --presses 20 --press-limit 15 --finer 40 --jobs 2
    """
    how.measure(BeyondStudy(count=presses, seed=seed, limit_s=press_limit, finer_limit_s=finer))
