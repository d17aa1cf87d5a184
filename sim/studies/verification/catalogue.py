"""The sections of the verification by name, in the order of the page."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import cast

from tacauchy_rig.core.tables import Table


def _section(place: str) -> Callable[[], Table]:
    """Return a section by ``module:function``; it is imported when it is measured."""
    module, _, name = place.partition(":")

    def measure() -> Table:
        found = getattr(import_module(f"sim.studies.verification.{module}"), name)
        return cast(Table, found())

    return measure


SECTIONS: dict[str, Callable[[], Table]] = {
    "punch": _section("bonded_layer:measure_punch"),
    "disc": _section("disc:measure"),
    "hertz": _section("bonded_layer:measure_ball"),
    "pressure": _section("surface_fields:measure_pressure"),
    "shear": _section("surface_fields:measure_shear"),
    "real-press": _section("real_press:measure"),
    "orders": _section("convergence:measure"),
    "rim-order": _section("convergence:measure_rim"),
    "error-estimates": _section("error_estimates:measure"),
    "half-element": _section("sensitivity:measure_shift"),
    "barrier": _section("sensitivity:measure_barrier"),
    "balance": _section("balance:measure"),
    "interface": _section("interface:measure"),
    "drives": _section("sensitivity:measure_drives"),
    "stress-cost": _section("paper_mesh:measure_stress_cost"),
    "mesh-table": _section("paper_mesh:measure_mesh"),
    "height-map": _section("height_map:measure"),
}
# A page of its own, docs/results/height_map.md.
ON_REQUEST = frozenset({"height-map"})
