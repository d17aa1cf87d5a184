"""The mesh of preset ``paper`` beside the paper's numbers, and what its surface's stress costs."""

from __future__ import annotations

import platform
from dataclasses import replace
from functools import partial

import numpy as np

from sim.effects.footprint_presets import diagonal
from sim.effects.presets import PAPER_SIZING
from sim.fields.stress import surface_stress
from sim.press import press
from sim.press_command import scene_from
from sim.scene.scene import Preset
from sim.studies.bench.rendering import times_of
from sim.studies.paper.claims import Claim, claims
from sim.studies.paper.mesh import mesh_numbers, preset_statistics
from sim.studies.verification import Row, section
from tacauchy_rig.core.tables import Cell, Table

# How often the stress is extracted, and what the paper states for it at most (section IV-A) [s].
_REPEATS = 200
_PAPER_S = 1e-3 * claims()["speed.stress"].value
# A shallow press of a GelSight Mini.
_PRESS = "--sensor gelsight-mini --indenter cylinder:diameter=5mm --depth 0.3mm"
_SCENE = scene_from(_PRESS)


def measure_mesh() -> Table:
    """Measure the mesh with and without its fine region."""
    pad, sizing = _SCENE.pad, PAPER_SIZING
    coarse, fine = preset_statistics(_SCENE)
    gap = press(replace(_SCENE, preset=Preset.PAPER)).surface_traction_gap_relative
    found: dict[str, tuple[Cell, Cell]] = {
        _heading(claims()[name]): (claims()[name].value, value)
        for name, value in mesh_numbers(coarse, fine).items()
    }
    found |= {
        "smallest dihedral angle [deg]": (None, fine.dihedral_min_deg),
        "edge length l_c in the middle [mm]": (0.8, sizing.fine_m * 1e3),
        "edge length l_g elsewhere [mm]": (3.2, sizing.coarse_m * 1e3),
        "l_r = l_g over the bounding box's diagonal": (None, sizing.coarse_m / diagonal(pad)),
        "envelope epsilon_r over the same": (None, sizing.envelope_share),
        "AMIPS energy to stop at": (None, sizing.stop_energy),
        "sigma n of its surface off the contact force [%]": (None, 100.0 * gap),
    }
    rows = [{"quantity": name, "paper": them, "here": us} for name, (them, us) in found.items()]
    return section("mesh", rows)


def _heading(claim: Claim) -> str:
    return f"{claim.says} [{claim.unit}]" if claim.unit else claim.says


def measure_stress_cost(*, presets: tuple[Preset, ...] = (Preset.PAPER, Preset.FAST)) -> Table:
    """Press once on each preset and time the extraction on what came out."""
    rows = list[Row]()
    for preset in presets:
        result = press(replace(_SCENE, preset=preset))
        model = result.model
        extract = partial(surface_stress, model, result.point.state.positions)
        times = times_of(extract, most=_REPEATS, least=_REPEATS, budget_s=0.0)
        low, middle, high = (1e3 * float(np.quantile(times, q)) for q in (0.05, 0.5, 0.95))
        rows.append(
            {
                "preset": preset.value,
                "element": result.element,
                "tetrahedra": result.tet_count,
                "faces": len(model.faces),
                "device": model.device,
                "5 % [ms]": low,
                "median [ms]": middle,
                "95 % [ms]": high,
                "median below 1 ms": "yes" if middle < 1e3 * _PAPER_S else "no",
            }
        )
    words, here = f"{_PRESS} --preset {presets[0].value}", platform.machine()
    return section("stress_cost", rows, press=words, repeats=_REPEATS, machine=here)
