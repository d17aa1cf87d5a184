"""A scene pressed by a process of its own, on one thread, with this checkout or another commit."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.studies.bench.part import SCENE_LIMIT_S
from sim.studies.bench.scenes import press as worker
from sim.studies.bench.scenes.catalogue import BenchScene
from sim.studies.bench.scenes.press import ScenePress
from tacauchy_rig.core.errors import ConfigError

# What the libraries that solve and assemble take as their number of threads.
_THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
# Times its processor time, for a scene that waits, or shares its core.
_WAITED = 8.0
NOT_YET = "not yet"
IMAGES = "with images"
OWN = Path(worker.__file__).parents[4]


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """How every scene is to be pressed.

    Attributes:
        tolerance: Of F_z; the cheapest setting that keeps it is taken.
        preset: Taken instead.
        environments: Of a batch; None presses alone.
        images: With the image, markers and stress of every frame, in a batch.
        own_mesh: On the mesh that ``batch_model`` makes, in a batch.
        is_timed: Compile the kernels before, and press several times.
        limit_s: Processor time after which a scene has failed, start and set-up included [s].
        checkout: Whose solver.
    """

    tolerance: str = "5%"
    preset: str | None = None
    device: str = "cpu"
    environments: int | None = None
    images: bool = False
    own_mesh: bool = False
    is_timed: bool = True
    limit_s: float = SCENE_LIMIT_S
    checkout: Path = OWN

    @property
    def manner(self) -> tuple[str, ...]:
        """What is unlike other batches, in words."""
        words = {IMAGES: self.images, "the batch's own mesh": self.own_mesh}
        return tuple(text for text, is_so in words.items() if is_so)


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneRow:
    """A scene that was pressed, or why it was not.

    Attributes:
        tolerance: What its setting was chosen for; empty where it was given.
        press: None where ``failure`` says why.
        manner: What is unlike other rows of as many environments.
    """

    scene: str
    tolerance: str
    device: str
    environments: int | None
    press: ScenePress | None
    failure: str = ""
    manner: tuple[str, ...] = ()

    @property
    def setting(self) -> str:
        """Preset and length of edges; * where it does not promise the tolerance asked for."""
        if self.press is None:
            return self.failure if self.failure.startswith(NOT_YET) else "failed"
        edges = "" if self.press.edges == 1.0 else f" {self.press.edges:.2f}"
        return (
            self.press.preset + edges + ("*" if self.tolerance and not self.press.promised else "")
        )

    @property
    def spent_s(self) -> float:
        """Time of all frames: the thread's on a CPU, whatever else the machine does; else wall."""
        if self.press is None:
            return float("nan")
        return self.press.cpu_s if self.device == "cpu" else self.press.wall_s

    @property
    def frames_per_s(self) -> float:
        """Frames of all environments [1/s]."""
        return worker.FRAME_COUNT * (self.environments or 1) / self.spent_s


def pressed(scene: BenchScene, order: Order) -> SceneRow:
    """Press a scene; an error, a crash and too long a time are rows."""
    (row,) = pressed_together(scene, [order])
    return row


def pressed_together(scene: BenchScene, orders: Sequence[Order]) -> tuple[SceneRow, ...]:
    """Press a scene in one process, in batches that differ in their environments only."""
    counts = [order.environments for order in orders if order.environments is not None]
    output, ended = _answer(scene, orders[0], counts)
    answers = [json.loads(line) for line in output.splitlines() if line.startswith('{"')]
    presses = [answer for answer in answers if "failure" not in answer]
    failure = next((answer for answer in answers if "failure" in answer), {"failure": ended})
    # What ended the process is why the rest has none.
    presses += [failure] * (len(orders) - len(presses))
    return tuple(_row(scene, *each) for each in zip(orders, presses, strict=True))


def _row(scene: BenchScene, order: Order, found: dict[str, Any]) -> SceneRow:
    failure = found.get("failure", "")
    return SceneRow(
        scene=scene.name,
        tolerance="" if order.preset else order.tolerance,
        device=order.device,
        environments=order.environments,
        press=None if failure else ScenePress(**found),
        failure=failure,
        manner=order.manner,
    )


def _answer(scene: BenchScene, order: Order, counts: Sequence[int]) -> tuple[str, str]:
    """Return what a process wrote, and how it ended."""
    own = Path(worker.__file__)
    theirs = order.checkout / own.relative_to(OWN)
    limit_s = order.limit_s * max(1, len(counts))
    # Packages may lie elsewhere, but ours come from the checkout.
    places = [str(order.checkout), *filter(None, [os.environ.get("PYTHONPATH")])]
    asked = {
        "stated": scene.stated,
        "tolerance": order.tolerance,
        "preset": order.preset,
        "device": order.device,
        "counts": counts,
        # As commits before several counts have it.
        "environments": order.environments,
        "images": order.images,
        "own_mesh": order.own_mesh,
        "is_timed": order.is_timed,
        "limit_s": limit_s,
    }
    try:
        done = subprocess.run(
            # -P: modules beside the file are no packages of their own.
            [sys.executable, "-P", str(theirs if theirs.exists() else own)],
            input=json.dumps(asked),
            env=os.environ | dict.fromkeys(_THREADS, "1") | {"PYTHONPATH": os.pathsep.join(places)},
            capture_output=True,
            text=True,
            check=False,
            timeout=_WAITED * limit_s,
        )
    except subprocess.TimeoutExpired as error:
        # It has bytes here, whatever was asked for.
        said = error.stdout.decode() if isinstance(error.stdout, bytes) else error.stdout or ""
        return said, f"not done after {_WAITED * limit_s:g} s"
    if done.returncode == -signal.SIGXCPU:
        return done.stdout, f"not done after {limit_s:g} s of processor time"
    last = (done.stderr.strip().splitlines() or ["nothing"])[-1]
    return done.stdout, f"its process ended with status {done.returncode}: {last}"


def commit() -> str:
    """Return the commit of this checkout, ``-dirty`` where files differ; empty outside of git."""
    try:
        return git("describe", "--always", "--dirty", "--abbrev=10", "--exclude=*")
    except ConfigError:
        return ""


def git(*words: str) -> str:
    """Return what git says of this checkout.

    Raises:
        ConfigError: It refuses, or this is no checkout.
    """
    done = subprocess.run(
        ["git", "-C", str(OWN), *words], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise ConfigError(
            f"git {words[0]}: {done.stderr.strip() or done.returncode}",
            remedy="name a commit of the program's own checkout",
        )
    return done.stdout.strip()
