"""The sections of the verification by name, in the order of the page."""

from __future__ import annotations

from collections.abc import Callable

from sim.studies.verification import height_map, mesh_table, orders, rim_order, stress_cost
from sim.studies.verification.against_itself import balance, barrier, drives, held_out, shifts
from sim.studies.verification.against_solutions import disc, hertz, interface, punch, real_press
from tacauchy_rig.tables import Table

SECTIONS: dict[str, Callable[[], Table]] = {
    "punch": punch.measure,
    "disc": disc.measure,
    "hertz": hertz.measure,
    "real-press": real_press.measure,
    "orders": orders.measure,
    "rim-order": rim_order.measure,
    "error-estimates": held_out.measure,
    "half-element": shifts.measure,
    "barrier": barrier.measure,
    "balance": balance.measure,
    "interface": interface.measure,
    "drives": drives.measure,
    "stress-cost": stress_cost.measure,
    "mesh-table": mesh_table.measure,
    "height-map": height_map.measure,
}
# A page of its own, docs/height_map.md.
ON_REQUEST = frozenset({"height-map"})
