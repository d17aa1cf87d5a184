"""The sections of the verification by name, in the order of the page."""

from __future__ import annotations

from collections.abc import Callable

from sim.verification import disc, drives, hertz, mesh_table, punch, real_press, stress_cost
from sim.verification.section import Section

SECTIONS: dict[str, Callable[[], Section]] = {
    "punch": punch.measure,
    "disc": disc.measure,
    "hertz": hertz.measure,
    "real-press": real_press.measure,
    "drives": drives.measure,
    "stress-cost": stress_cost.measure,
    "mesh-table": mesh_table.measure,
}
