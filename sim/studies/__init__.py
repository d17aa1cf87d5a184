"""Studies of the simulator; nothing but their commands imports them."""

import tomllib
from importlib import import_module, resources
from typing import Any


def from_file(file: str) -> dict[str, Any]:
    """Return what a data file of the studies states, such as ``bench/scenes.toml``."""
    return tomllib.loads(resources.files("sim.studies").joinpath(file).read_text("utf-8"))


def measured_at(place: str) -> Any:
    """Measure what a data file names, such as ``verification.forces:measure_punch``."""
    module, _, name = place.partition(":")
    return getattr(import_module(f"sim.studies.{module}"), name)()
