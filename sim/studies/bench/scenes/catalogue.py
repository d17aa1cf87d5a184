"""The benchmark's scenes as data or drawn at random, and those that a pattern chooses."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np

from tacauchy_rig.core.selection import selected

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
    text = resources.files("sim.studies.bench.scenes").joinpath("scenes.toml").read_text("utf-8")
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
