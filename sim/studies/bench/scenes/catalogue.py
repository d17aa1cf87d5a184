"""The benchmark's scenes as data, and those that a pattern chooses."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from fnmatch import fnmatch
from importlib import resources
from typing import Any

from tacauchy_rig.errors import ConfigError


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


def select_scenes(pattern: str) -> tuple[BenchScene, ...]:
    """Return the scenes whose name has a pattern in it, such as ``ball`` or ``*, friction``.

    Raises:
        ConfigError: None has.
    """
    found = tuple(scene for scene in all_scenes() if fnmatch(scene.name, f"*{pattern}*"))
    if not found:
        names = "; ".join(scene.name for scene in all_scenes())
        raise ConfigError(f"--only {pattern!r}: no such scene", remedy=f"choose among {names}")
    return found
