"""The benchmark's scenes: what is pressed, in which manner, and what forces are compared with."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from importlib import resources
from math import hypot, nan
from pathlib import Path
from typing import Any

import numpy as np

from sim.correction import Corrected
from tacauchy_rig.core.errors import ConfigError, RecordError
from tacauchy_rig.core.selection import selected
from tacauchy_rig.core.store.codec import from_json, loads

FRAME_COUNT = 20
IMAGES = "with images"
_DRAWN = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchScene:
    """One line of the table.

    Attributes:
        stated: Options of ``tacauchy-rig press`` by name, or an ``object`` instead of an indenter.
    """

    name: str
    stated: dict[str, Any]


def all_scenes() -> tuple[BenchScene, ...]:
    """Return every scene, in the order of the page."""
    text = resources.files("sim.studies.bench").joinpath("scenes.toml").read_text("utf-8")
    lines = tomllib.loads(text)["scene"]
    return tuple(BenchScene(name=line.pop("name"), stated=line) for line in lines)


def drawn_scenes(seed: int) -> tuple[BenchScene, ...]:
    """Return a dozen scenes that nobody chose, always the same for a seed.

    Half of them are balls, half have friction, half of those move along the surface.
    """
    random = np.random.default_rng(seed)
    return tuple(_drawn(random, number) for number in range(1, _DRAWN + 1))


def _drawn(random: np.random.Generator, number: int) -> BenchScene:
    size, kind = random.uniform(3.0, 10.0), "ball"
    body = f"sphere:diameter={size:.1f}mm"
    if random.random() < 0.5:
        kind, fillet = "punch", random.uniform(0.1, 0.4)
        body = f"cylinder:diameter={size / 1.5:.1f}mm,fillet={fillet:.2f}mm"
    stated = {
        "sensor": str(random.choice(["gelsight-mini", "digit", "9dtact"])),
        "indenter": body,
        "depth": f"{random.uniform(0.15, 0.8):.2f}mm",
    }
    words = [f"{kind} {number}"]
    if stated["sensor"] != "9dtact":
        stated["poisson"] = f"{random.uniform(0.35, 0.49):.3f}"
    if random.random() < 0.5:
        stated |= {"contact": f"friction:{random.uniform(0.2, 1.0):.2f}", "effect": "friction=on"}
        words.append("friction")
        if random.random() < 0.5:
            stated["shift"] = f"{random.uniform(0.02, 0.15):.2f}mm"
            words.append("sliding")
    if random.random() < 0.3:
        stated["force"] = f"{random.uniform(0.2, 2.0):.2f}N"
        del stated["depth"]
        words.append("pushed")
    return BenchScene(name=", ".join(words), stated=stated)


def select_scenes(*patterns: str, drawn: int | None = None) -> tuple[BenchScene, ...]:
    """Return the scenes whose name has one of the patterns in it, such as ``ball``; else all.

    Args:
        drawn: Seed of scenes to choose among instead.

    Raises:
        ConfigError: None has one of them.
    """
    scenes = all_scenes() if drawn is None else drawn_scenes(drawn)
    parts = [f"*{pattern}*" for pattern in patterns]
    return selected(scenes, parts, names=lambda scene: (scene.name,), kind="scene")


@dataclass(frozen=True, slots=True, kw_only=True)
class Manner:
    """How every scene is pressed.

    Attributes:
        tolerance: Of F_z; the cheapest setting that keeps it is taken.
        environments: Of a batch; None presses alone.
        images: With the image, markers and stress of every frame, in a batch.
        own_mesh: On the mesh that ``batch_model`` makes, in a batch.
    """

    tolerance: str = "5%"
    device: str = "cpu"
    environments: int | None = None
    images: bool = False
    own_mesh: bool = False

    @property
    def extras(self) -> tuple[str, ...]:
        """What is unlike other batches, in words."""
        words = {IMAGES: self.images, "the batch's own mesh": self.own_mesh}
        return tuple(text for text, is_so in words.items() if is_so)

    @property
    def text(self) -> str:
        """All of it in words."""
        if self.environments is None:
            return f"{self.device}, alone, tolerance {self.tolerance}"
        many = f"{self.environments} environment{'s' * (self.environments > 1)}"
        return ", ".join([self.device, many, *self.extras])


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenePress:
    """What a scene's frames took, and the forces of the last of them.

    Attributes:
        preset: That it was pressed with; ``batch`` in a batch.
        edges: How many times as long as the preset's the edges were.
        promised: The setting states to keep the tolerance.
        setup_s: Mesh, upload and symbolic factorisation [s].
        wall_s: All frames of all environments [s].
        cpu_s: Processor time of the same [s].
        iterations: Newton's and the like, all frames.
        force_n: On the indenter in the last frame [N], shape [3].
        moment_nm: About its tip [N m], shape [3]; None where it is not computed.
        stiffness_n_m: dF_z / d(depth) in the last frame that goes down [N/m].
        balance: |indenter force + base reaction| over the former.
        parts_s: In a batch, what each launch of a step takes, and that of the stress [s].
        corrected: The last frame's force and depth without the mesh's bias, where that is known.
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
    corrected: Corrected | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneRow:
    """A scene that was pressed, or why it was not.

    Attributes:
        press: None where ``failure`` says why.
    """

    scene: str
    manner: Manner
    press: ScenePress | None
    failure: str = ""

    @property
    def setting(self) -> str:
        """Preset and length of edges; * where it does not state the tolerance asked for."""
        if self.press is None:
            return "failed"
        edges = "" if self.press.edges == 1.0 else f" {self.press.edges:.2f}"
        return f"{self.press.preset}{edges}{'' if self.press.promised else '*'}"

    @property
    def spent_s(self) -> float:
        """Time of all frames: the thread's on a CPU, whatever else the machine does; else wall."""
        if self.press is None:
            return nan
        return self.press.cpu_s if self.manner.device == "cpu" else self.press.wall_s

    @property
    def frames_per_s(self) -> float:
        """Frames of all environments [1/s]."""
        return FRAME_COUNT * (self.manner.environments or 1) / self.spent_s

    @property
    def text(self) -> str:
        """The row in a few words."""
        if self.press is None:
            return self.failure
        force, balance = self.press.force_n[2], self.press.balance
        return f"{self.frames_per_s:.1f} frames/s, F_z {force:.4f} N, balance {balance:.0e}"

    def as_json(self) -> dict[str, Any]:
        """Return plain values, the manner's among them."""
        own = {"scene": self.scene, "press": self.press, "failure": self.failure}
        return {**asdict(self.manner), **own}


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """What a scene is compared with.

    Attributes:
        stated: The scene's options: another scene of the same name has no reference.
        command: That made it, if it was kept.
        commit: Of the program that made it, if it was kept.
    """

    stated: dict[str, Any]
    press: ScenePress
    command: str = ""
    commit: str = ""

    def raw_error(self, found: ScenePress) -> float:
        """Return how far the mesh's own F_z is off, or its depth where the load is given."""
        if "force" in self.stated:
            return found.depth_m / self.press.depth_m - 1.0
        return found.force_n[2] / self.press.force_n[2] - 1.0

    def error(self, found: ScenePress) -> float:
        """Return how far F_z is off, or the depth where the load is given; corrected if it is."""
        corrected = found.corrected
        if corrected is None:
            return self.raw_error(found)
        if "force" in self.stated:
            return corrected.depth_m / self.press.depth_m - 1.0
        return corrected.force_n / self.press.force_n[2] - 1.0

    def sideways_error(self, found: ScenePress) -> float | None:
        """Return how far the motion's resistance is off: M_z of a twist, F_xy of a shift."""
        if found.moment_nm is None or self.press.moment_nm is None:
            return None
        if "twist" in self.stated:
            return found.moment_nm[2] / self.press.moment_nm[2] - 1.0
        if "shift" in self.stated:
            return hypot(*found.force_n[:2]) / hypot(*self.press.force_n[:2]) - 1.0
        return None


def read_references(file: Path, scenes: Sequence[BenchScene]) -> dict[str, Reference]:
    """Return what is known of these very scenes; nothing where there is no file.

    Args:
        file: References by name, or JSON of a benchmark that has measured some.

    Raises:
        ConfigError: The file is damaged.
    """
    if not file.exists():
        return {}
    try:
        stored = loads(file.read_bytes(), source=str(file))
        stored = stored.get("references", stored)
        found = from_json(dict[str, Reference], stored, source=str(file))
    except (OSError, RecordError) as error:
        raise ConfigError(
            f"{file} holds no references: {error}", remedy="make one with --reference and --json"
        ) from error
    stated = {scene.name: scene.stated for scene in scenes}
    return {name: each for name, each in found.items() if stated.get(name) == each.stated}
