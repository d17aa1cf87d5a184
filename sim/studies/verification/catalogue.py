"""The sections of the verification by name, in the order of the page."""

from __future__ import annotations

from collections.abc import Callable

from sim.studies.verification import (
    balance,
    bonded_layer,
    convergence,
    disc,
    error_estimates,
    height_map,
    interface,
    paper_mesh,
    real_press,
    sensitivity,
)
from tacauchy_rig.tables import Table

SECTIONS: dict[str, Callable[[], Table]] = {
    "punch": bonded_layer.measure_punch,
    "disc": disc.measure,
    "hertz": bonded_layer.measure_ball,
    "real-press": real_press.measure,
    "orders": convergence.measure,
    "rim-order": convergence.measure_rim,
    "error-estimates": error_estimates.measure,
    "half-element": sensitivity.measure_shift,
    "barrier": sensitivity.measure_barrier,
    "balance": balance.measure,
    "interface": interface.measure,
    "drives": sensitivity.measure_drives,
    "stress-cost": paper_mesh.measure_stress_cost,
    "mesh-table": paper_mesh.measure_mesh,
    "height-map": height_map.measure,
}
# A page of its own, docs/height_map.md.
ON_REQUEST = frozenset({"height-map"})
